"""Theorems about `--set`: the compiled model is, byte for byte, that of the XML with the attribute written in."""

import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from mjrun.errors import BadValueError, MjrunError, UnknownNameError, UsageError, clean, option
from mjrun.model.names import enum_members
from mjrun.model.override import ELEMENTS, Override, apply
from mjrun.model.sources import load
from tests.cases import cases
from tests.model.model_files import content

MODEL = """<mujoco><compiler angle="radian"/><option/><statistic/><visual><quality/><global/><rgba/></visual>
<asset><texture name="tex" type="2d" builtin="flat" width="4" height="4"/><material name="mat" texture="tex"/></asset>
<worldbody><light name="lamp"/><camera name="cam"/><geom name="floor" type="plane" size="1 1 1"/>
<body name="arm"><joint name="knee" range="-1 1"/><geom name="shin.l" size=".1"/><site name="tip"/></body>
<body name="leg" pos="1 0 0"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><joint/><geom size=".1"/></body>
</worldbody><tendon><fixed name="rope"><joint joint="knee" coef="1"/></fixed></tendon>
<actuator><motor name="motor" joint="knee"/></actuator><sensor><jointpos name="angle" joint="knee"/></sensor>
<custom><numeric name="table" data="1 2"/><text name="note" data="hi"/></custom>
<keyframe><key name="home"/></keyframe></mujoco>"""


def overridden(*settings: tuple[str, str]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(MODEL)
    for path, value in settings:
        apply(spec, Override(path, value))
    return spec.compile()


def written(old: str, new: str) -> mujoco.MjModel:
    """The model with `new` written over `old`."""
    assert MODEL.count(old) == 1
    return mujoco.MjModel.from_xml_string(MODEL.replace(old, new))


def refusal(path: str, value: str) -> UsageError:
    with pytest.raises(UsageError) as caught:
        overridden((path, value))
    assert caught.value.exit_code == 2
    return caught.value


@cases("path, value, old, new")
def test_an_override_is_the_attribute_written_into_the_source(path: str, value: str, old: str, new: str) -> None:
    assert content(overridden((path, value))) == content(written(old, new))


@pytest.mark.parametrize("field", ["gainprm", "biasprm", "dynprm"])
def test_the_parameters_of_an_actuator_may_be_the_first_few_as_in_mjcf(field: str) -> None:
    general = MODEL.replace("<motor", "<general")
    spec = mujoco.MjSpec.from_string(general)
    apply(spec, Override(f"actuator/motor.{field}", "7"))
    expected = mujoco.MjModel.from_xml_string(general.replace('"motor"', f'"motor" {field}="7"'))
    assert content(spec.compile()) == content(expected)


def test_a_wildcard_means_every_element_that_it_matches() -> None:
    model = overridden(("geom/*.solmix", "7"), ("joint/*.damping", "3"))
    assert model.geom_solmix.tolist() == [7, 7, 7]
    assert model.dof_damping.tolist() == [3, 3]


def test_later_overrides_win_and_those_of_other_fields_stay() -> None:
    model = overridden(("opt.timestep", "1"), ("opt.cone", "elliptic"), ("opt.timestep", "2"))
    assert (model.opt.timestep, model.opt.cone) == (2, mujoco.mjtCone.mjCONE_ELLIPTIC)


def flags(name: str, *values: str) -> tuple[int, int]:
    """The disable and enable bits after setting a flag to one value after another."""
    spec = mujoco.MjSpec()
    for value in values:
        apply(spec, Override(f"opt.flag.{name}", value))
    return spec.option.disableflags, spec.option.enableflags


@pytest.mark.parametrize("name", sorted({*enum_members(mujoco.mjtDisableBit)} - {"autoreset"}))
def test_disabling_a_flag_sets_its_disable_bit_and_enabling_clears_it(name: str) -> None:
    bit = int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name.upper()}"))
    assert flags(name, "disable") == flags(name, "enable", "disable", "disable") == (bit, 0)
    assert flags(name, "enable") == flags(name, "disable", "enable") == (0, 0)


@pytest.mark.parametrize("name", sorted(enum_members(mujoco.mjtEnableBit)))
def test_enabling_a_flag_sets_its_enable_bit_and_disabling_clears_it(name: str) -> None:
    bit = int(getattr(mujoco.mjtEnableBit, f"mjENBL_{name.upper()}"))
    assert flags(name, "enable") == flags(name, "disable", "enable", "enable") == (0, bit)
    assert flags(name, "disable") == flags(name, "enable", "disable") == (0, 0)


