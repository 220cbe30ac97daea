"""Columns of tables are mapped by name, by number, and by maps."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UnknownNameError, UsageError
from mjrun.simulation.mapped_table import ColumnMap, map_files, state_map, time_hint
from tests.physics.tumbler import column_names, model

QPOS = column_names()["qpos"]


def resolved(names: list[str], *texts: str, quat: str = "wxyz") -> ColumnMap:
    return state_map(model(), names, texts, quat, "t.csv")


def read(result: ColumnMap, field: str = "qpos") -> dict[str, str]:
    """Returns the table's column of each number that is a column unchanged."""
    return {name: result.sources[name].columns[0] for name in result.columns[field] if name in result.sources}


def numbered(prefix: str, count: int, first: int = 0) -> list[str]:
    return [prefix.format(index) for index in range(first, first + count)]


def test_our_own_names_mean_themselves_and_others_nothing() -> None:
    result = resolved(["time", *reversed(QPOS), "qvel/hip", "energy/kinetic", "note"])
    assert read(result) == {name: name for name in QPOS}
    assert read(result, "qvel") == {"qvel/hip": "qvel/hip"}
    assert set(result.sources) == {*QPOS, "qvel/hip"}
    assert result.time is not None
    assert result.time.columns == ("time",)


@pytest.mark.parametrize("prefix", ["qpos/{}", "qpos_{}", "qpos.{}", "qpos[{}]", "qpos{}"])
@pytest.mark.parametrize("first", [0, 1])
def test_a_whole_field_may_be_numbered(prefix: str, first: int) -> None:
    names = numbered(prefix, 13, first)
    assert list(read(resolved(names)).values()) == names


def test_the_order_of_numbered_quaternions_is_reported() -> None:
    result = read(resolved(numbered("qpos/{}", 13), quat="xyzw"))
    expected = [0, 1, 2, 6, 3, 4, 5, 7, 11, 8, 9, 10, 12]
    assert [result[name] for name in QPOS] == [f"qpos/{index}" for index in expected]
    result = read(resolved([*numbered("qpos/neck/{}", 4), "qpos/root/qw", "qpos/root/x"], quat="xyzw"))
    assert result == {
        "qpos/root/qw": "qpos/root/qw",
        "qpos/root/x": "qpos/root/x",  # what has a name has no order
        "qpos/neck/qw": "qpos/neck/3",
        "qpos/neck/qx": "qpos/neck/0",
        "qpos/neck/qy": "qpos/neck/1",
        "qpos/neck/qz": "qpos/neck/2",
    }
    assert [*read(resolved(numbered("mocap_quat_{}", 4), quat="xyzw"), "mocap_quat").values()] == [
        *("mocap_quat_3", "mocap_quat_0", "mocap_quat_1", "mocap_quat_2")
    ]


def test_a_map_has_expressions_over_the_columns_of_the_table() -> None:
    result = resolved(
        ["t", "hip_deg", "lift (mm)"], "time=t/1000", "qpos/hip = hip_deg*pi/180", "qpos/lift='lift (mm)'/1e3"
    )
    assert result.time is not None
    table = {"t": np.array([0.0, 500.0]), "hip_deg": np.array([180.0, -90.0]), "lift (mm)": np.array([1.0, 2.0])}
    assert result.time.values(table).tolist() == [0, 0.5]
    assert result.sources[QPOS[7]].values(table).tolist() == [np.pi, -np.pi / 2]
    assert result.sources[QPOS[12]].values(table).tolist() == [0.001, 0.002]


def test_a_map_precedes_names() -> None:
    result = resolved(["time", *QPOS, "other"], "qpos/hip=other")
    assert read(result)["qpos/hip"] == "other"
    assert read(result)["qpos/lift"] == "qpos/lift"


@pytest.mark.parametrize(
    "names",
    [
        [f"pelvis/{part}" for part in ("qx", "qy", "qz", "qw", "x", "y", "z")],
        [f"pelvis_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")],
    ],
)
def test_a_joint_is_mapped_whole_to_columns_of_its_components(names: list[str]) -> None:
    result = read(resolved(names, "qpos/root=pelvis", quat="xyzw"))
    assert {name.rpartition("/")[2]: source for name, source in result.items()} == {
        name[len("pelvis") + 1 :]: name for name in names
    }


