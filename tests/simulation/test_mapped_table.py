"""Tables of motions, made with pandas and numpy from a bare loop, as states of the model."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np
import pandas as pd
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from mjrun.errors import FileError, MjrunError, UnknownNameError, UsageError
from mjrun.formats.recording import is_recording
from mjrun.model import state
from mjrun.outputs.recording import Recording
from mjrun.physics.kinematic_samples import KinematicMotion
from mjrun.probe.fields import field_probe
from mjrun.simulation.mapped_table import LARGEST, map_entries, read_controls, read_motion
from mjrun.simulation.simulation import Simulation
from tests.physics.tumbler import column_names, model, tumble

QPOS = column_names()["qpos"]
FIELDS = state.fields(state.sizes(model()))
ROWS = np.arange(0, 501, 10)  # 50 Hz
MAP = (
    "time=t_ms/1000",
    *("qpos/root=pelvis", "qpos/neck=head"),
    *("qpos/hip=hip_deg*pi/180", "qpos/lift='lift [cm]'/100"),
)


def read(path: Path, *texts: str, quat: str = "wxyz", rate: Fraction | None = None) -> KinematicMotion:
    return read_motion(path, model(), mujoco.MjData(model()), texts, quat, rate)


def positions(motion: KinematicMotion, steps: np.ndarray = ROWS) -> np.ndarray:
    return np.array([motion.state(int(step))[FIELDS["qpos"]] for step in steps])


def xyzw(quaternions: np.ndarray) -> np.ndarray:
    """As scipy would write them: the scalar last and never negative, so that they jump from sign to sign."""
    return Rotation.from_quat(quaternions, scalar_first=True).as_quat(canonical=True)


def foreign(rows: np.ndarray = ROWS) -> pd.DataFrame:
    """Returns a log with other names and units: degrees, centimetres, milliseconds, quaternions xyzw."""
    qpos = tumble().qpos[rows]
    table = pd.DataFrame({"frame": np.arange(len(rows)), "t_ms": 2.0 * rows})
    table[[f"pelvis_{i}" for i in range(7)]] = np.c_[qpos[:, :3], xyzw(qpos[:, 3:7])]
    table["hip_deg"] = np.degrees(qpos[:, 7])
    table[[f"head/{i}" for i in range(4)]] = xyzw(qpos[:, 8:12])
    table["lift [cm]"] = 100 * qpos[:, 12]
    table["operator"] = "Ann"
    return table


def test_the_oracle_has_quaternions_that_jump() -> None:
    for names in ([f"pelvis_{i}" for i in range(3, 7)], [f"head/{i}" for i in range(4)]):
        turned = foreign()[names].to_numpy()
        assert ((turned[1:] * turned[:-1]).sum(axis=1) < 0).any()


def test_a_csv_in_degrees_with_xyzw_quaternions_and_gaps_has_the_true_states_at_its_samples(tmp_path: Path) -> None:
    table = foreign()
    table.loc[12:17, "hip_deg"] = np.nan  # empty cells
    table.loc[30:33, [f"head/{i}" for i in range(4)]] = np.nan
    table = table.drop(index=[5, 6, 40])  # missing rows
    table.to_csv(tmp_path / "log.csv", index=False)
    motion = read(tmp_path / "log.csv", *MAP, quat="xyzw")
    result, truth = positions(motion), tumble().qpos[ROWS]
    parts = [([*range(7), 12], []), ([7], range(12, 18)), ([*range(8, 12)], range(30, 34))]
    for indices, empty in parts:
        whole = np.setdiff1d(np.arange(51), [5, 6, 40, *empty])
        assert abs(result[np.ix_(whole, indices)] - truth[np.ix_(whole, indices)]).max() < 1e-9
    assert result[14, 7] == pytest.approx(np.interp(14, [11, 18], truth[[11, 18], 7]), abs=1e-9)
    assert any("3 gaps" in text or "4 gaps" in text for text in motion.remarks)
    assert any("the longest in qpos/hip of 0.14 s from 0.22 s on; interpolated" in text for text in motion.remarks)


def test_a_csv_that_states_its_units_needs_no_map(tmp_path: Path) -> None:
    run, path = tumble(), tmp_path / "log.csv"
    table = pd.DataFrame(run.qpos[ROWS], columns=QPOS).assign(time=2.0 * ROWS)
    table["qpos/hip"], table["qpos/lift"] = np.degrees(table["qpos/hip"]), 100 * table["qpos/lift"]
    units = {"time": "ms", "qpos/hip": "deg", "qpos/lift": "cm", "qpos/root/x": "m"}
    header, *rows = table.to_csv(index=False).splitlines()
    comment = f"# units: {','.join(units.get(name, '') for name in table.columns)}"
    path.write_text("\n".join([header, comment, *rows]))
    assert abs(positions(read(path)) - run.qpos[ROWS]).max() < 1e-9
    by_hand = read(path, "time=time+0", "qpos/hip=qpos/hip*1")  # an expression uses the numbers of the file
    assert by_hand.state(0)[FIELDS["qpos"]][7] == table["qpos/hip"][0]


@pytest.mark.parametrize(
    ("column", "unit", "wanted"),
    [("qpos/hip", "mm", "rad"), ("qpos/lift", "deg", "m"), ("qpos/hip", "rad/s", "rad"), ("time", "m", "s")],
)
def test_a_unit_of_another_quantity_is_refused(tmp_path: Path, column: str, unit: str, wanted: str) -> None:
    path = tmp_path / "log.csv"
    table = pd.DataFrame(tumble().qpos[ROWS], columns=QPOS).assign(time=0.002 * ROWS)
    header, *rows = table.to_csv(index=False).splitlines()
    comment = f"# units: {','.join(unit if name == column else '' for name in table.columns)}"
    path.write_text("\n".join([header, comment, *rows]))
    with pytest.raises(UsageError) as error:
        read(path)
    assert f"column {column} is in {unit}, and {column} of the model in {wanted}\n" in str(error.value)
    read(path, f"{column}={column}*1")  # an expression uses the numbers of the file


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "parquet", "feather"])
def test_empty_cells_nulls_and_nans_are_gaps_in_every_format(tmp_path: Path, suffix: str) -> None:
    table = foreign()
    table.loc[12:17, "hip_deg"] = np.nan
    path = tmp_path / f"log.{suffix}"
    save: dict[str, Callable[[], object]] = {
        "csv": lambda: table.to_csv(path, index=False),
        "jsonl": lambda: table.to_json(path, orient="records", lines=True, double_precision=15),
        "parquet": lambda: table.to_parquet(path),
        "feather": lambda: table.to_feather(path),
    }
    save[suffix]()
    result = positions(read(path, *MAP, quat="xyzw"))
    kept = np.delete(np.arange(51), range(12, 18))
    assert abs(result[kept] - tumble().qpos[ROWS][kept]).max() < 1e-9


def save_h5(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file[name] = array


ARRAYS: dict[str, Callable[[Path, dict[str, np.ndarray]], object]] = {
    "npz": lambda path, arrays: np.savez(path, **arrays),  # type: ignore[arg-type]
    "h5": save_h5,
    "mat": lambda path, arrays: scipy.io.savemat(path, arrays),
}


@pytest.mark.parametrize("suffix", ARRAYS)
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_of_positions_and_velocities_are_what_they_are_called(tmp_path: Path, suffix: str, order: Any) -> None:
    run, path = tumble(), tmp_path / f"run.{suffix}"
    arrays = {"time": run.time[ROWS], "qpos": np.asarray(run.qpos[ROWS], order=order), "qvel": run.qvel[ROWS]}
    ARRAYS[suffix](path, {**arrays, "ctrl": run.ctrl[ROWS], "frames": np.zeros((51, 2, 2, 3), np.uint8)})
    motion = read(path)
    for step in ROWS:
        numbers = motion.state(int(step))
        for name in ("qpos", "qvel", "ctrl"):
            assert numbers[FIELDS[name]].tobytes() == np.ascontiguousarray(getattr(run, name)[step]).tobytes()
    assert motion.has_controls
    assert motion.remarks == [f"{path} lacks mocap: as in the initial state"]
    assert motion.note == f"{path}: act as in the initial state"


@pytest.mark.parametrize("suffix", ARRAYS)
def test_arrays_in_other_names_and_orders_are_put_side_by_side(tmp_path: Path, suffix: str) -> None:
    qpos, path = tumble().qpos[ROWS], tmp_path / f"amp.{suffix}"
    arrays = {
        "root_pos": qpos[:, :3],
        "root_rot": xyzw(qpos[:, 3:7]),
        "dof": qpos[:, [7, 12]],
        "head": xyzw(qpos[:, 8:12]),
    }
    ARRAYS[suffix](path, arrays)
    texts = ("qpos/root=root_pos,root_rot", "qpos/hip=dof/0", "qpos/lift=dof/1", "qpos/neck=head")
    motion = read(path, *texts, quat="xyzw", rate=Fraction(50))
    assert abs(positions(motion) - tumble().qpos[ROWS]).max() < 1e-14


def test_a_trace_of_ours_needs_no_map(tmp_path: Path) -> None:
    run = tumble()
    pd.DataFrame(np.c_[run.time, run.qpos], columns=["time", *QPOS]).to_parquet(tmp_path / "t.parquet")
    motion = read(tmp_path / "t.parquet")
    assert positions(motion, np.arange(501)).tobytes() == run.qpos.tobytes()


def test_a_rate_stands_for_times_that_are_not_there(tmp_path: Path) -> None:
    foreign().to_csv(tmp_path / "log.csv", index=False)
    motion = read(tmp_path / "log.csv", *MAP[1:], quat="xyzw", rate=Fraction(50))
    assert motion.steps == range(501)
    assert abs(positions(motion) - tumble().qpos[ROWS]).max() < 1e-9
    assert read(tmp_path / "log.csv", *MAP[1:], rate=Fraction("30000/1001")).steps[-1] == int(50 * 1.001 / 30 / 0.002)


def csv(**columns: Any) -> Callable[[], bytes]:
    return lambda: pd.DataFrame(columns).to_csv(index=False).encode()


@dataclass(frozen=True)
class Bad:
    """A table, a map, and the error that they cause."""

    content: Callable[[], bytes]
    message: str
    texts: tuple[str, ...] = ()
    kind: type[MjrunError] = UsageError
    rate: Fraction | None = None


@pytest.mark.parametrize(
    "bad",
    [
        Bad(csv(**{"qpos/hip": [1, 2]}), r"has no column 'time'\nmap specifies the time, or replay_rate the number"),
        Bad(csv(**{"qpos/hip": [1], "t": [0]}), r"has no column 'time'\nmap specifies the time, as in time=t, or"),
        Bad(csv(**{"qpos/hip": [1], "time": [0]}), r"has a column 'time', and replay_rate is for", rate=Fraction(1)),
        Bad(csv(time=[0.0, 1], x=[1, 2]), r"t\.csv has no positions of this model\nit has time, x\n"),
        Bad(lambda: b"", r"t\.csv: is empty: a table begins with", kind=FileError),
        Bad(csv(**{"time": [], "qpos/hip": []}), r"t\.csv: has no rows$", kind=FileError),
        Bad(lambda: b"time,qpos/hip\n0,1\n1\n", r"t\.csv:3: expected 2 cells", kind=FileError),
        Bad(lambda: b"time,qpos/hip,qpos/hip\n0,1,2\n", r"two columns are called 'qpos/hip'", kind=FileError),
        Bad(lambda: b"time,qpos/hip\n0,up\n", r"t\.csv:2: column 'qpos/hip': 'up' is not a number", kind=FileError),
        Bad(
            csv(**{"time": [0, 1], "qpos/hip": [None, 1]}),
            r"row 0: qpos/hip is missing \(empty or nan\).*\n.* begins in row 1",
        ),
        Bad(csv(**{"time": [0, None], "qpos/hip": [1, 1]}), r"t\.csv, row 1: time is nan; it must be finite"),
        Bad(csv(**{"time": [0, 2, 1], "qpos/hip": [1, 1, 1]}), r"t\.csv, row 2: time 1 follows 2; times must ascend"),
        Bad(csv(time=[0], a=[0]), r"row 0: qpos/hip is infinite", texts=("qpos/hip=1/a",)),
    ],
)
def test_tables_that_are_no_motions_are_refused(tmp_path: Path, bad: Bad) -> None:
    (tmp_path / "t.csv").write_bytes(bad.content())
    with pytest.raises(bad.kind, match=bad.message) as caught:
        read(tmp_path / "t.csv", *bad.texts, rate=bad.rate)
    assert caught.value.exit_code == (7 if bad.kind is FileError else 2)


def test_arrays_of_unequal_lengths_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", time=np.arange(5.0), qpos=np.zeros((4, 13)))
    with pytest.raises(FileError, match=r"columns differ in rows: 'time' 5 and 'qpos/0' 4"):
        read(tmp_path / "t.npz")


def test_a_constant_is_an_expression_too(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("n\n1\n2\n")
    motion = read(tmp_path / "t.csv", "qpos/hip=0.5", rate=Fraction(500))
    assert [motion.state(step)[FIELDS["qpos"]][7] for step in (0, 1)] == [0.5, 0.5]


def test_recordings_are_reported_from_tables_by_what_is_in_them(tmp_path: Path) -> None:
    Recording(Simulation(model(), steps=3), f"{tmp_path}/r.npz").run()
    np.savez(tmp_path / "t.npz", time=np.zeros(1), states=np.zeros(1))
    (tmp_path / "broken.npz").write_bytes(b"PK")
    (tmp_path / "t.csv").write_text("time\n")
    (tmp_path / "r.bin").write_bytes((tmp_path / "r.npz").read_bytes())
    names = ("r.npz", "r.bin", "broken.npz", "none.npz", "t.npz", "t.csv", "none.csv")
    assert [is_recording(tmp_path / name) for name in names] == [True, True, True, True, False, False, False]


DRIVEN = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody><body><joint name="a"/><joint name="b" axis="0 1 0"/><geom size=".1"/></body></worldbody>
  <actuator><motor name="m" joint="a"/><motor name="g" joint="b"/></actuator>
</mujoco>
""")
GOOD = {"time": [0.0, 1.0], "ctrl/m": [0.0, 0.0], "ctrl/g": [2.0, 3.0]}


