"""What is wrong with a value is told at its place, in the words of the document, of whichever kind that is."""

from pathlib import Path

import pytest

from mjrun.document.builder import DocumentValueBuilder, SimulationDocumentReader
from mjrun.document.paths import DocumentContext, OutputFolder
from mjrun.document.tree import DocumentPlace, MappingNode, option_fault
from mjrun.document.yaml_text import LineIndex, compose
from mjrun.errors import DocumentError, UsageError
from mjrun.options.fit import FitOptions
from mjrun.options.option import Options, options
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.options.sweep import StudyOptions
from mjrun.options.trace import TraceOptions
from mjrun.simulation.simulation import Simulation
from tests.fitting.logs import write_model


def tree(text: str) -> MappingNode:
    lines = LineIndex(text)
    node, faults = compose(text, lambda index: DocumentPlace(0, *lines.at(index), "d.yaml"))
    assert isinstance(node, MappingNode)
    assert not faults
    return node


@pytest.mark.parametrize(
    ("declared", "text", "path", "expected"),
    [
        (StudyOptions, "metrics: {low: x}", ("metric", "low"), "d.yaml:1:11 metrics.low"),
        (StudyOptions, "vary:\n  opt.timestep: 1", ("vary", "opt.timestep"), "d.yaml:2:3 vary.opt.timestep"),
        (StudyOptions, "require: [a, b]", ("require", 1), "d.yaml:1:14 require[1]"),
        (TraceOptions, "probe: [qpos, 'ctrl,energy', time]", ("probe", 2), "d.yaml:1:15 probe[1]"),
        (TraceOptions, "probe: [qpos]", ("rate",), "d.yaml:1:1 rate"),
    ],
)
def test_a_fault_stands_at_its_option(
    declared: type[Options], text: str, path: tuple[str | int, ...], expected: str
) -> None:
    fault = option_fault(tree(text), (), UsageError("wrong", path), lambda _: declared)
    assert (f"{fault.mark} {fault.path}", fault.message) == (expected, "wrong")


def test_everything_that_is_wrong_is_reported_at_once() -> None:
    def fail(name: str) -> object:
        raise UsageError(f"no {name}", (name,))

    folders = DocumentContext(Path(), OutputFolder(Path()))
    builder = DocumentValueBuilder(tree("samples: 1\nrepeats: 2"), folders, lambda _: StudyOptions)
    assert builder.attempt((), lambda: 7) == 7
    builder.raise_faults()
    assert builder.attempt((), lambda: fail("repeats")) is None
    assert builder.attempt((), lambda: fail("samples")) is None
    with pytest.raises(DocumentError) as caught:
        builder.raise_faults()
    assert str(caught.value).splitlines() == ["d.yaml:1:10: samples: no samples", "d.yaml:2:10: repeats: no repeats"]


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
