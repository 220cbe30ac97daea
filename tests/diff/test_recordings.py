"""Recordings of a bare mujoco loop, with what differs in them planted."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.diff.result import TableDifference
from mjrun.diff.table_files import compare_recordings
from mjrun.errors import FileError, UnknownNameError, UsageError
from mjrun.formats import recording
from mjrun.formats.recording import RecordingWriter
from mjrun.model import state
from mjrun.options.diff import TableDiffOptions

MODEL = """<mujoco><worldbody><body><joint name="hip"/><geom size=".1"/><body pos="0 0 1"><joint name="knee"/>
<geom size=".1"/></body></body></worldbody><actuator><motor name="push" joint="hip"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


def states(model: mujoco.MjModel, count: int) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[:] = 0.1, 0.2
    found = [state.save(model, data)]
    while len(found) < count:
        mujoco.mj_step(model, data)
        found.append(state.save(model, data))
    return np.array(found)


def record(path: Path, rows: np.ndarray, model: mujoco.MjModel | None, first_step: int = 0) -> str:
    facts = {"mujoco": "4.0.0"} if model is None else {**state.layout(model), "mujoco": "4"}
    with RecordingWriter(str(path), rows.shape[1], facts) as out:
        for step, row in enumerate(rows):
            out.write(step + (first_step if step else 0), row)
        out.publish()
    return str(path)


def compare(a: str, b: str, model: mujoco.MjModel | None = None, **options: object) -> TableDifference:
    table, differences, _ = compare_recordings(a, b, TableDiffOptions(**options), model)  # type: ignore[arg-type]
    assert not differences
    assert table
    return table


def test_the_first_step_that_differs_is_reported_with_its_joint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: mujoco.MjModel
) -> None:
    rows = states(model, 200)
    a = record(tmp_path / "a.npz", rows, model)
    changed = rows.copy()
    knee = state.fields(state.sizes(model))["qvel"].start + 1
    changed[137:, knee] = np.nextafter(changed[137:, knee], np.inf)
    b = record(tmp_path / "b.npz", changed, model)
    monkeypatch.setattr(recording, "PIECE", 1000)  # bytes
    table = compare(a, b, model)
    assert (table.aligned, table.rows) == ("step", 200)
    differing = [column for column in table.columns if column.first]
    assert [column.name for column in differing] == ["qvel/knee"]
    assert differing[0].differing == 63
    first = differing[0].first
    assert first
    assert (first.at, first.a, first.b) == (137, repr(float(rows[137, knee])), repr(float(changed[137, knee])))
    assert compare(a, b).columns[0].name == "qvel/1"
    assert not any(column.first for column in compare(a, b, model, tol={"qvel/*": 1e-9}).columns)
    assert len(compare(a, b, model, columns="q*/*").columns) == 6 + model.nv  # forces applied and warm start too


def test_states_of_other_steps_are_reported(tmp_path: Path, model: mujoco.MjModel) -> None:
    rows = states(model, 20)
    a, b = record(tmp_path / "a.npz", rows, model), record(tmp_path / "b.npz", rows[:10], model, first_step=15)
    table = compare(a, b)
    assert (table.rows, table.only_a.count, table.only_b.count) == (5, 15, 5)
    assert (table.only_a.at, table.only_b.at) == (1, 20)


def test_recordings_of_other_models_are_reported_by_their_sizes(tmp_path: Path, model: mujoco.MjModel) -> None:
    rows = states(model, 3)
    larger = mujoco.MjModel.from_xml_string(MODEL.replace("</actuator>", '<motor name="b" joint="knee"/></actuator>'))
    a, b = record(tmp_path / "a.npz", rows, model), record(tmp_path / "b.npz", states(larger, 3), larger)
    table, differences, _ = compare_recordings(a, b, TableDiffOptions())
    assert table is None
    assert differences == [f"nu is 1 in {a}, 2 in {b}"]
    bare = record(tmp_path / "bare.npz", states(larger, 3), None)
    table, differences, notes = compare_recordings(a, bare, TableDiffOptions())
    assert differences == [f"a state has {rows.shape[1]} numbers in {a}, {state.size(larger)} in {bare}"]
    assert notes == ["MuJoCo is 4 and 4.0.0"]
    with pytest.raises(UsageError, match="the recording was made with another model: it has nu 1, not 2"):
        compare(a, a, larger)


def test_joints_that_have_changed_places_are_not_compared(tmp_path: Path) -> None:
    bodies = [f'<body><joint name="{name}"/><geom size=".{size}"/></body>' for name, size in (("a", 1), ("b", 2))]
    models = [
        mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(order)}</worldbody></mujoco>")
        for order in (bodies, bodies[::-1])
    ]
    one, other = (record(tmp_path / f"{i}.npz", states(model, 3), model) for i, model in enumerate(models))
    table, differences, _ = compare_recordings(one, other, TableDiffOptions())
    assert table is None
    assert differences == [f"joint 'a' is number 0 in {one}, 1 in {other}"]
    with pytest.raises(UsageError, match="joint 'a' is number 0 in it, not 1") as caught:
        compare_recordings(one, one, TableDiffOptions(), models[1])
    assert caught.value.path == ("model",)


def test_a_recording_that_does_not_know_its_sizes_has_numbered_states(tmp_path: Path, model: mujoco.MjModel) -> None:
    rows = states(model, 3)
    changed = rows + np.eye(3, rows.shape[1], 4)
    a, b = record(tmp_path / "a.npz", rows, None), record(tmp_path / "b.npz", changed, None)
    differing = {column.name for column in compare(a, b).columns if column.first}
    assert differing == {"state/4", "state/5", "state/6"}


def test_what_does_not_fit_recordings_is_reported(tmp_path: Path, model: mujoco.MjModel) -> None:
    a = record(tmp_path / "a.npz", states(model, 3), model)
    with pytest.raises(UnknownNameError, match="no column 'qpos/ankle'"):
        compare(a, a, model, columns="qpos/ankle")
    (tmp_path / "b.npz").write_bytes(Path(a).read_bytes()[:-50])
    with pytest.raises(FileError, match=r"b.npz: is not a recording"):
        compare(a, str(tmp_path / "b.npz"))
