"""What tables say of a model, and the controls that a log commands."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import BadValueError, FileError, MjrunError, UsageError
from mjrun.fitting.measurements import LogSegment, Measurements, commands, read_measurements, set_noise
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.sources import parse_source
from mjrun.model.table_column import Column
from tests.fitting.logs import write_log, write_model

TIMES = np.arange(40) * 0.01


def read(folder: Path, columns: dict[str, np.ndarray], texts: tuple[str, ...] = ()) -> Measurements:
    model = parse_source(str(write_model(folder))).load()
    return read_measurements([str(write_log(folder / "log.csv", columns))], model, texts, np.zeros(1))


def test_columns_count_by_name_or_by_a_map(tmp_path: Path) -> None:
    angles = np.sin(TIMES)
    named = read(tmp_path, {"time": TIMES, "qpos/hinge": angles, "ctrl/motor": TIMES, "else": angles})
    mapped = read(tmp_path, {"t": TIMES, "deg": np.degrees(angles)}, ("time=t", "qpos/hinge=deg*pi/180"))
    assert named.signals == mapped.signals == ["qpos/hinge"]
    np.testing.assert_allclose(mapped.segments[0].values, named.segments[0].values, rtol=1e-15)
    assert named.segments[0].controls[:, 0].tolist() == TIMES.tolist()
    assert not mapped.segments[0].controls.any()
    assert (named.commands, mapped.commands) == ({"motor"}, set())


def test_columns_that_have_no_effect_are_reported(tmp_path: Path) -> None:
    found = read(tmp_path, {"time": TIMES, "angle": TIMES, "ctrl/moto": TIMES, "else": TIMES}, ("qpos/hinge=angle",))
    assert found.remarks == [f"{tmp_path}/log.csv: unused columns: ctrl/moto, else"]


def test_standard_input_is_refused(tmp_path: Path) -> None:
    model = parse_source(str(write_model(tmp_path))).load()
    with pytest.raises(UsageError, match="read more than once, which standard input does not allow"):
        read_measurements(["-"], model, (), np.zeros(1))


def test_units_in_headers_are_converted(tmp_path: Path) -> None:
    angles = np.sin(TIMES)
    named = read(tmp_path, {"time": TIMES, "qpos/hinge": angles, "ctrl/motor": TIMES})
    headed = {"time [ms]": 1000 * TIMES, "qpos/hinge [deg]": np.degrees(angles), "ctrl/motor [N·m]": TIMES}
    found = read(tmp_path, headed)
    assert found.signals == named.signals
    for one, other in zip(found.segments, named.segments, strict=True):
        np.testing.assert_allclose(one.times, other.times, rtol=1e-15)
        np.testing.assert_allclose(one.values, other.values, rtol=1e-15)
        np.testing.assert_allclose(one.controls, other.controls, rtol=1e-15)
    with pytest.raises(UsageError, match="unknown unit, 'grad'"):
        read(tmp_path, {"time": TIMES, "qpos/hinge [grad]": angles})


def test_gaps_split_a_log(tmp_path: Path) -> None:
    times = np.concatenate([TIMES, TIMES + 1, TIMES[:5] + 2])
    found = read(tmp_path, {"time": times, "qpos/hinge": np.sin(times)})
    assert [len(segment.times) for segment in found.segments] == [40, 40]
    assert "split it into 3 segments; skipped 1 with fewer than 16 rows" in found.remarks[0]


def test_missing_samples_are_passed_over_and_told(tmp_path: Path) -> None:
    angles = np.sin(TIMES)
    angles[7] = np.nan
    found = read(tmp_path, {"time": TIMES, "qpos/hinge": angles})
    assert np.flatnonzero(np.isnan(found.segments[0].values[:, 0])).tolist() == [7]
    assert "1 sample missing" in found.remarks[0]


def test_a_log_of_several_rates_holds_commands_and_knows_none_before_the_first(tmp_path: Path) -> None:
    """Commands in every fourth row, from the third on: as pandas fills them forward."""
    commanded = np.where(np.arange(40) % 4 == 2, np.sin(TIMES), np.nan)
    columns = {"time": TIMES, "qpos/hinge": np.cos(TIMES), "ctrl/motor": commanded}
    (segment,) = read(tmp_path, columns).segments
    np.testing.assert_array_equal(segment.controls[:, 0], pd.Series(commanded).ffill()[2:])
    np.testing.assert_array_equal(segment.times, TIMES[2:])
    remarks = read(tmp_path, columns).remarks
    assert "30 commands missing and replaced by the one before" in remarks[0]
    assert "skipped the 2 rows before the first command" in remarks[1]
    model = parse_source(str(write_model(tmp_path))).load()
    linear = read_measurements([str(tmp_path / "log.csv")], model, (), np.zeros(1), linear=True).segments[0]
    known = np.isfinite(commanded)
    np.testing.assert_allclose(linear.controls[:, 0], np.interp(TIMES[2:], TIMES[known], commanded[known]))


@pytest.mark.parametrize("suffix", ["parquet", "npz", "h5", "mat", "jsonl", "feather"])
def test_a_log_of_another_simulator_in_any_format(tmp_path: Path, suffix: str) -> None:
    """Its joint, its units and its clock are others."""
    angles, torques = np.sin(TIMES), np.cos(TIMES)
    columns = [Column("stamp_ms"), Column("Revolute_1"), Column("tau")]
    path = str(tmp_path / f"log.{suffix}")
    with TableWriter(path, output_format(path).name, columns) as writer:
        writer.write(np.column_stack([1000 * TIMES, np.degrees(angles), 1000 * torques]))
        writer.publish()
    texts = ("time=stamp_ms/1000", "qpos/hinge=Revolute_1*pi/180", "ctrl/motor=tau/1000")
    model = parse_source(str(write_model(tmp_path))).load()
    (segment,) = read_measurements([path], model, texts, np.zeros(1)).segments
    np.testing.assert_allclose(segment.times, TIMES, atol=1e-12)
    np.testing.assert_allclose(segment.values[:, 0], angles, atol=1e-12)
    np.testing.assert_allclose(segment.controls[:, 0], torques, atol=1e-12)


def test_milliseconds_that_are_taken_for_seconds_are_refused_unless_confirmed(tmp_path: Path) -> None:
    columns = {"time": 1000 * TIMES, "qpos/hinge": np.sin(TIMES)}
    with pytest.raises(UsageError, match=r"rows are 10 s apart, 5,000 timesteps(.|\n)*time=time/1000"):
        read(tmp_path, columns)
    model = parse_source(str(write_model(tmp_path))).load()
    log = str(write_log(tmp_path / "log.csv", columns))
    (segment,) = read_measurements([log], model, ["time=time"], np.zeros(1)).segments
    assert segment.times[-1] == 1000 * TIMES[-1]


def test_a_rotation_that_turns_about_one_axis_is_kept_as_a_whole(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(
        '<mujoco><worldbody><body><joint name="b" type="ball"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    model = parse_source(str(tmp_path / "ball.xml")).load()
    columns = {"time": TIMES, "qpos/b/qw": np.cos(TIMES), "qpos/b/qx": 0 * TIMES, "qpos/b/qy": 0 * TIMES}
    log = str(write_log(tmp_path / "log.csv", columns))
    with pytest.raises(UsageError, match="qpos/b/qz of the rotation qpos/b must be measured too"):
        read_measurements([log], model, (), np.zeros(0))
    write_log(tmp_path / "log.csv", columns | {"qpos/b/qz": np.sin(TIMES)})
    found = read_measurements([log], model, (), np.zeros(0))
    assert found.signals == [f"qpos/b/q{c}" for c in "wxyz"]
    assert found.rotations == [[0, 1, 2, 3]]


def test_rows_before_the_first_command_do_not_count(tmp_path: Path) -> None:
    commanded = np.where(np.arange(len(TIMES)) < len(TIMES) - 9, np.nan, 1.0)
    with pytest.raises(FileError, match="no 16 consecutive rows without a gap after its first command"):
        read(tmp_path, {"time": TIMES, "qpos/hinge": np.sin(TIMES), "ctrl/motor": commanded})


@pytest.mark.parametrize("text", ["0", "-1", "1e-300", "inf", "nan", "small"])
def test_a_noise_that_cannot_be_divided_by_is_refused(text: str) -> None:
    with pytest.raises(BadValueError, match="a standard deviation above 1e-12"):
        set_noise([("qpos/*", text)], ["qpos/hinge"])


def test_signals_that_never_change_are_left_out(tmp_path: Path) -> None:
    found = read(tmp_path, {"time": TIMES, "qpos/hinge": np.sin(TIMES), "qvel/hinge": 0 * TIMES})
    assert found.signals == ["qpos/hinge"]
    assert found.remarks == ["constant, so left out: qvel/hinge"]
    with pytest.raises(UsageError, match="nothing varies"):
        read(tmp_path, {"time": TIMES, "qpos/hinge": 0 * TIMES})


def test_signals_that_refer_to_the_start_of_a_log_are_left_out(tmp_path: Path) -> None:
    found = read(tmp_path, {"time": TIMES, "energy/drift": TIMES, "energy/total": TIMES})
    assert found.signals == ["energy/total"]
    assert found.remarks == ["measured from the start of the log, so left out: energy/drift"]


def test_the_last_part_of_the_time_is_held_out(tmp_path: Path) -> None:
    times = np.arange(100) * 0.01
    first, last = read(tmp_path, {"time": times, "qpos/hinge": np.sin(times)}).split(0.2)
    assert first.segments[0].times[-1] < last.segments[0].times[0]
    assert (first.rows, last.rows) == (80, 20)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t": TIMES, "qpos/hinge": TIMES}, "no column 'time'\n.*time=t"),
        ({"time": TIMES, "knee": TIMES}, "measures nothing of this model"),
        ({"time": np.append(TIMES[:-1], TIMES[-2]), "qpos/hinge": TIMES}, "times must ascend"),
        ({"time": TIMES[:10], "qpos/hinge": TIMES[:10]}, "no 16 consecutive rows"),
        ({"time": TIMES, "qpos/hinge": np.append(TIMES[:-1], np.inf)}, "row 39: qpos/hinge is infinite"),
        (
            {"time": TIMES, "qpos/hinge": TIMES, "ctrl/motor": np.append(TIMES[:-1], np.inf)},
            "row 39: ctrl/motor is inf",
        ),
        ({"time": TIMES, "qpos/hinge": TIMES, "ctrl/motor": np.nan * TIMES}, "ctrl/motor has no command in any row"),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, columns: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(MjrunError, match=message):
        read(tmp_path, columns)


def test_a_map_that_names_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no column 'qpos/hing'.*did you mean 'qpos/hinge'"):
        read(tmp_path, {"time": TIMES, "deg": TIMES}, ("qpos/hing=deg",))


def segment() -> LogSegment:
    """Commands at odd times: 1 from 0 s, 3 from 0.011 s, 2 from 0.02 s on."""
    times = np.array([0.0, 0.011, 0.02])
    return LogSegment("log", times, np.zeros((3, 1)), np.array([[1.0], [3.0], [2.0]]))


def test_commands_hold_until_the_next(tmp_path: Path) -> None:
    held = commands(segment(), 0, 12, 0.002, False, {})[:, 0]
    assert held.tolist() == [1] * 6 + [3] * 4 + [2] * 2


def test_commands_go_in_straight_lines_where_asked(tmp_path: Path) -> None:
    linear = commands(segment(), 0, 12, 0.002, True, {})[:, 0]
    np.testing.assert_allclose(linear, np.interp(np.arange(12) * 0.002, [0, 0.011, 0.02], [1, 3, 2]), rtol=1e-12)


@pytest.mark.parametrize("linear", [False, True])
def test_a_delay_of_whole_steps_moves_commands(linear: bool) -> None:
    """What acts during a step is the mean of the delayed signal over it, here by a fine sum."""
    delay, timestep, fine = 0.0043, 0.002, 2000
    late = commands(segment(), 0, 12, timestep, linear, {0: delay})[:, 0]
    times = (np.arange(12 * fine) + 0.5) / fine * timestep - delay
    each = segment()
    if linear:
        values = np.interp(times, each.times, each.controls[:, 0])
    else:
        values = each.controls[np.maximum(np.searchsorted(each.times, times, side="right") - 1, 0), 0]
    np.testing.assert_allclose(late, values.reshape(12, fine).mean(axis=1), atol=2e-3)


def test_maps_know_patterns_joints_and_files_as_those_of_replays_do(tmp_path: Path) -> None:
    (tmp_path / "names.map").write_text("time = t\n")
    columns = {"t": TIMES, "hinge_deg": np.degrees(np.sin(TIMES)), "motor_cmd": TIMES, "all_0": np.cos(TIMES)}
    maps = (f"@{tmp_path}/names.map", "qpos/{}={}_deg*pi/180", "ctrl/{}={}_cmd", "qvel=all_0")
    mapped = read(tmp_path, columns, maps)
    assert mapped.signals == ["qvel/hinge", "qpos/hinge"]
    np.testing.assert_allclose(mapped.segments[0].values, np.column_stack([np.cos(TIMES), np.sin(TIMES)]))
    assert mapped.segments[0].controls[:, 0].tolist() == TIMES.tolist()
    with pytest.raises(UsageError, match="map specifies qpos/hinge twice"):
        read(tmp_path, columns, ("time=t", "qpos/hinge=hinge_deg", "qpos/hinge=all_0"))
