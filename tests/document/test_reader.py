"""What is read from a document is what YAML 1.2 says; what is wrong with one, or its kind, is told at its place."""

import gc
import os
import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mjrun.document import tree, yaml_text
from mjrun.document.camera_and_ghost_forms import CAMERA, read_camera
from mjrun.document.evaluation import EVALUATION, read_evaluation
from mjrun.document.fit import FIT, read_fit
from mjrun.document.reader import KINDS, LARGEST, kind_of_file
from mjrun.document.run import RUN, read_run
from mjrun.document.study import STUDY, read_study
from mjrun.document.task import TASK, read_task
from mjrun.errors import FAULTS, DocumentError, FileError, clean
from tests.document.documents import ANCHOR, Anything, Run, outcome, problems, put, read

# --- files -------------------------------------------------------------------------------------------


def test_a_file_that_is_not_there_is_reported_with_its_neighbours() -> None:
    put("a: 1", "shots.yaml")
    with pytest.raises(FileError, match=r"^shot\.yaml: no such file \(did you mean 'shots\.yaml'\?\)$"):
        read("shot.yaml", Anything)
    with pytest.raises(FileError, match=r"^shots\.yaml/x: no such file$"):
        read("shots.yaml/x", Anything)
    with pytest.raises(FileError, match=r"^a\\x00b: cannot be read: .*embedded null (byte|character in path)$"):
        read("a\0b", Anything)


def test_what_is_no_regular_file_is_refused_and_never_waited_for() -> None:
    Path("folder").mkdir()
    with pytest.raises(FileError, match=r"^folder: is a folder, not a document$"):
        read("folder", Anything)
    os.mkfifo("pipe")
    with pytest.raises(FileError, match=r"^pipe: is not a regular file$"):
        read("pipe", Anything)
    with pytest.raises(FileError, match=r"^/dev/zero: is not a regular file$"):
        read("/dev/zero", Anything)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        with pytest.raises(FileError, match=r"^socket: cannot be read: "):
            read("socket", Anything)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read anything")
def test_a_file_that_may_not_be_read_is_reported() -> None:
    put("a: 1").chmod(0)
    with pytest.raises(FileError, match=r"^d\.yaml: cannot be read: Permission denied$"):
        read("d.yaml", Anything)


def test_a_file_that_fails_while_it_is_read_is_reported() -> None:
    with pytest.raises(FileError, match=r"^/proc/self/mem: cannot be read: Input/output error$"):
        read("/proc/self/mem", Anything)


def test_refused_files_are_closed() -> None:
    Path("folder").mkdir()
    gc.collect()  # what other tests left open
    before = sorted(Path("/proc/self/fd").iterdir())
    for path in ("folder", "/dev/zero"):
        with pytest.raises(FileError):
            read(path, Anything)
    assert sorted(Path("/proc/self/fd").iterdir()) == before


def test_a_document_may_be_as_large_as_the_limits_and_no_larger(monkeypatch: pytest.MonkeyPatch) -> None:
    assert read(put("a: ".ljust(LARGEST, "x")), Anything).a == "x" * (LARGEST - 3)
    too_large = put("a: ".ljust(LARGEST + 1, "x"))
    assert problems(lambda: read(too_large, Anything)) == ["d.yaml: more than 1 MiB are no document for mjrun"]

    monkeypatch.setattr(yaml_text, "NODES", 6)
    assert read(put("a: [1, 2, 3]"), Anything).a == [1, 2, 3]  # with the mapping, its key and the list
    assert problems(lambda: read(put("a: [1, 2, 3,\n 4]"), Anything)) == [
        "d.yaml:2:2: more than 6 values are no document for mjrun"
    ]


# --- vars and defaults -------------------------------------------------------------------------------


def test_what_is_wrong_in_defaults_is_reported_in_their_own_lines_after_the_document() -> None:
    put("duration: -1\nmodel: ${m}\ndefaults: x.yaml\nstart: {knee: up, hip: up}\nfoo: 1\nstart: {}\n", "below.yaml")
    path = put("defaults: below.yaml\nsteps: x\nstart: {hip: 1}\n")
    keys = "keys: duration, steps, model, films, start, vars, defaults"
    assert problems(lambda: read(path, Run, variables=True)) == [
        "d.yaml:2:8: steps: expected a whole number, got 'x'",
        "below.yaml:1:11: duration: expected a positive number, got -1",
        "below.yaml:2:8: model: no variable 'm'; there are no vars",
        "below.yaml:3:1: the document in defaults cannot have defaults",
        "below.yaml:4:15: start.knee: expected a number or a list of numbers, got 'up'",
        f"below.yaml:5:1: unknown key 'foo'; {keys}",
        "below.yaml:6:1: 'start' is given twice; first in line 4",
    ]