def test_arrays_side_by_side_are_a_joint_or_a_field() -> None:
    names = [*numbered("root_pos/{}", 3), *numbered("root_rot/{}", 4), *numbered("neck_{}", 4), "hip", "lift"]
    result = read(resolved(names, "qpos=root_pos, root_rot, hip, neck, lift", quat="xyzw"))
    assert [result[name] for name in QPOS] == [
        *("root_pos/0", "root_pos/1", "root_pos/2", "root_rot/3", "root_rot/0", "root_rot/1", "root_rot/2"),
        *("hip", "neck_3", "neck_0", "neck_1", "neck_2", "lift"),
    ]
    result = resolved(names, "qpos/lift=2*lift", "qpos=root_pos,root_rot,hip,neck,lift")
    assert result.sources[QPOS[12]].text == "2*lift"


def test_expressions_side_by_side_are_computed_number_by_number() -> None:
    names = ["x (mm)", "y", "z", *numbered("rot[{}]", 4), *numbered("rest/{}", 6), *numbered("rest_zero/{}", 6)]
    rng = np.random.default_rng(1)
    table = {name: rng.normal(size=5) for name in names}
    rest = np.array([table[name] for name in names[7:13]])
    zero = np.array([table[name] for name in names[13:]])

    result = resolved(names, "qpos='x (mm)'/1000, cos(y), -z, rot, (rest - rest_zero)*pi/180", quat="xyzw")
    values = [result.sources[QPOS[index]].values(table) for index in range(13)]
    assert np.array_equal(values[:3], [table["x (mm)"] / 1000, np.cos(table["y"]), -table["z"]])
    assert np.array_equal(values[3:7], [table[f"rot[{index}]"] for index in (3, 0, 1, 2)])
    order = [0, 4, 1, 2, 3, 5]  # the neck's quaternion is turned round like the root's
    assert np.array_equal(values[7:], ((rest - zero) * np.pi / 180)[order])

    with pytest.raises(UsageError, match=r"arrays of different widths in 'rot \+ rest': rot 4, rest 6"):
        resolved(names, "qpos=y,y,y,rot + rest")
    result = resolved([*numbered("turn/{}", 4)], "qpos/neck=-turn")  # the other cover of the same attitude
    assert [source.text for source in result.sources.values()] == ["-turn"] * 4
    assert [source.columns[0] for source in result.sources.values()] == numbered("turn/{}", 4)


def test_what_says_more_precedes_whatever_the_order() -> None:
    names = [*QPOS, *numbered("all/{}", 13), *numbered("neck_{}", 4)]
    for texts in (("qpos=all", "qpos/neck=neck"), ("qpos/neck=neck", "qpos=all")):
        options = list(read(resolved(names, *texts)).values())
        assert sorted(options) == sorted([*(f"all/{i}" for i in (*range(8), 12)), *numbered("neck_{}", 4)])


def test_a_pattern_stands_for_all_columns_that_both_sides_have() -> None:
    names = ["hip_deg", "lift_deg", "other_deg", "hip_vel", "neck_qw"]
    result = resolved(names, "qpos/lift=hip_deg", "qpos/{}={}_deg*pi/180", "qvel/{}={}_vel")
    assert {name: source.text for name, source in result.sources.items() if name in QPOS} == {
        "qpos/hip": "hip_deg*pi/180",
        "qpos/lift": "hip_deg",  # which says more
    }
    assert [source.text for name, source in result.sources.items() if name not in QPOS] == ["hip_vel"]
    with pytest.raises(UnknownNameError, match=r"no column 'qpas/\{\}' in map of this model"):
        resolved(names, "qpas/{}={}_deg")
    with pytest.raises(UnknownNameError, match=r"no column 'hip_dog' .* \(did you mean 'hip_deg'\?\)"):
        resolved(names, "qpos/{}={}_dog")
    with pytest.raises(UnknownNameError, match=r"no column 'root/x_the_angle_of_this_joint'"):
        resolved(names, "qpos/{}={}_the_angle_of_this_joint")


def test_a_file_of_lines_is_a_map(tmp_path: Path) -> None:
    (tmp_path / "names.map").write_text("\ufeff# a robot's log\n\ntime = t\n  qpos/hip=hip_deg*pi/180  \n")
    result = resolved(["t", "hip_deg"], f"@{tmp_path}/names.map")
    assert result.time is not None
    assert read(result) == {"qpos/hip": "hip_deg"}
    assert map_files(["time=t", "@a/b.map"]) == ["a/b.map"]
    (tmp_path / "names.map").write_text("time = t\nnothing\n")
    with pytest.raises(UsageError, match=r"names\.map:2 is not COLUMN=EXPRESSION"):
        resolved(["t", "hip_deg"], f"@{tmp_path}/names.map")
    with pytest.raises(FileError, match="no such file"):
        resolved(["t"], f"@{tmp_path}/no.map")
    (tmp_path / "names.map").write_bytes(b"\0\1")
    with pytest.raises(UsageError, match=r"names\.map is not a file of lines"):
        resolved(["t"], f"@{tmp_path}/names.map")


