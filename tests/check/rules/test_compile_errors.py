"""Theorems about explanations of MuJoCo's errors, and about the element that an error is about."""

from pathlib import Path

import mujoco
import pytest

from mjrun.check.rule import Rule
from mjrun.check.rules.compile_errors import CompileFailure
from mjrun.errors import BrokenModelError, option
from mjrun.model.sources import load
from mjrun.model.xml_source import XmlSource, read_xml
from tests.cases import cases
from tests.check.models import PARENT, attached_arm, keyed, lint, lint_file, mjcf, write

PLAIN = Rule("MJ999", "error", "a title")


def test_the_users_own_mistakes_are_explained_all_at_once() -> None:
    text = """<mujoco>
<worldbody>
<body><joint name="j"/><geom size=".1"/></body>
<actuator name="m">
<motor joint="j"/>
</actuator>
</worldbody>
<contact>
<geom1>one</geom1>
<geom2>two</geom2>
<friction>0.3 0.01 0.001</friction>
<restitution>0.5</restitution>
</contact>
<solver>
<iterations>100</iterations>
</solver>
</mujoco>"""
    findings = lint(text)
    codes = ["MJ103", "MJ104", "MJ106", "MJ106", "MJ106", "MJ102", "MJ102"]
    assert [(f.line, f.code) for f in findings] == list(zip([4, 4, 9, 10, 11, 12, 14], codes, strict=True))
    assert findings[0].remedy == "move <actuator> … </actuator> out of <worldbody>, directly into <mujoco>"
    assert findings[1].remedy.endswith("write it on <motor name=…>")
    assert 'write <pair geom1="one" geom2="two" friction="0.3 0.01 0.001"/>' in findings[4].remedy
    assert "solref" in findings[5].remedy
    assert '<option solver="Newton" iterations="100"' in findings[6].remedy


@cases("arm")
def test_a_mistake_in_an_attached_model_is_told_as_of_that_model_itself(arm: str) -> None:
    Path("sub").mkdir(exist_ok=True)
    path = Path("sub/arm.xml")
    path.write_text(arm)
    findings = lint_file(path)
    assert lint(PARENT) == findings
    assert {(f.file, f.severity) for f in findings} == {("sub/arm.xml", "error")}
    between = PARENT.replace("sub/arm.xml", "deep.xml").replace('"left_"/>', '"low_"/></body>')
    path.write_text(between.replace("<attach", '<body name="arm"><attach'))
    Path("sub/deep.xml").write_text(arm)
    assert lint(PARENT) == lint_file(Path("sub/deep.xml")) != []


@pytest.mark.parametrize("mistake", ['<option solver="x"/>', "<goem/>", "</b>"])
def test_what_mujoco_refuses_before_it_attaches_anything_is_told_first(mistake: str) -> None:
    Path("sub").mkdir(exist_ok=True)
    for arm in (attached_arm('type="x"'), attached_arm('siez="1"'), attached_arm("</b>")):
        Path("sub/arm.xml").write_text(arm)
        findings = lint(PARENT.replace("<asset>", f"{mistake}<asset>"))
        assert [(f.file, f.line) for f in findings] == [("model.xml", 2)]


@pytest.mark.parametrize(
    ("mistake", "line"),
    [('size="1" material="no"', 5), ('name="own" size="-1"', 5), ('size="-1"', None)],  # the last might be the arm's
)
def test_a_model_that_attaches_another_is_never_told_with_its_lines(mistake: str, line: int | None) -> None:
    Path("sub").mkdir(exist_ok=True)
    Path("sub/arm.xml").write_text(attached_arm())
    (finding,) = lint(PARENT.replace('<geom size="1"/><site/>', f"<geom {mistake}/><site/>"))
    assert (finding.file, finding.line, finding.severity) == ("model.xml", line, "error")


def test_a_keyframe_without_a_name_is_told_by_its_place() -> None:
    text = keyed('ctrl="1"').replace("</keyframe>", '\n<key ctrl="1 2"/>\n<key ctrl="1 2 3"/></keyframe>')
    (finding,) = [f for f in lint(text) if f.severity == "error"]
    assert (finding.code, finding.line) == ("MJ405", 13)
    assert finding.message == "ctrl of the keyframe has 2 numbers, but the model has 1"