def controls(path: Path, columns: dict[str, list[float]], constants: dict[str, list[int]] | None = None) -> np.ndarray:
    """Returns the controls of the steps at 0 s and at 1 s; actuators without a column have 7."""
    pd.DataFrame(columns).to_csv(path, index=False)
    ctrl = np.full((2, 2), 7.0)
    read_controls(path, DRIVEN, "t.csv", constants or {}, linear=False).apply(ctrl, 0, Fraction(1))
    return ctrl


def test_controls_are_read_by_name_or_by_number(tmp_path: Path) -> None:
    expected = [[0, 2], [0, 3]]
    assert controls(tmp_path / "t.csv", {**GOOD, "else": [9.0, 9.0]}).tolist() == expected
    for names in (("ctrl/0", "ctrl/1"), ("ctrl_1", "ctrl_2"), ("ctrl[0]", "ctrl[1]")):
        numbered = dict(zip(("time", *names), GOOD.values(), strict=True))
        assert controls(tmp_path / "t.csv", numbered).tolist() == expected


@pytest.mark.parametrize("names", [("m", "g"), ("a", "b"), ("m", "b"), ("ctrl/m", "b"), ("m [rad]", "ctrl/g")])
def test_controls_may_be_named_after_their_actuators_or_joints(tmp_path: Path, names: tuple[str, str]) -> None:
    renamed = dict(zip(("time", *names), GOOD.values(), strict=True))
    assert controls(tmp_path / "t.csv", {**renamed, "else": [9.0, 9.0]}).tolist() == [[0, 2], [0, 3]]