@cases("path, near")
def test_a_path_that_names_nothing_is_refused_with_the_nearest_name(path: str, near: str) -> None:
    error = refusal(path, "1")
    assert isinstance(error, UnknownNameError)
    assert f"(did you mean {near}" in str(error).splitlines()[0]


@cases("path, value, expected")
def test_a_value_that_does_not_fit_is_refused_with_what_would(path: str, value: str, expected: str) -> None:
    error = refusal(path, value)
    assert isinstance(error, BadValueError)
    assert str(error) == f"{path}: {value!r} is not {expected}"


ORIENTATIONS = {
    "quat": "0 1 0 0",
    "alt.euler": "0 0 1",
    "alt.axisangle": "1 0 0 2",
    "alt.xyaxes": "0 1 0 -1 0 0",
    "alt.zaxis": "1 0 0",
}


@pytest.mark.parametrize("before", ORIENTATIONS)
@pytest.mark.parametrize("after", ORIENTATIONS)
@pytest.mark.parametrize(("kind", "name"), [("body", "arm"), ("geom", "floor"), ("site", "tip"), ("camera", "cam")])
def test_an_orientation_replaces_the_one_in_the_source_however_each_is_written(
    kind: str, name: str, before: str, after: str
) -> None:
    def turned(way: str) -> str:
        return MODEL.replace(f'"{name}"', f'"{name}" {way.removeprefix("alt.")}="{ORIENTATIONS[way]}"')

    spec = mujoco.MjSpec.from_string(turned(before))
    apply(spec, Override(f"{kind}/{name}.{after}", ORIENTATIONS[after]))
    assert content(spec.compile()) == content(mujoco.MjModel.from_xml_string(turned(after)))


def test_where_end_points_decide_a_placement_is_refused() -> None:
    ends = '"shin.l" type="capsule" fromto="0 0 0 0 0 1"'
    for path in ("geom/shin.l.pos", "geom/shin*.quat", "geom/1.alt.euler"):
        spec = mujoco.MjSpec.from_string(MODEL.replace('"shin.l"', ends))
        with pytest.raises(UsageError, match="has no effect: the end points determine the placement"):
            apply(spec, Override(path, "0,0,0"))


def test_of_names_that_hold_dots_the_longest_that_fits_is_meant() -> None:
    spec = mujoco.MjSpec.from_string(MODEL.replace('"floor"', '"shin"'))
    apply(spec, Override("geom/shin.l.solmix", "7"))
    apply(spec, Override("geom/shin.solmix", "8"))
    assert spec.compile().geom_solmix.tolist() == [8, 7, 1]


def test_a_name_with_wild_characters_means_itself_and_not_what_it_would_match() -> None:
    spec = mujoco.MjSpec.from_string(MODEL.replace('"floor"', '"s*"'))
    apply(spec, Override("geom/s*.solmix", "7"))
    assert spec.compile().geom_solmix.tolist() == [7, 1, 1]


@cases("name, paths")
def test_the_name_of_a_field_alone_suggests_its_paths(name: str, paths: list[str]) -> None:
    with pytest.raises(UnknownNameError) as caught:
        apply(mujoco.MjSpec.from_string(MODEL), Override(name, "1"))
    assert list(caught.value.meant) == paths


@pytest.mark.parametrize("path", ["compiler.eulerseq", "material/mat.textures"])
def test_a_setting_that_is_offered_can_be_set_or_is_refused_in_true_words(path: str) -> None:
    spec = mujoco.MjSpec.from_string(MODEL)
    said = ""
    try:
        apply(spec, Override(path, "zyx"))
    except UsageError as error:
        said = str(error)
    assert "there are no settings" not in said


@pytest.mark.parametrize("path", ["opt.\x1b.x", "geom/floor.\x1b.x", "body/ar[m\x1b].mass", "body/\x1b.pos", "\x1b"])
def test_foreign_text_in_a_path_cannot_steer_the_terminal(path: str) -> None:
    with pytest.raises(MjrunError) as caught:
        overridden((path, "\x1b"))
    assert all(line == clean(line) for line in str(caught.value).splitlines())


def test_a_setting_says_how_it_was_asked() -> None:
    assert Override("opt.cone", "elliptic").option_value == "opt.cone=elliptic"
    assert Override("opt.cone", "elliptic").name == "opt.cone"
    assert Override("opt.timestep", "1", "timestep").option_value == "1"
    assert Override("opt.timestep", "1", "timestep").name == option("timestep")


