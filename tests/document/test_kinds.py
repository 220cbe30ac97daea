"""A document of one kind where another kind is wanted: one line says what it is, and what takes it."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mjrun.document.camera_and_ghost_forms import CAMERA, read_camera
from mjrun.document.evaluation import EVALUATION, read_evaluation
from mjrun.document.fit import FIT, read_fit
from mjrun.document.reader import KINDS, kind_of_file
from mjrun.document.run import RUN, read_run
from mjrun.document.study import STUDY, read_study
from mjrun.document.task import TASK, read_task
from mjrun.errors import DocumentError

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