@pytest.mark.parametrize(
    ("texts", "kind", "message"),
    [
        (["qpos/hop=a"], UnknownNameError, r"no column 'qpos/hop' in map of this model \(did you mean 'qpos/hip'"),
        (["qpos/hip=a", "nonsense=a"], UnknownNameError, r"no column 'nonsense' in map of this model\ncolumns: time,"),
        (["qpos/hip=hip_dg"], UnknownNameError, r"no column 'hip_dg' .*\(did you mean 'hip_deg'\?\)"),
        (["qpos/hip=hip_deg*"], UsageError, r"^map qpos/hip, character 9: found"),
        (["qpos/hip=mean(hip_deg)"], UsageError, r"^map qpos/hip, character 1"),
        (["qpos/hip=hip_deg", "qpos/hip=a"], UsageError, r"^map specifies qpos/hip twice"),
        (["qpos/root=pelvs"], UnknownNameError, r"no column 'pelvs' in 'pelvs', character 1"),
        (["qpos/root=hip_deg,pelvs*2"], UnknownNameError, r"no column 'pelvs' in 'pelvs\*2', character 1"),
        (["qpos/root=hip_deg,,a"], UsageError, r"^map, character 1: found the end"),
        (["qpos/root=hip_deg"], UsageError, r"^map: qpos/root has 7 numbers, and hip_deg has 1"),
    ],
)
def test_maps_that_name_nothing_are_refused_with_names_that_are_near(
    texts: list[str], kind: type[UsageError], message: str
) -> None:
    with pytest.raises(kind, match=message) as caught:
        resolved(["time", "hip_deg", "a", "pelvis"], *texts)
    assert caught.value.path == ("map", len(texts) - 1)


def test_a_table_without_positions_says_what_it_has_and_what_to_do() -> None:
    with pytest.raises(UsageError) as caught:
        resolved(["stamp", "left_hip_deg", "x\x1b"])
    assert str(caught.value) == (
        "t.csv has no positions of this model\nit has stamp, left_hip_deg, x\\x1b\n"
        f"the model has time, {', '.join(QPOS)}, mocap_pos/0/x, mocap_pos/0/y, mocap_pos/0/z, mocap_quat/0/qw, "
        "mocap_quat/0/qx, mocap_quat/0/qy, mocap_quat/0/qz\nmap assigns columns, as in qpos/hip=left_hip_deg*pi/180"
    )


def test_a_table_of_another_model_is_reported_by_what_it_has_and_lacks() -> None:
    with pytest.raises(
        UsageError, match=r"^t\.csv is a table of another model: it has qpos/ankle, and lacks qpos/lift"
    ):
        resolved(["time", *QPOS[:-1], "qpos/ankle"])
    with pytest.raises(UsageError, match=r"^t\.csv has 9 columns qpos/0 … qpos/8, and qpos of this model has 13"):
        resolved(["time", *numbered("qpos/{}", 9)])
    with pytest.raises(UsageError, match=r"^t\.csv is a table of another model: it has qpos/ankle, and lacks"):
        resolved(["time", "qpos/ankle"])
    assert resolved(["time", *QPOS, "qpos/ankle"]).unused == ["qpos/ankle"]  # it has all that is needed
    assert len(resolved(["time", *QPOS[:-1]]).sources) == 12


def test_the_hint_names_what_may_be_the_time() -> None:
    assert time_hint(["hip", "Timestamp"]) == "\x02map\x03 specifies the time, as in time=Timestamp"
    assert time_hint(["Time (s)", "hip"]).endswith("as in time='Time (s)'")
    assert time_hint(["t [ms]", "hip"]).endswith("as in time='t [ms]'/1000")
    assert "as in" not in time_hint(["hip"])


def test_a_column_in_two_units_is_refused_unless_one_has_the_name_itself_or_is_mapped() -> None:
    names = ["time", *(name for name in QPOS if name != "qpos/hip"), "qpos/hip [deg]", "qpos/hip [rad]"]
    with pytest.raises(
        UsageError, match=r"both qpos/hip \[deg\] and qpos/hip \[rad\]\n.* as in qpos/hip='qpos/hip \[deg"
    ):
        resolved(names)
    assert read(resolved(names, "qpos/hip='qpos/hip [deg]'"))["qpos/hip"] == "qpos/hip [deg]"
    assert read(resolved([*names, "qpos/hip"]))["qpos/hip"] == "qpos/hip"
    with pytest.raises(UsageError, match=r"both time \[s\] and time \[ms\]"):
        resolved([*QPOS, "time [s]", "time [ms]"])
