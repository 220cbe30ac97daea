"""Run documents and their jobs, for tests."""

from pathlib import Path
from typing import Any

import pytest

from mjrun.document.run import read_run
from mjrun.errors import DocumentError
from mjrun.options.run import RunCommandOptions
from mjrun.simulation.simulation import Simulation

HEAD = "model: m.xml\n"

OUT = RunCommandOptions(output="out")


def jobs(text: str, *assignments: str, options: RunCommandOptions = OUT, name: str = "d.yaml") -> list[Any]:
    Path(name).write_text(text)
    return read_run(name, assignments, options).outputs


def job(text: str, *assignments: str, options: RunCommandOptions = OUT) -> Any:
    """The one job of a document without its model."""
    (only,) = jobs(HEAD + text, *assignments, options=options)
    return only


def problems(text: str, *assignments: str) -> list[str]:
    with pytest.raises(DocumentError) as caught:
        jobs(text, *assignments)
    return [line.removeprefix("d.yaml:") for line in str(caught.value).splitlines()]


def simulation(**settings: Any) -> Simulation:
    return Simulation("m.xml", **settings)