def test_defaults_that_cannot_be_read_are_reported_with_who_names_them() -> None:
    path = put("defaults: below.yaml\n")
    with pytest.raises(FileError) as caught:
        read(path, Run, variables=True)
    assert str(caught.value) == "below.yaml: no such file\nd.yaml:1:11 names it as defaults"
    put("- 1\n", "below.yaml")
    assert problems(lambda: read(path, Run, variables=True)) == ["below.yaml:1:1: expected a mapping, got a list"]


@pytest.mark.parametrize(
    ("text", "assignments", "lines"),
    [
        ("defaults: 5\n", [], ["d.yaml:1:11: defaults: expected the path of a document, got 5"]),
        ("defaults:\n", [], ["d.yaml:1:10: defaults: expected the path of a document, got nothing"]),
        ("defaults: ''\n", [], ["d.yaml:1:11: defaults: expected the path of a document, got ''"]),
        ("defaults: /etc/passwd\n", [], ["d.yaml:1:11: defaults: a document ends in .yaml or .yml"]),
        ("defaults: *a\n", [], [f"d.yaml:1:11: defaults: {ANCHOR}"]),
        ("steps: 1\n", ["defaults=x.yaml"], ["defaults=x.yaml: defaults is set in the document only"]),
    ],
)
def test_defaults_that_are_no_path_are_reported(text: str, assignments: list[str], lines: list[str]) -> None:
    assert problems(lambda: read(put(text), Run, assignments, variables=True)) == lines


def test_what_is_no_document_is_not_cited() -> None:
    put("root:x:0:0:secret\n", "secrets.txt")
    Path("link.yaml").symlink_to("secrets.txt")
    for read_link in (
        lambda: read("link.yaml", Anything),
        lambda: read(put("defaults: link.yaml\n"), Run, variables=True),
    ):
        assert problems(read_link) == ["link.yaml:1:1: expected a mapping, got text"]


def test_thousands_of_unknown_keys_are_compared_as_far_as_they_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[str] = []
    monkeypatch.setattr(tree, "suggestion", lambda key, keys: compared.extend([key] if keys else []) or "")
    with pytest.raises(DocumentError) as caught:
        read(put("".join(f"step{i}: 1\n" for i in range(2000))), Run)
    assert len(caught.value.problems) == 2000
    assert len(compared) == FAULTS


def test_a_document_without_a_preamble_has_neither_and_takes_texts_as_they_are() -> None:
    keys = "keys: duration, steps, model, films, start"
    assert read(put("model: ${x} $${\n"), Run).model == "${x} $${"
    assert problems(lambda: read(put("vars: {}\ndefaults: x\n"), Run)) == [
        f"d.yaml:1:1: unknown key 'vars'; {keys}",
        "d.yaml:2:1: unknown key 'defaults'",
    ]


# --- any text ----------------------------------------------------------------------------------------

WORDS = ["a", "b", "films", "fps", "vars", "defaults", "1", "-.5", ".nan", "1e999", "0x1F", "true", "~", "<<", "é", "="]
MARKS = [": ", ":", "- ", "\n", "\n  ", "\n    ", "[", "]", "{", "}", ", ", "? ", "&x", "*x", "!!str ", "!", "|", ">"]
ODD = [
    "'",
    '"',
    "\\",
    "\\ud800",
    "${a}",
    "${",
    "$${",
    "#",
    "%",
    "@",
    "---\n",
    "...",
    "\t",
    "\0",
    "\u2028",
    "\x85",
    "\r",
]
pieces = st.sampled_from([*WORDS, *MARKS, *ODD])