def test_units_in_headers_are_converted(tmp_path: Path) -> None:
    """As a table without units that holds the same motion, also of joints of several numbers and of the time."""
    qpos, rows = tumble().qpos[ROWS], 2.0 * ROWS
    table = pd.DataFrame({"time [ms]": rows})
    table[[f"qpos/root/{axis} [mm]" for axis in "xyz"]] = 1000 * qpos[:, :3]
    table[[f"qpos/root/q{axis}" for axis in "wxyz"]] = qpos[:, 3:7]
    table["qpos/hip [deg]"] = np.degrees(qpos[:, 7])
    table[[f"qpos/neck/q{axis}" for axis in "wxyz"]] = qpos[:, 8:12]
    table["qpos/lift [m]"] = qpos[:, 12]
    table.to_csv(tmp_path / "log.csv", index=False)
    np.testing.assert_allclose(positions(read(tmp_path / "log.csv")), qpos, atol=1e-12)
    renamed = table.rename(columns={"qpos/hip [deg]": "angle [deg]"})
    renamed.to_csv(tmp_path / "log.csv", index=False)
    for text in ("qpos/hip='angle [deg]'", "qpos/hip='angle [deg]'*pi/180"):
        np.testing.assert_allclose(positions(read(tmp_path / "log.csv", text)), qpos, atol=1e-12)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_times_in_every_unit_are_converted_by_header_and_refused_by_name_alone(tmp_path: Path, unit: str) -> None:
    seconds = np.array([0.0, 0.25, 1.5])
    numbers = seconds * {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    for name, text in ((f"t [{unit}]", f"time='t [{unit}]'"), (f"t_{unit}", f"time=t_{unit}")):
        table = pd.DataFrame({name: numbers, "qpos/lift": seconds})
        table.to_csv(tmp_path / "log.csv", index=False)
        if unit != "s" and "_" in name:
            with pytest.raises(UsageError, match=f"column {name} seems to be in {unit}"):
                read(tmp_path / "log.csv", text)
        else:
            motion = read(tmp_path / "log.csv", text)
            lift = [motion.state_at(each)[FIELDS["qpos"]][12] for each in seconds.tolist()]
            np.testing.assert_allclose(lift, seconds, rtol=1e-9)


def test_units_in_parentheses_are_converted_like_those_in_brackets(tmp_path: Path) -> None:
    qpos, times = tumble().qpos[ROWS], 2.0 * ROWS
    names = ("Time (ms)", "Hip (°)", "qpos/lift (mm)", "lift (left)")
    columns = (times, np.degrees(qpos[:, 7]), 1000 * qpos[:, 12], qpos[:, 12])
    pd.DataFrame(dict(zip(names, columns, strict=True))).to_csv(tmp_path / "log.csv", index=False)
    for lift in ((), ("qpos/lift='lift (left)'",)):  # a remark is not a unit
        motion = read(tmp_path / "log.csv", "time='Time (ms)'", "qpos/hip='Hip (°)'", *lift)
        np.testing.assert_allclose(positions(motion)[:, [7, 12]], qpos[:, [7, 12]], atol=1e-12)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            ["time=t_ms"],
            r"column t_ms seems to be in ms, and time of the model is in s\nmap .* time=t_ms/1000, .*: time=t_ms\+0",
        ),
        (["time=t_ms/1000", "qpos/hip=hip_deg"], r"to be in deg, and qpos/hip .* in rad\n.* qpos/hip=hip_deg\*pi/180,"),
    ],
)
def test_an_unchanged_column_whose_name_ends_in_another_unit_is_refused(
    tmp_path: Path, texts: list[str], message: str
) -> None:
    """Numbers that are degrees would be a plausible motion in radians."""
    foreign().to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(UsageError, match=message):
        read(tmp_path / "log.csv", *texts, "qpos/lift='lift [cm]'")


