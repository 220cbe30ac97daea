"""Numbers changed in the text of a model: the text compiles to the model with overrides, and little of it differs."""

import difflib
from pathlib import Path

import pytest

from mjrun.errors import UsageError
from mjrun.model.attribute_edits import changes, with_changes
from mjrun.model.override import Override
from mjrun.model.source import physics_fingerprint
from mjrun.model.sources.file import FileSource
from mjrun.platform.installation import scene_folder
from tests.cases import cases, mjcf

MODEL = mjcf("classes")


def changed(path: Path, *overrides: tuple[str, str]) -> tuple[list[str], list[str]]:
    """Sentences about what changed, and the lines that differ; the text is proved to be the model with overrides."""
    all_overrides = tuple(Override(*each) for each in overrides)
    made = changes(path, all_overrides)
    assert all(each.element.file == path for each in made)
    old = path.read_bytes()
    new = with_changes(old, made)
    beside = path.with_name("changed.xml")
    beside.write_bytes(new)
    expected = FileSource(path, overrides=all_overrides).load()
    assert physics_fingerprint(FileSource(beside).load()) == physics_fingerprint(expected)
    lines = difflib.ndiff(old.decode().splitlines(), new.decode().splitlines())
    return [each.sentence for each in made], [line[2:].strip() for line in lines if line.startswith("+ ")]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


@pytest.mark.parametrize(
    ("path", "value", "lines"),
    [
        ("joint/two.damping", "0.25", ['<body name="b"><joint name="two" damping="0.25"']),
        ("joint/one.damping", "0.25", ['<joint damping="0.25"/>']),  # nothing else takes it from there
        ("joint/one.armature", "0.5", ['<joint name="one" axis="0 1 0" armature="0.5"/>']),
        ("geom/g.friction[1]", "0.5", ['axis="1 0 0"/><geom name="g" size=".1" friction="1.0 0.5"/></body>']),
        ("scale:geom/g.friction", "2", ['axis="1 0 0"/><geom name="g" size=".1" friction="2.0 0.01 0.0002"/></body>']),
        ("scale:actuator/general.gainprm", "2", ['<general name="general" joint="two" gainprm="6.0"/>']),
        ("body/a.mass", "2", ['<inertial pos="0 0 0" mass="2.0" diaginertia="1 1 1"/>']),
        ("opt.gravity[2]", "-3.7", ["<option gravity='0.0 0.0 -3.7'/>"]),
        ("actuator/motor.gear[0]", "7", ['<motor name="motor" joint="two" gear="7.0"/>']),
        ("actuator/general.gainprm[0]", "7", ['<general name="general" joint="two" gainprm="7.0"/>']),
    ],
)
def test_one_attribute_changes_and_nothing_else(model: Path, path: str, value: str, lines: list[str]) -> None:
    assert changed(model, (path, value))[1] == lines


def test_a_class_default_changes_where_all_that_have_it_shall(model: Path) -> None:
    sentences, lines = changed(model, ("joint/[ot]*.stiffness", "9"))
    assert lines == ['<default class="stiff"><joint stiffness="9.0"/><position kp="20" kv="1"/></default>']
    assert sentences == ["model.xml:6: stiffness of a class default = 9.0"]


def test_where_others_have_the_default_too_each_gets_its_own(model: Path) -> None:
    assert len(changed(model, ("joint/two.stiffness", "9"))[1]) == 1


def test_relative_overrides_write_what_they_come_to(model: Path) -> None:
    assert 'damping="2.0"' in changed(model, ("scale:joint/two.damping", "4"))[1][0]


def test_gains_of_a_servo_are_written_as_its_own_attributes(model: Path) -> None:
    pairs = [("actuator/servo.gainprm[0]", "44.0"), ("actuator/servo.biasprm[1]", "-44.0")]
    _, lines = changed(model, *pairs, ("actuator/servo.biasprm[2]", "-3.0"))
    assert lines == ['<default class="stiff"><joint stiffness="5"/><position kp="44.0" kv="3.0"/></default>']


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        (
            "actuator/general.gainprm[1]",
            "5",
            '<general name="general" joint="h" gainprm="100.0 5.0" biastype="affine"/>',
        ),
        ("actuator/general.biasprm[1]", "-50", 'gainprm="100" biastype="affine" biasprm="0.0 -50.0"/>'),
        ("actuator/general.biasprm", "0 -50 -1", 'gainprm="100" biastype="affine" biasprm="0.0 -50.0 -1.0"/>'),
        ("actuator/motor.ctrlrange", "-2 2", '<motor name="motor" joint="h" ctrlrange="-2.0 2.0"/>'),
    ],
)
def test_actuators_keep_their_other_parameters_and_those_of_other_kinds(
    tmp_path: Path, path: str, value: str, line: str
) -> None:
    file = tmp_path / "model.xml"
    file.write_text("""<mujoco>
      <default><general ctrlrange="-1 1" ctrllimited="true"/></default>
      <worldbody><body><joint name="h"/><geom size=".1"/></body></worldbody>
      <actuator>
        <general name="general" joint="h" gainprm="100" biastype="affine"/>
        <motor name="motor" joint="h"/>
        <position name="servo" joint="h" kp="5"/>
      </actuator></mujoco>""")
    (changed_line,) = changed(file, (path, value))[1]
    assert changed_line.endswith(line)


def test_gains_of_a_servo_are_not_written_into_the_default_of_another_kind(tmp_path: Path) -> None:
    file = tmp_path / "model.xml"
    file.write_text("""<mujoco>
      <default><position kp="3" kv="1"/></default>
      <worldbody><body><joint name="h"/><geom size=".1"/></body></worldbody>
      <actuator>
        <position name="servo" joint="h"/>
        <velocity name="speed" joint="h"/>
      </actuator></mujoco>""")
    _, lines = changed(file, ("actuator/speed.gainprm[0]", "7"), ("actuator/speed.biasprm[2]", "-7"))
    assert lines == ['<velocity name="speed" joint="h" kv="7.0"/>']


@cases("path, message")
def test_what_is_no_attribute_is_refused(model: Path, path: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        changes(model, [Override(path, "1")])


def test_elements_that_are_not_written_out_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "many.xml"
    path.write_text(
        '<mujoco><worldbody><replicate count="3" offset="1 0 0"><body><joint name="j"/><geom size=".1"/></body>'
        "</replicate></worldbody></mujoco>"
    )
    with pytest.raises(UsageError, match="not written out"):
        changes(path, [Override("joint/j0.damping", "1")])


def test_included_files_are_named(model: Path) -> None:
    (model.parent / "part.xml").write_text('<mujoco><worldbody><geom name="p" size=".1"/></worldbody></mujoco>')
    model.write_text(MODEL.replace("  <worldbody>", '  <include file="part.xml"/>\n  <worldbody>', 1))
    (made,) = changes(model, [Override("geom/p.margin", "0.1")])
    assert made.element.file.name == "part.xml"


@cases("scene, overrides")
def test_scenes_compile_to_what_is_written(tmp_path: Path, scene: str, overrides: list[tuple[str, str]]) -> None:
    path = tmp_path / f"{scene}.xml"
    path.write_bytes((scene_folder() / f"{scene}.xml").read_bytes())
    changed(path, *overrides)
