"""Probes by name: names, objects, wildcards, columns and their groups."""

from pathlib import Path

import mujoco
import pytest

from mjrun.errors import MjrunError, UnknownNameError, UsageError
from mjrun.options.trace import PROBES
from mjrun.probe.fields import MjDataProbe
from mjrun.probe.select import aliases, available_columns, column_groups, select, selected_columns, split
from tests.cases import cases, mjcf

MODEL = mujoco.MjModel.from_xml_string(
    """
    <mujoco>
      <worldbody>
        <body name="left"><joint name="left_hip"/><joint name="left_knee" axis="0 1 0"/>
          <geom name="skin" size=".1" pos=".1 0 0"/><site name="tip"/></body>
        <body name="right"><joint name="right_hip"/><geom size=".1" pos=".1 0 0"/></body>
      </worldbody>
      <sensor><jointpos name="imu" joint="left_hip"/></sensor>
    </mujoco>
    """
)


def found(*asked: str) -> list[str]:
    return [column.name for probe in select(MODEL, asked) for column in probe.columns]


@cases("asked, columns")
def test_what_is_asked_for_is_what_is_measured(asked: list[str], columns: list[str]) -> None:
    assert found(*asked) == columns


def test_the_default_is_everything_that_most_people_want() -> None:
    assert {name.split("/")[0] for name in found(*PROBES)} == {"qpos", "qvel", "energy", "contact", "sensor"}


@cases("text, parts")
def test_a_list_is_split_at_commas_outside_brackets(text: str, parts: list[str]) -> None:
    assert split(text) == parts


@cases("asked, message")
def test_a_wrong_probe_is_refused_with_what_is_right(asked: list[str], message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        select(MODEL, asked)
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_inverse_dynamics_is_refused_where_mujoco_has_none() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option integrator="RK4"><flag invdiscrete="enable"/></option><worldbody><body><freejoint/>'
        '<geom size=".1"/></body></worldbody></mujoco>'
    )
    assert not [column for column in available_columns(model) if column.name.startswith("qfrc_inverse")]
    with pytest.raises(UsageError, match=r"qfrc_inverse cannot be measured at an instant: .*invdiscrete.* RK4"):
        select(model, ["qfrc_inverse"])
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    assert len(select(model, ["qfrc_inverse"])[0].columns) == 6


def test_the_name_of_a_body_suggests_its_unnamed_joint() -> None:
    body = '<mujoco><worldbody><body name="a/car"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(body)
    for asked, meant in (("qvel[a/car]", "joint:0"), ("qvel/a/car", "qvel/joint:0")):
        with pytest.raises(UnknownNameError, match=rf"\(did you mean '{meant}'\?\)"):
            select(model, [asked])
        select(model, [asked.replace("a/car", "joint:0")])


def test_a_column_of_a_site_or_geom_may_be_asked_for_as_a_body_s() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="b"><geom name="g" size=".1"/><site name="s"/></body></worldbody></mujoco>'
    )
    found = [
        [column.name for column in select(model, [text])[0].columns] for text in ("xpos/b/z", "xpos/g/z", "xpos/s")
    ]
    assert found == [["xpos/b/z"], ["geom_xpos/g/z"], ["site_xpos/s/x", "site_xpos/s/y", "site_xpos/s/z"]]
    with pytest.raises(UnknownNameError, match="no column 'xpos/q/z'"):
        select(model, ["xpos/q/z"])


# Names that look like something else: parts of others, brackets, spaces.
ODD = mujoco.MjModel.from_xml_string(mjcf("select"))


@pytest.mark.parametrize("model", [MODEL, ODD])
def test_every_column_is_had_by_its_name_and_alone(model: mujoco.MjModel) -> None:
    for name in {column.name for column in available_columns(model)}:
        assert [column.name for probe in select(model, [name]) for column in probe.columns] == [name]


@pytest.mark.parametrize("model", [MODEL, ODD])
def test_an_alias_is_what_is_selected_by_it(model: mujoco.MjModel) -> None:
    offered = {column.name for column in available_columns(model)}
    others = {name: column for name, column in aliases(model).items() if name not in offered}
    assert {name.split("/")[0] for name in others} == {"xpos", "xquat", "xmat", "sensordata"}
    for name, column in others.items():
        (found,) = (found.name for probe in select(model, [name]) for found in probe.columns)
        assert found == (name if name.startswith("sensordata/") else column)


def test_contacts_between_two_objects_are_not_listed() -> None:
    assert [c.name for c in available_columns(MODEL) if c.name.startswith("contact/")] == ["contact/ncon"]


ARM = Path(__file__).parents[2] / "scenes/arm.xml"


def test_groups_divide_the_columns_and_each_is_what_its_name_selects() -> None:
    model = mujoco.MjModel.from_xml_path(str(ARM))
    columns = available_columns(model)
    groups = column_groups(columns)
    assert sorted(column.name for group in groups for column in group.columns) == sorted(c.name for c in columns)
    for group in groups:
        names = [column.name for column in group.columns]
        assert names == [column.name for column in selected_columns(model, [group.name])]
        assert group.texts("kind") == [kind for kind in dict.fromkeys(c.kind for c in group.columns) if kind]


@pytest.mark.parametrize("text", ["qpos/left", "qpos[left]"])
def test_a_comma_in_a_name_is_written_as_a_wildcard(text: str) -> None:
    joint = '<body><joint name="left,hip" type="hinge"/><geom size="1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{joint}</worldbody></mujoco>")
    with pytest.raises(UnknownNameError) as caught:
        select(model, [text])
    assert caught.value.__notes__ == ["commas separate probes: write qpos[left?hip]"]
    assert [column.name for column in selected_columns(model, ["qpos[left?hip]"])] == ["qpos/left,hip"]


def test_pairs_keep_the_spaces_at_the_ends_of_a_name() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <geom name="floor" type="plane" size="1 1 .1"/>
        <body name=" pad "><freejoint/><geom size=".1"/></body>
        <body name="pad" pos="0 0 9"><freejoint/><geom size=".1"/></body>
      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    counts = {"contact/floor/ pad ": 1, " contact/ pad /floor ": 1, "contact/floor/pad": 0, "contact/floor/pad ": 0}
    for name, count in counts.items():
        (probe,) = select(model, [name])
        assert isinstance(probe, MjDataProbe)
        assert probe.measure(model, data).tolist() == [count]


def test_spaces_at_the_ends_of_a_name_belong_to_it_where_an_object_has_them() -> None:
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco>
          <worldbody><body name=" hand "><freejoint/><geom size=".1"/></body></worldbody>
          <sensor>
            <clock name="clock"/> <clock name=" clock "/> <clock name=" late "/>
            <framepos name="  pad " objtype="xbody" objname=" hand "/>
          </sensor>
        </mujoco>
        """
    )
    pad = [f"sensor/  pad /{axis}" for axis in "xyz"]
    for text, names in {
        "sensor/  pad ": pad,
        "sensor/  pad": pad,
        "sensor[  pad ,clock]": ["sensor/clock", *pad],
        "sensor[ clock , clock]": ["sensor/clock", "sensor/ clock "],
        "sensor/ clock ": ["sensor/ clock "],
        "sensor/clock ": ["sensor/clock"],
        "xpos[ hand ]": [f"xpos/ hand /{axis}" for axis in "xyz"],
    }.items():
        assert [column.name for column in selected_columns(model, [text])] == names, text


def test_an_object_of_contacts_is_hinted_at_as_one_of_two() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='a'><geom size='1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(UnknownNameError) as caught:
        select(model, ["contact[a]"])
    assert any("contact/A/B" in note for note in caught.value.__notes__)
