"""What is wrong with a value is told at the place that says it, in the document's own words."""

from pathlib import Path

import pytest

from mjrun.document.builder import DocumentValueBuilder
from mjrun.document.paths import DocumentContext, OutputFolder
from mjrun.document.tree import DocumentPlace, MappingNode, option_fault
from mjrun.document.yaml_text import LineIndex, compose
from mjrun.errors import DocumentError, UsageError
from mjrun.options.option import Options
from mjrun.options.sweep import StudyOptions
from mjrun.options.trace import TraceOptions


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