@given(st.text() | st.lists(pieces, max_size=30).map("".join), st.lists(st.text() | st.lists(pieces).map("".join)))
@example("films: [{fps: 1}]", ["films[99999999999999999999].fps=1"])
@example("films: [{fps: 1}]", ["\0number=1"])
@settings(max_examples=75, deadline=None)
def test_no_text_does_anything_but_be_read_or_be_told_what_is_wrong_with_it(text: str, assignments: list[str]) -> None:
    path = put(text.encode("utf-8", "surrogatepass"))
    for kind in (Run, Anything):
        found = outcome(lambda kind=kind: read(path, kind, assignments, variables=True))
        if isinstance(found, DocumentError):
            assert found.problems
            assert str(found).splitlines() == [clean(line) for line in str(found).splitlines()]
        else:
            assert isinstance(found, kind) or "defaults" in str(found)


@given(st.binary())
@settings(max_examples=50, deadline=None)
def test_no_bytes_do_either(data: bytes) -> None:
    with pytest.raises(DocumentError):
        read(put(data + b"\xff"), Run)


@given(st.lists(pieces, max_size=20).map("".join))
@settings(max_examples=100, deadline=None)
def test_every_place_that_is_reported_is_in_the_text(text: str) -> None:
    found = outcome(lambda: read(put(text), Anything))
    lines = re.split("\r\n|\r|\n", text)
    for problem in found.problems if isinstance(found, DocumentError) else ():
        if problem.place != "d.yaml":
            line, column = map(int, problem.place.split(":")[1:])
            assert 1 <= column <= len(lines[line - 1]) + 1


RECORDS = {record.name: record for record in (RUN, STUDY.record, FIT.record, TASK, EVALUATION, CAMERA)}
READERS: dict[str, Callable[[Path], object]] = {
    "Run": read_run,
    "Study": read_study,
    "Fit": read_fit,
    "Task": read_task,
    "Evaluation": read_evaluation,
    "CameraDocument": read_camera,
}
DOCUMENTS = {
    "Run": "model: a.xml\nduration: 3\nvideos: [a.mp4]\nhtml: a.html\n",
    "Study": "model: a.xml\nduration: 3\nvary: {opt.timestep: [1e-3, 2e-3]}\nmetrics: {x: last(qpos/a)}\n",
    "Fit": "model: a.xml\ntimestep: 1e-3\ndata: [a.csv]\nfree: {joint/a.damping: 0..1}\n",
    "Task": "model: a.xml\ncontrol_dt: 1\nobservations: [{probe: qpos}]\nactions: [{actuators: [a]}]\n",
    "Evaluation": "vary: {control_dt: [1, 2]}\npolicy: zero\ntask: a.yaml\nvideos: 3\n",
    "CameraDocument": "speed: 1\n\nshots: [{free: {}}]\n",
}


def test_each_kind_is_known_by_keys_that_no_other_kind_has() -> None:
    assert {*RECORDS} == {*KINDS}
    for name, kind in KINDS.items():
        own_too = (name, *(["Evaluation"] if name in ("Study", "Run") else []))  # which varies and records as these do
        of_others = {key for other, record in RECORDS.items() if other not in own_too for key in record.keys}
        assert kind.keys <= {*RECORDS[name].keys}
        assert not kind.keys & of_others


@pytest.mark.parametrize("wanted", READERS)
@pytest.mark.parametrize("written", DOCUMENTS)
def test_one_line_says_what_a_document_is(tmp_path: Path, written: str, wanted: str) -> None:
    path = tmp_path / "document.yaml"
    path.write_text(DOCUMENTS[written])
    if written == wanted:
        return
    with pytest.raises(DocumentError) as caught:
        READERS[wanted](path)
    (problem,) = caught.value.problems
    assert problem.place == f"{path}:3:1"
    assert f"makes this {KINDS[written].name}, for {KINDS[written].use}" in problem.message
    assert problem.message.endswith(f"; expected {KINDS[wanted].name}")


def test_what_is_no_file_is_of_no_kind_and_nobody_waits_for_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "d.yaml")
    assert kind_of_file(tmp_path / "d.yaml") is None
    assert kind_of_file(tmp_path / "missing.yaml") is None


def test_a_key_of_another_kind_beside_its_own_is_an_unknown_key(tmp_path: Path) -> None:
    path = tmp_path / "document.yaml"
    path.write_text(DOCUMENTS["Run"] + "vary: {}\n")
    with pytest.raises(DocumentError, match="unknown key 'vary'"):
        read_run(path)