@pytest.mark.parametrize(("kind", "plural"), ELEMENTS.items())
def test_every_kind_of_element_is_one_of_mujocos(kind: str, plural: str) -> None:
    spec = mujoco.MjSpec()
    assert isinstance(getattr(spec, plural), list | tuple)
    with pytest.raises(UnknownNameError, match=f"no {kind} 'nothing'"):
        apply(spec, Override(f"{kind}/nothing.pos", "1"))


def test_no_path_crashes_the_process() -> None:
    code = """
import mujoco, sys
from mjrun.errors import UsageError
from mjrun.model.override import Override, apply
text = sys.stdin.read()
for path in ("geom/floor.classname.geom.size", "body/arm.classname.joint.damping", "geom/floor.plugin.active"):
    spec = mujoco.MjSpec.from_string(text)
    try:
        apply(spec, Override(path, "1"))
        spec.compile()
    except (UsageError, ValueError):
        pass
"""
    run = subprocess.run([sys.executable, "-c", code], input=MODEL, text=True, capture_output=True, check=False)
    assert run.returncode == 0, run.stderr


def test_the_source_file_itself_is_not_changed(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(MODEL)
    assert load(path, overrides={"geom/floor.friction": "9"}).geom("floor").friction[0] == 9
    assert path.read_text() == MODEL


# --- one number of a field, and values relative to those in the source ------------------------------


@cases("path, value, same_path, same_value")
def test_a_relative_value_or_a_single_number_is_the_whole_value_spelled_out(
    path: str, value: str, same_path: str, same_value: str
) -> None:
    ours, expected = overridden((path, value)), overridden((same_path, same_value))
    assert content(ours) == content(expected)


def test_a_relative_value_with_a_wildcard_is_relative_to_each_element() -> None:
    xml = "<mujoco><worldbody><geom name='a' size='1'/><geom name='b' size='3'/></worldbody></mujoco>"
    spec = mujoco.MjSpec.from_string(xml)
    apply(spec, Override("scale:geom/*.size[0]", "2"))
    assert [geom.size[0] for geom in spec.geoms] == [2, 6]


@cases("path, value, reason")
def test_a_unit_that_does_not_fit_is_refused(path: str, value: str, reason: str) -> None:
    assert f"{value} has a unit, and {reason}" in str(refusal(path, value))


@cases("path, value, message")
def test_an_override_that_makes_no_sense_is_refused_with_the_reason(path: str, value: str, message: str) -> None:
    assert message in str(refusal(path, value))


def test_a_name_that_contains_an_equals_sign_is_written_with_a_wildcard() -> None:
    text = '<mujoco><worldbody><geom name="a=b" size="1"/><geom name="ab" size="1"/></worldbody></mujoco>'
    spec = mujoco.MjSpec.from_string(text)
    apply(spec, Override("geom/a?b.mass", "3"))
    assert spec.geom("a=b").mass == 3
    assert spec.geom("ab").mass != 3
    with pytest.raises(UsageError, match="geom/a lacks a field") as caught:
        apply(spec, Override("geom/a", "b.mass=3"))
    assert caught.value.__notes__ == ["where a name contains =, write ?"]


CAMERA = '<mujoco><worldbody><camera name="eye" resolution="640 480"/></worldbody></mujoco>'


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("camera/eye.resolution", "640.7,480"),
        ("camera/eye.resolution[0]", "640.7"),
        ("scale:camera/eye.resolution", "0.33"),
        ("camera/eye.resolution", "3e9,480"),
        ("opt.iterations", "9" * 400),
        ("scale:opt.iterations", "0.333"),
    ],
)
def test_whole_numbers_are_not_cut_from_others(path: str, value: str) -> None:
    spec = mujoco.MjSpec.from_string(CAMERA)
    with pytest.raises(BadValueError, match="whole number"):
        apply(spec, Override(path, value))
    assert spec.cameras[0].resolution.tolist() == [640, 480]


@pytest.mark.parametrize("path", ["scale:opt.iterations", "scale:opt.gravity"])
def test_a_value_beyond_the_floats_is_refused(path: str) -> None:
    with pytest.raises(BadValueError, match="finite"):
        apply(mujoco.MjSpec(), Override(path, "1e308"))


@pytest.mark.parametrize("number", range(1, 100))
def test_a_value_with_a_unit_is_the_float_of_its_decimals(number: int) -> None:
    spec = mujoco.MjSpec.from_string(CAMERA)
    apply(spec, Override("opt.timestep", f"{number}ms"))
    assert spec.option.timestep == number / 1000


def test_a_flag_has_no_numbers_to_choose_from() -> None:
    with pytest.raises(UsageError, match="a flag is not a number"):
        apply(mujoco.MjSpec(), Override("opt.flag.gravity[0]", "disable"))
