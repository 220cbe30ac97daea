"""What documents of studies and fits share; what each says is in test_study.py and test_fit.py."""

from pathlib import Path

import pytest

from mjrun.document.builder import SimulationDocumentReader
from mjrun.errors import DocumentError, UsageError
from mjrun.options.fit import FitOptions
from mjrun.options.option import options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import write_model

Made = tuple[Simulation, dict[str, object]]


def make(simulation: Simulation, **values: object) -> Made:
    if values.get("starts") == 13:
        raise UsageError("starts: not today", ("starts",))
    return simulation, values


@options
class Every(FitOptions, SimulationOptions):
    """All options of the document."""


DOCUMENT = SimulationDocumentReader[Made]("Sample", FitOptions, Every, make)


def read(folder: Path, text: str, *assignments: str) -> Made:
    write_model(folder)
    (folder / "d.yaml").write_text(f"model: pendulum.xml\n{text}")
    values, defaults = {"holdout": 0.1}, {"loss": "huber", "output": "a.xml"}
    return DOCUMENT.read(folder / "d.yaml", assignments, values, defaults, CodeOptions()).made


def test_what_is_reported_elsewhere_counts_over_the_document_and_defaults_below_it(tmp_path: Path) -> None:
    simulation, values = read(tmp_path, "seed: 3\nholdout: 0.5\nloss: cauchy", "starts=2")
    assert simulation.seed == 3
    assert simulation.load().nq == 1
    assert values == {"holdout": 0.1, "loss": "cauchy", "output": "a.xml", "starts": 2}


def test_faults_of_what_is_made_are_reported_at_their_lines(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match=r"d\.yaml:2:9: starts: not today"):
        read(tmp_path, "starts: 13")


def test_errors_of_the_run_are_too(tmp_path: Path) -> None:
    read(tmp_path, "starts: 2")
    request = DOCUMENT.read(tmp_path / "d.yaml", (), {}, {}, CodeOptions())
    with pytest.raises(DocumentError, match=r"d\.yaml:2:9: starts: too many"), request.located():
        raise UsageError("starts: too many", ("starts",))
