"""Theorems about the places of objects in XML."""

from pathlib import Path

from mjrun.check.context import CheckContext
from mjrun.check.rule import Finding
from mjrun.check.rule_table import RULES
from mjrun.model.xml_source import read_xml
from tests.check.models import MESH, arms, attaching, lint, mjcf, write


def test_lines_are_those_of_included_files_too() -> None:
    Path("parts").mkdir()
    Path("parts/arm.xml").write_text(
        '<mujocoinclude>\n<body name="b">\n<joint name="j" range="2 1"/>\n<geom size="1"/></body>\n</mujocoinclude>'
    )
    findings = lint(mjcf('<include file="parts/arm.xml"/>'))
    assert [(f.code, f.file, f.line) for f in findings] == [("MJ302", "parts/arm.xml", 3)]


def test_a_mesh_without_a_name_is_at_the_line_of_its_file_in_an_included_model() -> None:
    Path("part.xml").write_text('<mujocoinclude><asset>\n<mesh file="yes.obj"/></asset></mujocoinclude>')
    write("yes.obj", MESH)
    geom = '<geom type="mesh" mesh="yes"/>'
    path = Path(write("model.xml", mjcf(f"<body><joint/>{geom}</body>", before='<include file="part.xml"/>')))
    place = CheckContext.load(path, read_xml(path)).place("mesh", 0)
    assert (place.file, place.line) == (Path("part.xml"), 2)


def test_objects_without_names_on_one_line_are_told_apart_by_their_order() -> None:
    joints = '<joint range="0 1"/><joint axis="1 0 0" range="0 2"/>'
    path = Path(write("model.xml", mjcf(f'<body>{joints}<geom size="1"/><body>{joints}<geom size="1"/></body></body>')))
    context = CheckContext.load(path, read_xml(path))
    elements = [context.element("joint", i) for i in range(context.model.njnt)]
    assert [each and each.attributes["range"].split()[1] for each in elements] == ["1", "2"] * 2
    assert len({id(each) for each in elements}) == 4


def reversed_ranges(text: str) -> list[Finding]:
    """All findings of MJ302, which a check merges."""
    path = Path(write("model.xml", text))
    return list(RULES["MJ302"].findings(CheckContext.load(path, read_xml(path))))


def test_what_is_attached_is_told_where_the_model_attaches_it_with_its_origin() -> None:
    findings = reversed_ranges(arms(f"{attaching('l_')}\n{attaching('right_')}"))
    assert [(f.object, f.file, f.line) for f in findings] == [
        ("joint 'l_j'", "model.xml", 5),
        ("joint 'right_j'", "model.xml", 7),
    ]
    assert [f.message.rpartition(" (")[2] for f in findings] == ["attached from arm.xml:5)"] * 2


def test_where_it_is_not_clear_what_attached_an_object_only_the_file_is_told() -> None:
    text = arms(f"{attaching('l_')}\n{attaching('right_')}").replace('name="arm"', "")
    Path("arm.xml").write_text(
        Path("arm.xml").read_text().replace('name="j" ', "").replace("<mujoco", '<mujoco model="arm"')
    )
    assert [(f.file, f.line) for f in reversed_ranges(text)] == [("model.xml", None)] * 2


def test_the_origin_of_what_is_attached_is_the_element_whose_name_is_closest() -> None:
    keys = '<keyframe>\n<key name="k"/>\n<key name="k2" qpos="2"/>\n<key qpos="3"/></keyframe>'
    text = arms(attaching("l_"), keys, 'range="-1 1"', '<compiler angle="radian"/>')
    origins = {f.object: f.message.rpartition(" from ")[2] for f in lint(text)}
    assert origins == {"keyframe 'l_k2'": "arm.xml:9)", "keyframe 'l_'": "arm.xml:10)"}