def test_an_expression_reads_numbers_whatever_the_name_ends_in(tmp_path: Path) -> None:
    foreign().to_csv(tmp_path / "log.csv", index=False)
    motion = read(tmp_path / "log.csv", "time=t_ms/1000", "qpos/hip=hip_deg+0")
    np.testing.assert_allclose(positions(motion)[:, 7], np.degrees(tumble().qpos[ROWS, 7]), atol=1e-12)


def test_a_map_in_the_wrong_direction_is_suggested_in_the_right_one(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,Hip (deg)\n0,1\n1,2\n")
    with pytest.raises(UnknownNameError, match=r"did you mean .*qpos/hip='Hip \(deg\)'"):
        read(tmp_path / "log.csv", "Hip (deg)=qpos/hip")


def test_an_unknown_unit_is_refused_with_those_that_are_known(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,qpos/lift [furlong]\n0,1\n1,2\n")
    with pytest.raises(UsageError, match=r"\[furlong\] is in an unknown unit, 'furlong'\nunits .*: s, ms, .*, mm, .*"):
        read(tmp_path / "log.csv")
    assert positions(read(tmp_path / "log.csv", "qpos/lift='qpos/lift [furlong]'*201.168"), ROWS[:1])[0, 12] == 201.168


@pytest.mark.parametrize("name", ["g [deg]", "b [deg]", "ctrl/g [deg]", "b [°]"])
def test_controls_in_degrees_are_converted(tmp_path: Path, name: str) -> None:
    columns = {"time": [0.0, 1.0], "m": [0.0, 0.0], name: [90.0, -180.0]}
    assert np.allclose(controls(tmp_path / "t.csv", columns), [[0, np.pi / 2], [0, -np.pi]], rtol=1e-15)


def test_a_full_name_precedes_that_of_an_actuator_and_that_of_its_joint(tmp_path: Path) -> None:
    columns = {"time": [0.0], "b": [1.0], "g": [2.0], "ctrl/g": [3.0], "a": [4.0], "m": [5.0]}
    assert controls(tmp_path / "t.csv", columns)[0].tolist() == [5, 3]


def test_a_joint_of_two_actuators_names_neither(tmp_path: Path) -> None:
    text = (
        '<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody><actuator>{}</actuator></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(
        text.format('<motor name="m" joint="a"/><damper name="d" joint="a" kv="1" ctrlrange="0 1"/>')
    )
    (tmp_path / "t.csv").write_text("time,a\n0,1\n")
    with pytest.raises(
        UsageError, match=r"lacks columns .*: ctrl/m, ctrl/d\nit has time, a; a column may also be named"
    ):
        read_controls(tmp_path / "t.csv", model, "t.csv", {}, linear=False)


def test_actuators_without_a_column_keep_their_control(tmp_path: Path) -> None:
    columns = {"time": [0.0], "ctrl/g": [1.0]}
    assert controls(tmp_path / "t.csv", columns, {"m": [0]}).tolist() == [[7, 1]] * 2
    assert controls(tmp_path / "t.csv", columns, {"*": [0, 1]}).tolist() == [[7, 1]] * 2


@pytest.mark.parametrize(
    ("columns", "kind", "message"),
    [
        ({**GOOD, "ctrl/q": [0.0, 0.0]}, UnknownNameError, "no actuator 'q' in the columns of t.csv"),
        (
            {k: v for k, v in GOOD.items() if k != "ctrl/g"},
            UsageError,
            "t.csv lacks columns for actuators of the model: ctrl/g",
        ),
        ({"time": [0.0]}, UsageError, "lacks columns for actuators of the model: ctrl/m, ctrl/g"),
        ({k: v for k, v in GOOD.items() if k != "time"}, UsageError, "has no column 'time'"),
        ({"time": [0.0], "ctrl/0": [0.0]}, UsageError, "has 1 columns ctrl/0 … ctrl/0, and ctrl of this model has 2"),
    ],
)
def test_controls_that_do_not_fit_are_refused(
    tmp_path: Path, columns: dict[str, list[float]], kind: type, message: str
) -> None:
    with pytest.raises(kind, match=message):
        controls(tmp_path / "t.csv", columns)


def test_a_file_of_lines_that_is_too_long_in_bytes_is_refused_not_cut(tmp_path: Path) -> None:
    path = tmp_path / "columns.txt"
    comment = f"# {'é' * 500}\n"
    path.write_text(comment * (LARGEST // len(comment.encode()) + 1) + "qpos/knee=knee\n", "utf-8")
    with pytest.raises(UsageError, match="is not a file of lines"):
        list(map_entries(f"@{path}"))


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".h5"])
def test_a_field_of_one_number_is_a_column_with_its_name(tmp_path: Path, suffix: str) -> None:
    arm = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='hip'/><geom size='.1'/></body><body mocap='true'/></worldbody>"
        "<actuator><motor name='drive' joint='hip'/></actuator></mujoco>"
    )
    path, n = tmp_path / f"arm{suffix}", 4
    angles, drives = np.linspace(0.5, 2, n), np.linspace(-1, 1, n)
    arrays = {"time": np.arange(n) * 0.1, "qpos": angles[:, None], "qvel": -angles[:, None], "ctrl": drives[:, None]}
    mocap = np.ones((n, 3))
    match suffix:
        case ".csv":
            pd.DataFrame({name: array.ravel() for name, array in arrays.items()}).to_csv(path, index=False)
        case ".npz":
            np.savez(path, mocap_pos=mocap, **arrays)
        case ".mat":
            scipy.io.savemat(path, {"mocap_pos": mocap, **arrays})
        case _:
            with h5py.File(path, "w") as file:
                for name, array in {"mocap_pos": mocap, **arrays}.items():
                    file[name] = array

    motion = read_motion(path, arm, mujoco.MjData(arm))
    fields = state.fields(state.sizes(arm))
    states = np.array([motion.state(50 * row) for row in range(n)])
    assert states[:, fields["qpos"]].ravel().tolist() == angles.tolist()
    assert states[:, fields["qvel"]].ravel().tolist() == (-angles).tolist()
    assert states[:, fields["ctrl"]].ravel().tolist() == drives.tolist()
    table = read_controls(path, arm, "arm", {}, linear=False)
    applied = np.empty((151, 1))
    table.apply(applied, 0, Fraction(2, 1000))
    assert applied[::50].ravel().tolist() == drives.tolist()


def test_a_degree_sign_of_a_spreadsheet_that_does_not_write_utf_8_is_one_too(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes("time,qpos/hip [°]\n0,90\n0.1,180\n".encode("cp1252"))
    assert positions(read(tmp_path / "log.csv"), np.array([0, 50]))[:, 7] == pytest.approx([np.pi / 2, np.pi])


@pytest.mark.parametrize("name", ["ctrl/drive", "drive", "hip"])
def test_controls_in_two_units_are_refused(tmp_path: Path, name: str) -> None:
    arm = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='hip'/><geom size='.1'/></body></worldbody>"
        "<actuator><position name='drive' joint='hip'/></actuator></mujoco>"
    )
    (tmp_path / "log.csv").write_text(f"time,{name} [deg],{name} [rad]\n0,90,1\n")
    with pytest.raises(UsageError, match=rf"both {name} \[deg\] and {name} \[rad\]\nremove one"):
        read_controls(tmp_path / "log.csv", arm, "log.csv", {}, linear=False)


@pytest.mark.parametrize(
    ("ball", "hinge"), [("name='leg'", "name='leg{}'"), ("name='leg_'", "name='leg_{}'"), ("", "")]
)
def test_names_of_joints_that_end_in_numbers_are_not_numbers_of_another(tmp_path: Path, ball: str, hinge: str) -> None:
    bodies = [f"<joint {hinge.format(i)}/>" for i in range(12)]
    bodies[1:1] = [f"<joint {ball} type='ball'/>"]  # joint:1 without names, beside joint:10 and others
    xml = "".join(f"<body>{joint}<geom size='.1'/></body>" for joint in bodies)
    legs = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
    names = [column.name for column in field_probe(legs, "qpos").columns]
    rows = np.tile(np.linspace(0.1, 1, 16), (3, 1))
    rows[:, 1:5] = [0.6, 0.8, 0, 0]
    table = pd.DataFrame({"time": [0, 0.1, 0.2], **dict(zip(names, rows.T, strict=True))})
    table.to_csv(tmp_path / "legs.csv", index=False)
    motion = read_motion(tmp_path / "legs.csv", legs, mujoco.MjData(legs))
    assert motion.state(50)[state.fields(state.sizes(legs))["qpos"]].tolist() == rows[1].tolist()


def test_arrays_of_many_mocap_bodies_are_read(tmp_path: Path) -> None:
    bodies = "<body mocap='true'/>" * 12
    stage = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    places = np.arange(72.0).reshape(2, 36)
    turns = Rotation.random(24, random_state=0).as_quat(scalar_first=True).reshape(2, 48)
    np.savez(tmp_path / "stage.npz", time=[0.0, 0.1], mocap_pos=places, mocap_quat=turns)
    motion = read_motion(tmp_path / "stage.npz", stage, mujoco.MjData(stage))
    fields = state.fields(state.sizes(stage))
    assert motion.state(50)[fields["mocap_pos"]].tolist() == places[1].tolist()
    turned = Rotation.from_quat(motion.state(50)[fields["mocap_quat"]].reshape(12, 4), scalar_first=True)
    expected = Rotation.from_quat(turns[1].reshape(12, 4), scalar_first=True)
    assert (turned.inv() * expected).magnitude().max() < 1e-7
