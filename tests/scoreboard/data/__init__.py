"""The inputs of measures that are plain data: a YAML file for each module that uses some."""

from functools import cache
from pathlib import Path
from typing import Any, cast

import yaml


@cache
def inputs_of(module: str) -> dict[str, Any]:
    """Returns the data of a module by name; sequences are tuples."""
    text = Path(__file__).with_name(f"{module.rpartition('.')[2]}.yaml").read_text("utf-8")
    return cast("dict[str, Any]", _frozen(yaml.load(text, yaml.CSafeLoader)))


def _frozen(value: object) -> object:
    match value:
        case dict():
            return {key: _frozen(each) for key, each in cast("dict[str, object]", value).items()}
        case list():
            return tuple(map(_frozen, cast("list[object]", value)))
        case _:
            return value
