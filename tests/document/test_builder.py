"""What is wrong with a value is told at its place, in the words of the document, of whichever kind that is."""

from pathlib import Path

import pytest

from mjrun.document.builder import DocumentContext, DocumentValueBuilder, OutputFolder
from mjrun.document.run import read_run
from mjrun.document.simulation_document import SimulationDocumentReader
from mjrun.document.tree import DocumentPlace, MappingNode, option_fault
from mjrun.document.yaml_text import LineIndex, compose
from mjrun.errors import DocumentError, UsageError
from mjrun.options.fit import FitOptions
from mjrun.options.option import Options, options
from mjrun.options.run import RunCommandOptions
from mjrun.options.simulation import CodeOptions, SimulationOptions
from mjrun.options.sweep import StudyOptions
from mjrun.options.trace import TraceOptions
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.document.run_documents import HEAD, jobs, problems
from tests.fitting.logs import write_model

OWN = "each output needs a separate file"


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


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that relative paths mean, with one for outputs in it."""
    monkeypatch.chdir(tmp_path)
    Path("out").mkdir()
    return tmp_path


def test_outputs_may_go_up_and_down_inside_the_folder() -> None:
    Path("out/inner").symlink_to("deeper/place")
    text = HEAD + "traces: [{output: a/../b.csv}, {output: inner/c.csv}, {output: ..d.csv}, {output: a/~}]"
    assert [one.output for one in jobs(text.replace("a/~", "a/~.csv"))] == [
        "out/a/../b.csv", "out/inner/c.csv", "out/..d.csv", "out/a/~.csv",
    ]  # fmt: skip


def test_a_folder_of_outputs_may_be_a_link_itself(folder: Path) -> None:
    Path("alias").symlink_to("out")
    Path("d.yaml").write_text(HEAD + "recordings: [a.npz]")
    (kept,) = read_run("d.yaml", [], RunCommandOptions(output=folder / "alias")).outputs
    assert kept.output == str(folder / "alias/a.npz")  # type: ignore[attr-defined]


def test_views_in_files_of_their_own_leave_the_name_itself_free() -> None:
    text = HEAD + "images: [{output: a.png, view: [rgb, seg], separate: true}, {output: a.png, view: depth}]"
    assert len(jobs(text)) == 2


@cases("output, reason")
def test_no_output_is_outside_of_the_folder(folder: Path, output: str, reason: str) -> None:
    (folder / "else").mkdir()
    for link, target in (("link", "../else"), ("file.csv", "../else/file.csv"), ("self", ".")):
        Path("out", link).symlink_to(target)
    text = output if output.startswith('"') else f"'{output}'"
    assert problems(f"{HEAD}videos: [{{output: {text}}}]") == [f"2:19: videos[0].output: {reason}"]
    assert problems(f"{HEAD}traces: [{{output: a.csv, contacts: {text}, manifest: {text}}}]") == [
        f"2:36: traces[0].contacts: {reason}",
        f"2:{48 + len(text)}: traces[0].manifest: {reason}",
    ]
    assert problems(f"{HEAD}images: [{{output: a.png, pointcloud: {text}}}]")[0].endswith(f".pointcloud: {reason}")
    assert problems(f"{HEAD}images: [{{output: a.png, calibration: {text}}}]")[0].endswith(f".calibration: {reason}")
    assert problems(f"{HEAD}recordings: [{text}]") == [f"2:14: recordings[0]: {reason}"]


def test_links_in_a_circle_lead_nowhere() -> None:
    Path("out/a").symlink_to("b")
    Path("out/b").symlink_to("a")
    assert problems(f"{HEAD}recordings: [a/r.npz]")[0].startswith("2:14: recordings[0]: out/a/r.npz cannot be reached")


def test_links_cannot_lead_the_files_of_single_views_out_either() -> None:
    Path("out/a-seg.png").symlink_to("../b.png")
    Path("out/a-seg.labels.json").symlink_to("../b.json")
    text = f"{HEAD}images: [{{output: a.png, view: [rgb, seg], separate: true}}]"
    assert problems(text) == [
        "2:19: images[0].output: out/a-seg.labels.json leads out of the folder of outputs, by a link",
        "2:19: images[0].output: out/a-seg.png leads out of the folder of outputs, by a link",
    ]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("traces: [{output: a.csv}, {output: ./a.csv}]",
         f"2:36: traces[1].output: out/a.csv clashes with traces[0].output at d.yaml:2:19; {OWN}"),
        ("traces: [{output: a.csv}, {output: b/../a.csv}]",
         f"2:36: traces[1].output: out/b/../a.csv clashes with traces[0].output at d.yaml:2:19; {OWN}"),
        ("traces: [{output: a.csv}]\nimages: [{output: a.csv/}]",
         f"2:19: traces[0].output: out/a.csv clashes with images[0].output at d.yaml:3:19; {OWN}"),
        ("traces: [{output: a.csv, contacts: a.csv}]",
         f"2:36: traces[0].contacts: out/a.csv clashes with traces[0].output at d.yaml:2:19; {OWN}"),
        ("traces: [{output: a.csv}]\nrecordings: [{output: r.npz, manifest: a.csv}]",
         f"3:40: recordings[0].manifest: out/a.csv clashes with traces[0].output at d.yaml:2:19; {OWN}"),
        ("traces: [{output: a.csv}, {output: alias.csv}]",
         f"2:36: traces[1].output: out/alias.csv clashes with traces[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f/}]\ntraces: [{output: f/a.csv}]",
         f"3:19: traces[0].output: out/f/a.csv clashes with videos[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f/a.mp4}, {output: f}]",
         f"2:38: videos[1].output: out/f clashes with videos[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f_%04d.png}, {output: f_%d.png}]",
         f"2:41: videos[1].output: out/f_%d.png clashes with videos[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f_%04d.png}]\nimages: [{output: f_0007.png}, {output: f_x.png}]",
         f"3:19: images[0].output: out/f_0007.png clashes with videos[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f_7.mp4}, {output: 'f_%d.mp4'}]",
         f"2:38: videos[1].output: out/f_%d.mp4 clashes with videos[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f.mp4, view: [rgb, depth], separate: true}, {output: f-depth.mp4}]",
         f"2:72: videos[1].output: out/f-depth.mp4 clashes with videos[0].output at d.yaml:2:19; {OWN}"),
        ("videos: [{output: f.mkv, view: seg}]\ntraces: [{output: f.labels.json}]",
         f"3:19: traces[0].output: out/f.labels.json clashes with videos[0].output at d.yaml:2:19; {OWN}"),
    ],
)  # fmt: skip
def test_two_outputs_in_one_file_are_reported_with_both_places(folder: Path, text: str, line: str) -> None:
    (folder / "out/alias.csv").symlink_to("a.csv")
    assert problems(HEAD + text) == [line]


@pytest.mark.parametrize(("path", "cause"), [("../a.csv", ""), ("link.csv", ", by a link")])
def test_only_a_link_is_called_one(tmp_path: Path, path: str, cause: str) -> None:
    folder = tmp_path / "out"
    (folder / "link.csv").symlink_to("../a.csv")
    with pytest.raises(UsageError) as caught:
        OutputFolder(folder).reserve(str(folder / path), "output")
    assert str(caught.value).endswith(f"leads out of the folder of outputs{cause}")