@pytest.mark.parametrize("name", ["model.xml", "part.xml"])
def test_a_file_in_utf_16_is_to_be_saved_as_utf_8(name: str) -> None:
    Path("model.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    Path("part.xml").write_text("<mujocoinclude/>")
    Path(name).write_text(Path(name).read_text(), encoding="utf-16")
    (finding,) = lint_file(Path("model.xml"))
    assert (finding.file, finding.line, finding.code) == (name, 1, "MJ101")
    assert finding.remedy == "save it as UTF-8"


PLANE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"
SHOWN = '<geom type="mesh" mesh="{}"/>'


@pytest.mark.parametrize(
    ("part", "code", "line", "message", "remedy"),
    [
        ('<mujoco><worldbody>\n<geom size="1" pos="0 nan 0"/></worldbody></mujoco>', "MJ110", 2, "'0 nan 0'", "finite"),
        ('<mujoco>\n\n<include file="model.xml"/></mujoco>', "MJ100", 3, "'model.xml' already included", "by itself"),
        (
            f'<mujoco><asset>\n<mesh file="flat.obj"/></asset><worldbody>{SHOWN.format("flat")}</worldbody></mujoco>',
            *("MJ100", 2, "mesh 'flat' has coplanar vertices", "look at its file"),
        ),
    ],
)
def test_errors_in_included_files_have_a_line(part: str, code: str, line: int, message: str, remedy: str) -> None:
    Path("flat.obj").write_text(PLANE)
    Path("part.xml").write_text(part)
    (finding,) = lint('<mujoco><include file="part.xml"/></mujoco>')
    assert (finding.code, finding.file, finding.line) == (code, "part.xml", line)
    assert message in finding.message
    assert remedy in finding.remedy


def test_a_mesh_that_has_its_name_from_a_misspelt_file_is_not_renamed() -> None:
    text = f'<mujoco><asset>\n<mesh file="yess.obj"/></asset>\n<worldbody>{SHOWN.format("yes")}</worldbody></mujoco>'
    missing, unknown = lint(text)
    assert (missing.code, missing.line, unknown.code, unknown.line) == ("MJ107", 2, "MJ109", 3)
    assert "'yes.obj'" in missing.remedy
    assert unknown.remedy == "correct the file of the <mesh> on line 2, which gives it its name"


def test_the_only_reversed_range_is_the_place_of_the_error_in_an_included_file() -> None:
    joint = '<joint range="{}" limited="true"/><geom size=".1"/>'
    part = f"<mujocoinclude><worldbody>\n<body>{joint.format('2 1')}</body>\n<body>{joint.format('%s')}</body>\n"
    for second, place in (("1 2", ("part.xml", 2)), ("3 2", ("a.xml", None))):
        Path("part.xml").write_text(part % second + "</worldbody></mujocoinclude>")
        Path("a.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
        (finding,) = lint_file(Path("a.xml"))
        assert (finding.code, finding.file, finding.line) == ("MJ303", *place)


def failing(text: str) -> CompileFailure:
    """The error of the model `text`."""
    path = Path(write("model.xml", text))
    with pytest.raises(BrokenModelError) as error:
        load(path)
    return CompileFailure.of(error.value, read_xml(path))


def test_the_message_is_that_of_mujoco_on_one_line() -> None:
    text = mjcf('<geom name="g" size="-1"/>')
    error = failing(text)
    with pytest.raises(ValueError) as raised:  # noqa: PT011
        mujoco.MjModel.from_xml_string(text)
    assert "\n" not in error.message
    assert error.text in str(raised.value)


@pytest.mark.parametrize(
    ("body", "line"),
    [
        ('<geom size="1"/>\n<geom name="g" size="-1"/>', 5),
        ('<geom size="1"/><geom name="g" type="box" size="1 -1 1"/>', 4),
        ('<geom size="1"/>\n<geom size="1" material="m"/>', 5),
    ],
)
def test_the_element_is_the_one_on_its_line(body: str, line: int) -> None:
    element = failing(mjcf(body)).element()
    assert element is not None
    assert (element.tag, element.line) == ("geom", line)


def test_in_an_included_file_whose_lines_mujoco_forgets_the_element_is_found_by_its_name() -> None:
    write("part.xml", '<mujocoinclude>\n<geom name="g" size="-1"/></mujocoinclude>')
    element = failing(mjcf('<include file="part.xml"/>')).element("g")
    assert element is not None
    assert (element.file, element.line) == (Path("part.xml"), 2)


def test_the_line_is_given_only_if_it_cannot_be_one_of_an_attached_model() -> None:
    assert failing(mjcf('<geom size="1" siez="1"/>')).place.line == 4
    Path("sub").mkdir()
    write("sub/arm.xml", attached_arm())
    assert failing(PARENT.replace('<geom size="1"/><site/>', '<geom size="1" siez="1"/><site/>')).place.line is None


def test_the_pattern_of_an_error_is_the_same_in_the_model_and_in_one_that_attaches_it() -> None:
    Path("sub").mkdir()
    arm = write("sub/arm.xml", attached_arm('mass="-1"'))
    with pytest.raises(BrokenModelError) as error:
        load(Path(arm))
    own = CompileFailure.of(error.value, read_xml(Path(arm)))
    assert own.pattern in failing(PARENT).pattern


def test_a_finding_is_in_the_element_and_without_one_at_the_place() -> None:
    error = failing(mjcf('<geom name="g" size="-1"/>'))
    assert error.finding(PLAIN, "m", "r").object == '<geom name="g">'
    unknown = error._replace(line=None)
    finding = unknown.finding(PLAIN, "m", "r", "no such value")
    assert (finding.object, finding.file, finding.line) == ("", "model.xml", None)


def test_advice_that_names_options_is_no_part_of_the_message() -> None:
    path = Path("model.xml")
    hint = f"{option('root')} chooses a folder"
    error = CompileFailure.of(BrokenModelError(path, "'x.stl' lies outside", 1, hint), XmlSource(path))
    assert (error.message, error.hint) == ("'x.stl' lies outside", hint)
