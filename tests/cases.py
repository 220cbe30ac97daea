"""Data of tests: tables of plain cases, in a YAML file beside a module, and models of several tests, in `models/`."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml


def cases(names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Parametrizes a test by its table in `test_module.yaml`, where a row has a value for each of the names."""

    def decorated(test: Callable[..., None]) -> Callable[..., None]:
        tables = _tables(Path(test.__code__.co_filename).with_suffix(".yaml"))
        return pytest.mark.parametrize(names, tables[test.__name__.removeprefix("test_")])(test)

    return decorated


@cache
def _tables(path: Path) -> dict[str, list[Any]]:
    return yaml.load(path.read_text("utf-8"), yaml.CSafeLoader)


def mjcf(name: str) -> str:
    """Returns the text of a model in `tests/models`."""
    return (Path(__file__).parent / "models" / f"{name}.xml").read_text("utf-8")
