"""Theorems about the rules: each finds what it is for, at its line, and nothing in a model that is well."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mjrun.check.context import LintContext
from mjrun.check.finding import SEVERITIES, Finding, Sighting
from mjrun.check.model_files import found_models, root_tag
from mjrun.check.rule_table import CRASHED, FAILED, MEMORY, MOST, RULES, TIMED_OUT, capped, dangers, inspect
from mjrun.check.rules import contacts, keywords, mjcf_schema
from mjrun.check.xml_source import Element, read
from mjrun.errors import ModelError
from mjrun.model.load import load

ROOT = Path(__file__).parents[2]
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


def mjcf(body: str, after: str = "", before: str = "") -> str:
    """A model whose world holds `body` from line 4 on."""
    return f"<mujoco>\n{before}\n<worldbody>\n{body}\n</worldbody>\n{after}\n</mujoco>"


def hinged(joint: str = "", geom: str = 'size=".1"', after: str = "", before: str = "", world: str = "") -> str:
    """A body `b` with a joint `j` and a geom `g`."""
    return mjcf(f'<body name="b">\n<joint name="j" {joint}/>\n<geom name="g" {geom}/>\n</body>\n{world}', after, before)


def keyed(key: str, joint: str = 'range="-1 1"', before: str = '<compiler angle="radian"/>') -> str:
    motor = '<actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator>'
    return hinged(joint, after=f"{motor}\n<keyframe>\n<key name='k' {key}/></keyframe>", before=before)


def pair(size: str) -> str:
    """A sphere of 1 m that turns, and on it one of `size` that turns by itself."""
    small = f'<body name="q"><joint name="q"/>\n<geom size="{size}"/></body>'
    return f'<body name="r"><joint name="r"/><geom size="1"/>\n{small}</body>'


def driven(motor: str) -> str:
    return hinged(after=f'<actuator>\n<motor name="m" joint="j" {motor}/></actuator>')


def looking(camera: str, geom: str = 'pos="0 0 -3" size=".1"') -> str:
    return mjcf(f'<geom {geom}/>\n<camera name="eye" {camera}/>')


def apart(gap: float) -> str:
    """Two spheres of radius 0.1 m, `gap` [m] apart, the first of which can move."""
    return hinged(
        'type="slide" axis="1 0 0"', world=f'<geom name="h" size=".1" pos="{0.2 + gap} 0 0"/>', before="<option/>"
    )


def stiff(solref: str, option: str = 'timestep=".002"') -> str:
    return hinged(geom=f'size=".1" solref="{solref}"', before=f"<option {option}/>")


@dataclass(frozen=True)
class Case:
    """A model that the rule `code` finds something in, at `line`, saying `told`; and one like it that is well."""

    code: str
    bad: str
    line: int | None
    told: str
    good: str


FINE = hinged()
CASES = [
    Case("MJ100", mjcf("<joint/>"), 4, "World body cannot have joints", FINE),
    Case(
        "MJ101", mjcf('<body name="x"><geom size="1"/>'), 4, '<body name="x"> is not closed before </worldbody>', FINE
    ),
    Case("MJ101", "<mujoco>\n<worldbody>\n<body>", 3, "the file ends before <body> is closed", "<mujoco/>"),
    Case("MJ101", mjcf("</bodies>"), 4, "</bodies> closes nothing: the element that is open is <worldbody>", FINE),
    Case("MJ101", mjcf('<geom size="1" size="2"/>'), 4, "duplicate attribute", mjcf('<geom size="1"/>')),
    Case("MJ101", "", 1, "the file is empty", "<mujoco/>"),
    Case("MJ102", mjcf("", "<solver/>"), 6, "<mujoco> holds no element <solver>", mjcf("", '<option solver="CG"/>')),
    Case("MJ102", mjcf('<goem size="1"/>'), 4, "holds no element <goem> (did you mean 'geom'?)", FINE),
    Case("MJ103", mjcf("<actuator/>"), 4, "<actuator> stands in <worldbody>, and belongs directly in <mujoco>", FINE),
    Case("MJ103", mjcf("", "<motor/>"), 6, "<motor> stands in <mujoco>, and belongs directly in <actuator>", FINE),
    Case("MJ104", mjcf('<geom siez="1"/>'), 4, "<geom> has no attribute 'siez' (did you mean 'size'?)", FINE),
    Case("MJ104", mjcf('<frame>\n<geom size="1" siez="1"/></frame>'), 5, "<geom> has no attribute 'siez'", FINE),
    Case("MJ105", mjcf('<composite type="cable"/>'), 4, "<composite> was removed in MuJoCo 4.0.0", FINE),
    Case("MJ105", mjcf("", '<equality><flexvert flex="f"/></equality>'), 6, "<flexvert> was removed", FINE),
    Case("MJ105", mjcf("", '<option apirate="1"/>'), 6, "the attribute 'apirate' of <option> was removed", FINE),
    Case(
        "MJ105",
        mjcf("", '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'),
        6,
        "plugin='mujoco.elasticity.cable' of <plugin> was removed in MuJoCo 4.0.0",
        FINE,
    ),
    Case(
        "MJ106",
        mjcf("", "<contact>\n<friction>0.3</friction></contact>"),
        7,
        "<friction> is written as an element, and is an attribute of <pair>",
        mjcf('<geom name="g" size="1"/>', '<contact><pair geom1="g" geom2="g" friction="0.3"/></contact>'),
    ),
    Case("MJ106", mjcf("", "garbage"), 6, "text between the tags of <mujoco>: 'garbage'", FINE),
    Case("MJ106", mjcf('<geom size="1">0.3</geom>'), 4, "text between the tags of <geom>: '0.3'", FINE),
    Case(
        "MJ107",
        mjcf("", '<asset>\n<mesh file="no.obj"/></asset>', '<compiler meshdir="m"/>'),
        7,
        "no file 'no.obj' for <mesh>; tried m/no.obj",
        mjcf("", '<asset><mesh file="yes.obj"/></asset>'),
    ),
    Case("MJ107", mjcf("", '<include file="no.xml"/>'), 6, "no file 'no.xml' for <include>; tried no.xml", FINE),
    Case("MJ108", mjcf('<site name="a"/>\n<site name="a"/>'), 5, "the name 'a' is already taken on line 4", FINE),
    Case("MJ109", hinged(after='<sensor><jointpos joint="jj"/></sensor>'), 10, "(did you mean 'j'?)", FINE),
    Case("MJ109", mjcf('<geom class="c" size="1"/>'), 4, "unknown default class name 'c'", FINE),
    Case("MJ110", mjcf('<geom type="shere" size="1"/>'), 4, "type of <geom>: no such keyword: 'shere'", FINE),
    Case(
        "MJ110", hinged('limited="yes"'), 5, "limited of <joint>: no such keyword: 'yes' (did you mean 'true'?)", FINE
    ),
    Case("MJ110", mjcf('<geom pos="1 2" size="1"/>'), 4, "'pos' does not have enough data: '1 2'", FINE),
    Case("MJ111", mjcf("", "<option>\n<flag/>\n<flag/></option>"), 8, "<flag> stands in <option> more than once", FINE),
    Case("MJ112", mjcf('<replicate><geom size="1"/></replicate>'), 4, "<replicate> needs the attribute 'count'", FINE),
    Case("MJ114", hinged(before='<option timestep="0"/>'), 2, "its timestep is 0, and must be positive", FINE),
    Case("MJ114", hinged(before='<option timestep="-1"/>'), 2, "its timestep is -1", FINE),
    Case("MJ201", mjcf('<camera/><geom size="1"/>'), 4, "1 camera without a name: camera:0", FINE),
    Case("MJ201", FINE.replace('name="j"', "").replace('name="b"', ""), 5, "1 joint without a name", FINE),
    Case("MJ202", hinged(geom='size=".1" mass="0"'), 4, '<body name="b"> can move and has no mass', FINE),
    Case(
        "MJ203",
        mjcf('<body name="b"><joint name="j"/><geom size=".1"/>\n<geom name="g" size=".1" mass="0"/></body>'),
        5,
        "it collides, and adds no mass to 'b'",
        mjcf(
            '<body><freejoint name="j"/><geom size=".1"/><geom size=".1" mass="0" contype="0" conaffinity="0"/></body>'
        ),
    ),
    Case(
        "MJ204",
        hinged(geom='type="capsule" size=".0001 1"'),
        4,
        "differ by a factor of",
        hinged(geom='type="capsule" size=".01 1"'),
    ),
    Case(
        "MJ205",
        mjcf(pair(".001")),
        5,
        "and joint 'r' of the same tree",
        mjcf(pair(".5")),
    ),
    Case("MJ301", driven(""), 11, "it has neither ctrlrange nor forcerange", driven('ctrlrange="-1 1"')),
    Case("MJ301", driven('gear="2"'), 11, "nothing bounds what it does", driven('forcerange="-1 1"')),
    Case("MJ302", hinged('range="1 -1"'), 5, "is reversed, and limits nothing", hinged('range="-1 1"')),
    Case("MJ302", driven('ctrlrange="1 -1"'), 11, "its ctrlrange 1 -1 is reversed", driven('ctrlrange="-1 1"')),
    Case(
        "MJ303",
        hinged('limited="true"'),
        5,
        "it is limited and has no range, or a reversed one",
        hinged('limited="false"'),
    ),
    Case(
        "MJ303",
        hinged('range="-1 1"', before='<compiler autolimits="false"/>'),
        5,
        "joint has `range` but not `limited`: is it limited or not?",
        hinged('range="-1 1" limited="true"', before='<compiler autolimits="false"/>'),
    ),
    Case("MJ304", hinged('type="slide" range="1 2"'), 5, "it starts at 0 m, outside [1, 2]", hinged('range="-1 2"')),
    Case("MJ304", hinged('ref="90" range="0 60"'), 5, "it starts at 1.571 rad, outside [0, 1.047]", FINE),
    Case(
        "MJ305",
        hinged('range="-1.57 1.57"'),
        5,
        "its range -1.57 1.57 is in degrees, and looks like radians",
        hinged('range="-1.57 1.57"', before='<compiler angle="radian"/>'),
    ),
    Case(
        "MJ305",
        hinged('range="0 90"', before='<compiler angle="radian"/>'),
        5,
        "its range 0 90 is in radians, and looks like degrees",
        hinged('range="0 90"'),
    ),
    Case("MJ401", keyed('qpos="nan"'), 12, "qpos[0] is nan", keyed('qpos="0"')),
    Case("MJ401", keyed('qvel="1e20"'), 12, "qvel[0] is 1e+20", keyed('qvel="1e9"')),
    Case("MJ402", keyed('qpos="1.1"'), 12, "joint 'j' is at 1.1 rad, outside [-1, 1]", keyed('qpos="1"')),
    Case(
        "MJ403",
        keyed('ctrl="2"'),
        12,
        "the control of actuator 'm' is at 2, outside [-1, 1]; MuJoCo clamps",
        keyed('ctrl="1"'),
    ),
    Case(
        "MJ404",
        keyed('qpos="2 0 0 0"', 'type="ball"'),
        12,
        "the quaternion of joint 'j' has length 2, and not 1",
        keyed('qpos=".6 .8 0 0"', 'type="ball"'),
    ),
    Case(
        "MJ405", keyed('qpos="0 0"'), 12, "qpos of the keyframe holds 2 numbers, and the model has 1", keyed('qpos="0"')
    ),
    Case(
        "MJ405", keyed('ctrl="0 0"'), 12, "ctrl of the keyframe holds 2 numbers, and the model has 1", keyed('ctrl="0"')
    ),
    Case("MJ405", keyed('act="0"'), 12, "act of the keyframe holds 1 number", keyed('act=""')),
    Case("MJ405", keyed('mpos="0 0 0"'), 12, "mpos of the keyframe holds 3 numbers, and the model has 0", keyed("")),
    Case("MJ405", keyed('mquat="1 0"'), 12, "mquat of the keyframe holds 2 numbers, and the model has 0", keyed("")),
    Case(
        "MJ405",
        keyed('qpos="1 0 0"', 'type="ball"'),
        12,
        "qpos of the keyframe holds 3 numbers, and the model has 4; MuJoCo takes qpos0 for the rest",
        keyed('qpos="1 0 0 0"', 'type="ball"'),
    ),
    Case("MJ501", apart(-0.02), 6, "at the start it lies 0.02 m deep in geom 'h', 20 %", apart(-0.001)),
    Case("MJ502", apart(-0.15), 4, "throws it with", apart(-0.001)),
    Case(
        "MJ503",
        stiff(".003 1"),
        6,
        "solref='0.003 1' is too stiff for the timestep 0.002 s: MuJoCo takes 0.004",
        stiff(".004 1"),
    ),
    Case("MJ601", looking('zaxis="0 0 -1"'), 5, "it sees nothing", looking('zaxis="0 0 1"')),
]


def found(text: str, folder: Path) -> list[Finding]:
    """What is found in the model `text`, as `model.xml` in `folder`, which is the working directory."""
    (folder / "yes.obj").write_text(MESH)
    path = Path("model.xml")
    path.write_text(text)
    return inspect(path)


@pytest.fixture(autouse=True)
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.filterwarnings("ignore:XML contains a 'NaN'")
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.code} {case.told[:40]}")
def test_a_rule_finds_what_it_is_for_at_its_line_and_nothing_in_a_model_that_is_well(
    case: Case, workplace: Path
) -> None:
    told = [finding for finding in found(case.bad, workplace) if finding.code == case.code]
    assert [finding.line for finding in told] == [case.line]
    assert case.told in told[0].message
    assert told[0].file == "model.xml"
    assert told[0].severity in SEVERITIES
    assert told[0].remedy
    assert [finding for finding in found(case.good, workplace) if finding.code == case.code] == []


def test_every_code_has_a_model_here_but_those_that_only_a_process_or_a_step_can_show() -> None:
    elsewhere = {CRASHED, TIMED_OUT, MEMORY, FAILED, "MJ001", "MJ113", "MJ115"}
    elsewhere |= {code for code in RULES if code.startswith("MJ7")}
    assert {case.code for case in CASES} | elsewhere == set(RULES)


def test_scenes_of_mjrun_hold_no_errors() -> None:
    for scene in sorted((ROOT / "scenes").glob("*.xml")):
        assert [finding for finding in inspect(scene) if finding.severity == "error"] == [], scene


@pytest.mark.filterwarnings("ignore:Attach conflict")
def test_models_that_load_hold_no_errors_and_those_that_do_not_are_explained(shared_models: Path) -> None:
    for path in sorted(shared_models.rglob("*.xml")):
        try:
            load(path)
            loads = True
        except ModelError:
            loads = False
        errors = [finding for finding in inspect(path) if finding.severity == "error"]
        assert (errors == []) == loads, path


def test_the_users_own_mistakes_are_explained_all_at_once(workplace: Path) -> None:
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
    findings = found(text, workplace)
    codes = ["MJ103", "MJ104", "MJ106", "MJ106", "MJ106", "MJ102", "MJ102"]
    assert [(f.line, f.code) for f in findings] == list(zip([4, 4, 9, 10, 11, 12, 14], codes, strict=True))
    assert findings[0].remedy == "move <actuator> … </actuator> out of <worldbody>, directly into <mujoco>"
    assert findings[1].remedy.endswith("write it on <motor name=…>")
    assert 'write <pair geom1="one" geom2="two" friction="0.3 0.01 0.001"/>' in findings[4].remedy
    assert "solref" in findings[5].remedy
    assert '<option solver="Newton" iterations="100"' in findings[6].remedy


Told = tuple[int | None, str, str]
KEYWORDS: list[tuple[str, list[Told]]] = [
    (
        '<option integrator="rk4" solver="newton"/>',
        [
            (
                6,
                "integrator of <option>: no such keyword: 'rk4' (did you mean 'RK4'?)",
                'write integrator="RK4"; valid: Euler, RK4, implicit, implicitfast, discrete',
            ),
            (
                6,
                "solver of <option>: no such keyword: 'newton' (did you mean 'Newton'?)",
                'write solver="Newton"; valid: PGS, CG, Newton',
            ),
        ],
    ),
    (
        '<option solver="Newtons"/>\n<compiler angle="radians"/>',
        [
            (
                6,
                "solver of <option>: no such keyword: 'Newtons' (did you mean 'Newton'?)",
                'write solver="Newton"; valid: PGS, CG, Newton',
            ),
            (
                7,
                "angle of <compiler>: no such keyword: 'radians' (did you mean 'radian'?)",
                'write angle="radian"; valid: radian, degree',
            ),
        ],
    ),
    (
        '<option><flag contact="off"/></option>',
        [
            (
                6,
                "contact of <flag>: no such keyword: 'off' (did you mean 'disable'?)",
                'write contact="disable"; valid: enable, disable',
            )
        ],
    ),
    (
        '<asset><texture type="2D" builtin="xxx" width="2" height="2"/></asset>',
        [
            (
                6,
                "type of <texture>: no such keyword: '2D' (did you mean '2d'?)",
                'write type="2d"; valid: 2d, cube, skybox',
            ),
            (
                6,
                "builtin of <texture>: no such keyword: 'xxx'",
                "valid: none, gradient, checker, flat",
            ),
        ],
    ),
    (
        '<default><geom type="cube" pos="0 0 0"/>\n<camera output="rgb deep"/></default>',
        [
            (
                6,
                "type of <geom>: no such keyword: 'cube' (did you mean 'box'?)",
                'write type="box"; valid: plane, hfield, sphere, capsule, ellipsoid, cylinder, box, mesh, sdf',
            ),
            (
                7,
                "output of <camera>: no such keyword: 'deep' (did you mean 'depth'?)",
                'write output="depth"; valid: rgb, depth, distance, normal, segmentation',
            ),
        ],
    ),
]


@pytest.mark.parametrize(("text", "told"), KEYWORDS, ids=lambda given: given if isinstance(given, str) else "")
def test_all_wrong_keywords_are_told_as_xml_spells_them(text: str, told: list[Told], workplace: Path) -> None:
    findings = found(mjcf("", text), workplace)
    assert {(f.code, f.file) for f in findings} == {("MJ110", "model.xml")}
    assert [(f.line, f.message, f.remedy) for f in findings] == told


def test_keywords_are_told_beside_what_else_the_xml_has_wrong(workplace: Path) -> None:
    findings = found(mjcf('<geom typ="box"/>\n<geom type="Box"/>'), workplace)
    assert [(f.line, f.code) for f in findings] == [(4, "MJ104"), (5, "MJ110")]


HOMES = {tag: places for tag, places in mjcf_schema._places().items() if tag != "model"}  # whose files it would open
NEEDED = {
    "flexcomp": {"type": "grid", "count": "3 3 3", "spacing": "1 1 1", "name": "f"},
    "connect": {"site1": "s", "site2": "s"},
    "weld": {"site1": "s", "site2": "s"},
    "rangefinder": {"site": "s"},
    **{tag: {"geom1": "g", "geom2": "g"} for tag in ("distance", "normal", "fromto")},
}

HOLDING = {"flex": {"body": "b", "dim": "1", "element": "0 1", "vertex": "0 0 0 1 1 1"}}  # that hold something else


def chain(parent: str) -> list[str]:
    """The tags from the root to `parent`, not through frames or defaults if there is another way."""
    if parent == "mujoco":
        return [parent]
    above = [home for home, _ in HOMES[parent] if home not in (parent, "frame", "replicate")]
    return [*chain("body" if "body" in above else above[0]), parent]


def mujocos_word_on(path: list[str], attribute: str, value: str) -> str:
    """What MuJoCo says of `value`, after all that the elements on `path` need is given."""
    given = [{**NEEDED.get(tag, {}), **HOLDING.get(tag, {})} for tag in path]
    given[-1] = {**NEEDED.get(path[-1], {}), attribute: value}
    if attribute == "reftype":
        given[-1] |= {"objtype": "site", "objname": "s", "refname": "s"}
    while True:
        attributes = [" ".join(f'{name}="{said}"' for name, said in each.items()) for each in given]
        text = "".join(f"<{tag} {said}>" for tag, said in zip(path, attributes, strict=True))
        try:
            mujoco.MjSpec.from_string(text + "".join(f"</{tag}>" for tag in reversed(path)))
        except ValueError as error:
            needed = re.search(r"required attribute missing: '(\w+)'", str(error))
            if not needed or needed[1] in given[-1]:
                return str(error)
            given[-1][needed[1]] = "1"
        else:
            return ""


def test_keywords_are_those_of_mujoco_wherever_it_takes_any() -> None:
    homes = [(parent, tag, node) for tag, places in HOMES.items() for parent, node in places]
    for parent, tag, node in homes:
        if parent in ("worldbody", "frame", "replicate"):  # which hold what a body holds
            continue
        path = [*chain(parent), tag]
        for attribute in node.attributes:
            choices = keywords.valid(Element(tag, {}, Path(), 1), attribute)
            refused = re.search(r"invalid keyword: '(zzz|\(null\))'", mujocos_word_on(path, attribute, "zzz"))
            assert bool(choices) == bool(refused), (path, attribute)
            for choice in choices:
                sentence = f"invalid keyword: '{choice}'"
                assert sentence not in mujocos_word_on(path, attribute, choice), (path, attribute)


NODES = {tag: node for tag, places in mjcf_schema._places().items() for _, node in places}
SPECIAL = ("mujoco", "worldbody", "body", "frame", "replicate", "include")
TAGS = sorted(set(NODES) - set(SPECIAL))
NAMES = sorted({name for node in NODES.values() for name in node.attributes})


@st.composite
def documents(draw: st.DrawFn, tag: str = "mujoco", depth: int = 3) -> str:
    """XML that mostly keeps to the schema; its values mean nothing."""
    node = mjcf_schema.schema().children["mujoco"] if tag == "mujoco" else NODES[tag]
    valid = sorted(set(node.children) - set(SPECIAL))
    child = st.sampled_from(valid * 200 + TAGS if valid else TAGS)
    tags = draw(st.lists(child, max_size=3 if valid else 0)) if depth else []
    name = st.sampled_from(sorted(node.attributes) * 100 + NAMES)
    attributes = " ".join(f'{n}="1"' for n in draw(st.sets(name, max_size=3)))
    inner = "".join(draw(documents(t, depth - 1)) for t in tags)
    return f"<{tag} {attributes}>{inner}</{tag}>"


@given(documents())
def test_the_schema_is_violated_exactly_where_mujoco_says_so(text: str) -> None:
    path = Path("drawn.xml")
    path.write_text(text)
    try:
        mujoco.MjSpec.from_string(text)
        said = ""
    except ValueError as error:
        said = str(error)
    assume("can be specified" not in said and "must be specified" not in said)  # combinations, which no schema lists
    found = list(mjcf_schema.violations(read(path)))
    assert bool(found) == ("Schema violation" in said), (found, said)


def test_lines_are_those_of_included_files_too(workplace: Path) -> None:
    (workplace / "parts").mkdir()
    (workplace / "parts/arm.xml").write_text(
        '<mujocoinclude>\n<body name="b">\n<joint name="j" range="2 1"/>\n<geom size="1"/></body>\n</mujocoinclude>'
    )
    findings = found(mjcf('<include file="parts/arm.xml"/>'), workplace)
    assert [(f.code, f.file, f.line) for f in findings] == [("MJ302", "parts/arm.xml", 3)]


def arms(attach: str, key: str = "", joint: str = 'range="2 1"', before: str = "") -> str:
    """Writes a model `arm.xml`, whose joint is on line 5, and makes one that attaches it by `attach` from line 4 on."""
    text = mjcf(f'<body name="b">\n<joint name="j" {joint}/><geom size="1"/></body>', key, before)
    Path("arm.xml").write_text(text)
    return mjcf(attach, before=f'{before}<asset><model name="arm" file="arm.xml"/></asset>')


def attaching(prefix: str) -> str:
    return f'<body pos="9 0 {len(prefix)}">\n<attach model="arm" body="b" prefix="{prefix}"/></body>'


def test_what_is_attached_is_told_where_the_model_attaches_it_with_its_origin(workplace: Path) -> None:
    findings = found(arms(f"{attaching('l_')}\n{attaching('right_')}"), workplace)
    assert [(f.object, f.file, f.line) for f in findings] == [
        ("joint 'l_j'", "model.xml", 5),
        ("joint 'right_j'", "model.xml", 7),
    ]
    assert [f.message.rpartition(" (")[2] for f in findings] == ["attached from arm.xml:5)"] * 2


def test_where_it_is_not_clear_what_attached_an_object_only_the_file_is_told(workplace: Path) -> None:
    text = arms(f"{attaching('l_')}\n{attaching('right_')}").replace('name="arm"', "")
    Path("arm.xml").write_text(
        Path("arm.xml").read_text().replace('name="j" ', "").replace("<mujoco", '<mujoco model="arm"')
    )
    findings = [f for f in found(text, workplace) if f.code == "MJ302"]
    assert [(f.file, f.line) for f in findings] == [("model.xml", None)] * 2


@pytest.mark.parametrize("name", ['name="k"', ""])
def test_a_number_of_an_attached_keyframe_is_told_by_its_joint(name: str, workplace: Path) -> None:
    key = f'<keyframe><key {name} qpos="2"/></keyframe>'
    text = arms(f"{attaching('l_')}\n{attaching('r_')}", key, 'range="-1 1"', '<compiler angle="radian"/>')
    findings = [f for f in found(text, workplace) if f.code == "MJ402"]
    assert [f.object for f in findings] == [f"keyframe '{side}_{'k' * bool(name)}'" for side in "lr"]
    assert [f.message.partition(" is at")[0] for f in findings] == ["joint 'l_j'", "joint 'r_j'"]
    assert {f.remedy for f in findings} == {
        "change the position of the joint in the keyframe, or the range of the joint"
    }


def test_the_origin_of_what_is_attached_is_the_element_whose_name_is_closest(workplace: Path) -> None:
    keys = '<keyframe>\n<key name="k"/>\n<key name="k2" qpos="2"/>\n<key qpos="3"/></keyframe>'
    text = arms(attaching("l_"), keys, 'range="-1 1"', '<compiler angle="radian"/>')
    told = {f.object: f.message.rpartition(" from ")[2] for f in found(text, workplace)}
    assert told == {"keyframe 'l_k2'": "arm.xml:9)", "keyframe 'l_'": "arm.xml:10)"}


def test_a_number_of_a_keyframe_of_the_model_is_told_by_its_place(workplace: Path) -> None:
    (beyond,) = found(keyed('qpos="2"'), workplace)
    assert beyond.remedy == "change qpos[0] in the keyframe, or the range of the joint"


@pytest.mark.parametrize("where", ["included", "attaching"])
def test_a_keyframe_need_not_be_complete_where_other_files_add_joints(where: str, workplace: Path) -> None:
    more = '<body><freejoint name="f"/><geom size=".1" pos="9 0 0"/></body>'
    key = '<keyframe><key name="k" qpos="1"/></keyframe>'
    if where == "included":
        Path("arm.xml").write_text(hinged(after=key))
        text = mjcf(more, '<include file="arm.xml"/>')
    else:
        text = arms(more + attaching("l_"), joint="").replace("</mujoco>", f"{key}</mujoco>")
    assert found(text, workplace) == []
    assert load(Path("model.xml")).nq > 1


PARENT = mjcf(
    '<geom size="1"/>\n<geom size="1"/><site/>\n<attach model="arm" body="arm" prefix="left_"/>',
    before='<asset><model name="arm" file="sub/arm.xml"/></asset>',
)


def attached_arm(geom: str = 'size="1"', asset: str = "") -> str:
    """What `PARENT` attaches: a geom on line 5, where the parent has one too."""
    return mjcf(f'<body name="arm">\n<geom name="g" {geom}/>\n</body>', before=f"<asset>{asset}</asset>")


@pytest.mark.parametrize(
    "arm",
    [
        attached_arm('type="boxx"'),
        attached_arm('siez="1"'),
        attached_arm('class="c"'),
        attached_arm('material="no"'),
        attached_arm('mass="-1"'),
        attached_arm('type="mesh"'),
        attached_arm('type="mesh" mesh="m"', '<mesh name="m" file="no.obj"/>'),
        attached_arm(">"),
        attached_arm('pos="1"'),
        "",
        "version https://git-lfs.github.com/spec/v1\n",
        "<mujocoinclude/>",
    ],
)
def test_a_mistake_in_an_attached_model_is_told_as_of_that_model_itself(arm: str, workplace: Path) -> None:
    (workplace / "sub").mkdir()
    path = Path("sub/arm.xml")
    path.write_text(arm)
    told = inspect(path)
    assert found(PARENT, workplace) == told
    assert {(f.file, f.severity) for f in told} == {("sub/arm.xml", "error")}
    between = PARENT.replace("sub/arm.xml", "deep.xml").replace('"left_"/>', '"low_"/></body>')
    path.write_text(between.replace("<attach", '<body name="arm"><attach'))
    Path("sub/deep.xml").write_text(arm)
    assert found(PARENT, workplace) == inspect(Path("sub/deep.xml")) != []


@pytest.mark.parametrize(
    ("parent", "line", "told", "remedy"),
    [
        (
            PARENT.replace('model="arm"', 'model="arn"'),
            6,
            "could not find model 'arn' (did you mean 'arm'?)",
            "write 'arm'",
        ),
        (
            PARENT.replace('model="arm"', 'model="x"'),
            6,
            "could not find model 'x'",
            "names of kind model: arm",
        ),
        (
            PARENT.replace('body="arm"', 'body="amr"'),
            6,
            "could not find body 'amr' in model asset 'arm' (did you mean 'arm'?)",
            "write 'arm'",
        ),
    ],
)
def test_what_cannot_be_attached_is_told_with_what_can(
    parent: str, line: int, told: str, remedy: str, workplace: Path
) -> None:
    (workplace / "sub").mkdir()
    Path("sub/arm.xml").write_text(attached_arm())
    (finding,) = found(parent, workplace)
    assert (finding.code, finding.file, finding.line) == ("MJ109", "model.xml", line)
    assert (finding.message, finding.remedy) == (told, remedy)


@pytest.mark.parametrize("mistake", ['<option solver="x"/>', "<goem/>", "</b>"])
def test_what_mujoco_refuses_before_it_attaches_anything_is_told_first(mistake: str, workplace: Path) -> None:
    (workplace / "sub").mkdir()
    for arm in (attached_arm('type="x"'), attached_arm('siez="1"'), attached_arm("</b>")):
        Path("sub/arm.xml").write_text(arm)
        told = found(PARENT.replace("<asset>", f"{mistake}<asset>"), workplace)
        assert [(f.file, f.line) for f in told] == [("model.xml", 2)]


@pytest.mark.parametrize(
    ("mistake", "line"),
    [('size="1" material="no"', 5), ('name="own" size="-1"', 5), ('size="-1"', None)],  # the last might be the arm's
)
def test_a_model_that_attaches_another_is_never_told_with_its_lines(
    mistake: str, line: int | None, workplace: Path
) -> None:
    (workplace / "sub").mkdir()
    Path("sub/arm.xml").write_text(attached_arm())
    (finding,) = found(PARENT.replace('<geom size="1"/><site/>', f"<geom {mistake}/><site/>"), workplace)
    assert (finding.file, finding.line, finding.severity) == ("model.xml", line, "error")


def test_what_is_replicated_is_told_once_at_the_line_that_says_it(workplace: Path) -> None:
    body = '<body name="b"><joint name="j" range="2 1"/><geom size="1"/></body>'
    findings = found(mjcf(f'<replicate count="5" offset="0 0 3">\n{body}</replicate>'), workplace)
    assert [(f.code, f.line) for f in findings] == [("MJ302", 5)]
    assert findings[0].message.endswith("(and 4 more like it)")


def test_a_missing_file_is_told_with_every_path_that_mujoco_opens_and_what_lies_near(workplace: Path) -> None:
    (workplace / "parts/assets").mkdir(parents=True)
    (workplace / "parts/assets/part.obj").write_text(MESH)
    (workplace / "parts/arm.xml").write_text('<mujocoinclude><asset>\n<mesh file="part.obj"/></asset></mujocoinclude>')
    text = mjcf("", '<include file="parts/arm.xml"/>', '<compiler meshdir="meshes"/>')
    (missing,) = found(text, workplace)
    assert (missing.code, missing.file, missing.line) == ("MJ107", "parts/arm.xml", 2)
    tried = ["meshes/part.obj", "meshes/parts/part.obj"]
    assert missing.message.endswith(f"tried {', '.join(tried)}")
    assert missing.remedy.startswith("there is parts/assets/part.obj;")
    for path in map(Path, tried):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(MESH)
        assert found(text, workplace) == []
        path.unlink()


@pytest.mark.parametrize(
    ("filename", "compiler", "tried"),
    [
        ("meshes/part.stl", "", "meshes/part.stl"),
        ("meshes/part.stl", 'meshdir="mm"', "mm/meshes/part.stl"),
        ("meshes/part.stl", 'meshdir="mm" strippath="true"', "mm/part.stl"),
        ("package://pkg/part.stl", 'meshdir="mm"', "package:/pkg/part.stl"),
        ("package://pkg/part.stl", 'meshdir="mm" strippath="true"', "mm/part.stl"),
    ],
)
def test_files_of_urdf_are_told_as_mujoco_looks_for_them(filename: str, compiler: str, tried: str) -> None:
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    mesh = f'<collision><geometry>\n<mesh filename="{filename}"/></geometry></collision>'
    text = f'<robot name="r"><mujoco><compiler {compiler}/></mujoco><link name="a">{inertia}{mesh}</link></robot>'
    path = Path("r.urdf")
    path.write_text(text)
    with pytest.raises(ModelError, match=f"Error opening file '{tried}'"):
        load(path)
    (missing,) = inspect(path)
    assert (missing.code, missing.line) == ("MJ107", 2)
    assert missing.message.endswith(f"tried {tried}")


@pytest.mark.parametrize(
    ("body", "line", "told", "remedy"),
    [
        (
            '<camera/><body name="q"/>\n<camera mode="targetbody" target="Q"/>',
            5,
            "unknown target body in camera: 'Q' (did you mean 'q'?)",
            "write 'q'",
        ),
        (
            '<body name="q"/>\n<light mode="targetbody" target="none"/>',
            5,
            "unknown target body in light: 'none'",
            "names of kind body: q",
        ),
        (
            '<body name="b">\n<body childclass="smal"/></body>',
            5,
            "unknown default childclass: 'smal' (did you mean 'small'?)",
            "write 'small'",
        ),
    ],
)
def test_a_name_that_mujoco_does_not_tell_is_found(
    body: str, line: int, told: str, remedy: str, workplace: Path
) -> None:
    default = '<default><default class="small"/></default>'
    part = workplace / "part.xml"
    part.write_text(f"<mujocoinclude>\n\n\n{body}\n</mujocoinclude>")
    texts = {"model.xml": mjcf(body, before=default), "part.xml": mjcf('<include file="part.xml"/>', before=default)}
    for file, text in texts.items():
        (finding,) = found(text, workplace)
        assert (finding.code, finding.file, finding.line) == ("MJ109", file, line)
        assert (finding.message, finding.remedy) == (told, remedy)


def test_a_keyframe_without_a_name_is_told_by_its_place(workplace: Path) -> None:
    text = keyed('ctrl="1"').replace("</keyframe>", '\n<key ctrl="1 2"/>\n<key ctrl="1 2 3"/></keyframe>')
    (finding,) = [f for f in found(text, workplace) if f.severity == "error"]
    assert (finding.code, finding.line) == ("MJ405", 13)
    assert finding.message == "ctrl of the keyframe holds 2 numbers, and the model has 1"


LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n"
FORMATS = "MuJoCo reads meshes in STL, OBJ and MSH; convert it to one of them, as Blender does"
CASED = "there is Meshes/Base.obj: capitals and small letters differ in names of files and folders"
POINTS = "is a pointer of Git LFS, and not the file itself"
PULLED = "fetch the file itself: git lfs pull"


@pytest.mark.parametrize(
    ("asset", "code", "told", "remedy"),
    [
        ("lfs.obj", "MJ107", f"'lfs.obj' of <mesh> {POINTS}", PULLED),
        ("lfs.stl", "MJ107", f"'lfs.stl' of <mesh> {POINTS}", PULLED),
        ("meshes/base.obj", "MJ107", "no file 'meshes/base.obj' for <mesh>; tried meshes/base.obj", CASED),
        ("Meshes/base.OBJ", "MJ107", "no file 'Meshes/base.OBJ' for <mesh>; tried Meshes/base.OBJ", CASED),
        ("meshes\\Base.obj", "MJ107", r"no file 'meshes\Base.obj' for <mesh>; tried meshes/Base.obj", CASED),
        ("arm.dae", "MJ100", "MuJoCo refuses the model: no decoder found for mesh file 'arm.dae'", FORMATS),
    ],
)
def test_a_mesh_that_is_no_mesh_is_told_with_what_to_do(
    asset: str, code: str, told: str, remedy: str, workplace: Path
) -> None:
    (workplace / "Meshes").mkdir()
    texts = {"lfs.obj": LFS, "lfs.stl": LFS, "Meshes/Base.obj": MESH, "arm.dae": "<COLLADA/>"}
    for name, text in texts.items():
        Path(name).write_text(text)
    (finding,) = found(mjcf("", f'<asset>\n<mesh file="{asset}"/></asset>'), workplace)
    assert (finding.code, finding.file, finding.line) == (code, "model.xml", 7)
    assert (finding.message, finding.remedy) == (told, remedy)


def test_backslashes_part_folders_for_mujoco_and_for_the_rules(workplace: Path) -> None:
    (workplace / "sub").mkdir()
    part = '<mujocoinclude>\n<body name="p"><joint name="p" range="2 1"/>{}</body></mujocoinclude>'
    Path("sub/part.obj").write_text(MESH)
    text = mjcf('<include file="sub\\part.xml"/>', '<asset><mesh name="m" file="sub\\part.obj"/></asset>')
    for geom, code in (('<geom type="mesh" mesh="m"/>', "MJ302"), ("", "MJ202")):
        Path("sub/part.xml").write_text(part.format(geom))
        assert [(f.code, f.file, f.line) for f in found(text, workplace)] == [(code, "sub/part.xml", 2)]


@pytest.mark.parametrize(
    ("text", "line", "told", "remedy"),
    [
        (
            mjcf("<geom name='g'\n size=.1/>"),
            5,
            "not well-formed XML: not well-formed (invalid token) at column 7",
            'write size="…": values of attributes stand in quotes',
        ),
        (
            mjcf('<geom < size="1"/>'),
            4,
            "not well-formed XML: not well-formed (invalid token) at column 7",
            "save the file as UTF-8, and write & and < as &amp; and &lt;",
        ),
        (
            mjcf("") + "\ngarbage",
            8,
            "not well-formed XML: junk after document element at column 1",
            "a file holds one root element; put all inside one <mujoco>",
        ),
        (LFS, 1, "it is a pointer of Git LFS, and not the file itself", PULLED),
    ],
)
def test_xml_that_is_not_well_formed_is_told_with_what_to_do(
    text: str, line: int, told: str, remedy: str, workplace: Path
) -> None:
    (finding,) = found(text, workplace)
    assert (finding.code, finding.file, finding.line) == ("MJ101", "model.xml", line)
    assert (finding.message, finding.remedy) == (told, remedy)


def test_a_model_that_attaches_itself_is_told_before_it_is_loaded(workplace: Path) -> None:

    path = workplace / "self.xml"
    path.write_text('<mujoco>\n<asset><model name="me" file="self.xml"/></asset></mujoco>')
    (danger,) = dangers(read(path))
    assert (danger.code, danger.line) == ("MJ113", 2)


def test_a_pipe_among_the_files_is_told_before_it_is_opened(workplace: Path) -> None:

    os.mkfifo("pipe.obj")
    path = workplace / "model.xml"
    path.write_text('<mujoco>\n<asset><mesh file="pipe.obj"/></asset></mujoco>')
    (danger,) = dangers(read(path))
    assert (danger.code, danger.line) == ("MJ107", 2)
    assert "is a pipe" in danger.message


def steps_until_it_diverges(solref: tuple[float, float], step: float) -> bool:
    """Whether a unit mass on the direct spring of `solref` gains amplitude under semi-implicit Euler steps."""
    position, velocity = 1.0, 0.0
    for _ in range(2000):
        velocity += step * (solref[0] * position + solref[1] * velocity)
        position += step * velocity
        if abs(position) > 1e6:
            return True
    return False


@given(stiffness=st.floats(1, 1e6), damping=st.floats(0, 1e3), step=st.floats(1e-4, 1e-2))
def test_a_direct_spring_is_stiff_exactly_when_its_steps_diverge(stiffness: float, damping: float, step: float) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    model.opt.timestep = step
    margin = 2 * step * damping + step**2 * stiffness
    spring = contacts.Spring("geom", 0, "solref", (-stiffness, -damping))
    if abs(margin / 4 - 1) > 0.05:
        assert bool(contacts._trouble(model, spring)) == steps_until_it_diverges(spring.solref, step)


@pytest.mark.parametrize(
    ("solref", "option", "stiff_for_it"),
    [
        (".003 1", 'timestep=".0015"', False),
        (".003 1", 'timestep=".002" integrator="discrete"', False),
        (".001 1", 'timestep=".002" integrator="discrete"', True),
        ("-100 -10", 'timestep=".002"', False),
        ("-1e7 -10", 'timestep=".002"', True),
    ],
)
def test_how_stiff_a_contact_may_be_depends_on_the_integrator_and_the_format(
    solref: str, option: str, stiff_for_it: bool, workplace: Path
) -> None:
    assert ("MJ503" in {f.code for f in found(stiff(solref, option), workplace)}) == stiff_for_it


def test_disabled_contacts_are_never_too_stiff(workplace: Path) -> None:
    text = stiff(".001 1").replace("/>", '><flag contact="disable"/></option>', 1)
    assert found(text, workplace) == []


def test_without_refsafe_a_stiff_contact_may_be_unstable(workplace: Path) -> None:
    text = stiff(".001 1").replace("/>", '><flag refsafe="disable"/></option>', 1)
    assert [f.message.rpartition(": ")[2] for f in found(text, workplace)] == ["it may become unstable"]


SEEN = [
    ('zaxis="0 0 1"', 'pos="0 0 -3" size=".001"'),  # smaller than a pixel
    ('zaxis="0 0 1"', 'pos="0 0 -3" type="plane" size="1 1 1"'),
    ('zaxis="0 0 1" projection="orthographic" fovy="1"', 'pos=".4 0 -3" size=".01"'),
    ('zaxis="0 0 1" fovy="10"', 'pos="0 .25 -3" size=".01"'),
    ('zaxis="0 0 1" focal=".01 .01" sensorsize=".01 .01" resolution="100 100"', 'pos="1.4 0 -3" size=".01"'),
]
UNSEEN = [
    ('zaxis="0 0 1"', 'pos="0 0 -3" size="1" group="3"'),
    ('zaxis="0 0 1"', 'pos="0 0 -3" size="1" rgba="1 1 1 0"'),
    ('zaxis="0 0 1"', 'pos="0 0 3" size="1"'),
    ('zaxis="0 0 1" fovy="10"', 'pos="0 .35 -3" size=".01"'),
    ('zaxis="0 0 1" projection="orthographic" fovy="1"', 'pos="2 0 -3" size=".01"'),
    ('zaxis="0 0 1" focal=".01 .01" sensorsize=".01 .01" resolution="100 100"', 'pos="1.6 0 -3" size=".01"'),
]


@pytest.mark.parametrize(("camera", "geom"), SEEN)
def test_a_camera_that_sees_anything_is_well(camera: str, geom: str, workplace: Path) -> None:
    assert found(looking(camera, geom), workplace) == []


@pytest.mark.parametrize(("camera", "geom"), UNSEEN)
def test_a_camera_that_sees_nothing_is_told(camera: str, geom: str, workplace: Path) -> None:
    assert [f.code for f in found(looking(camera, geom), workplace)] == ["MJ601"]


FOUR = '<asset><mesh name="m" vertex="-.2 -.2 -.2 .2 -.2 -.2 0 .3 -.2 0 0 .3"/></asset>'
AROUND = [
    'type="box" size=".15 .15 .15"',
    'type="sphere" size=".15"',
    'type="capsule" size=".15 .1"',
    'type="cylinder" size=".15 .15"',
    'type="ellipsoid" size=".15 .2 .15"',
    'type="box" size=".15 .15 .15" rgba="1 1 1 .5"',
    'type="mesh" mesh="m"',
    'type="mesh" mesh="m" pos="0 0 -.5"',
    'type="box" size=".15 .15 .15" pos="0 0 -.2"',
    'type="sphere" size=".15" pos="0 0 -.3"',
    'type="plane" size="1 1 .1" pos="0 0 -.1"',
    'type="plane" size="1 1 .1" pos="0 0 -.1" zaxis="0 0 -1"',
]


@pytest.mark.parametrize("other", ["", '<geom name="other" pos="0 0 -3" size=".5"/>'], ids=["alone", "before another"])
@pytest.mark.parametrize("geom", AROUND)
def test_a_camera_in_a_geom_sees_what_mujoco_draws_of_it_and_through_it(geom: str, other: str, workplace: Path) -> None:
    text = mjcf(f'<geom name="skull" {geom}/>\n<camera name="eye"/>\n{other}', before=FOUR)
    findings = found(text, workplace)
    model = load(Path("model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, 24, 32) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "eye")
        drawn = bool((renderer.render()[..., 0] >= 0).any())
    assert ["MJ601" for _ in range(not drawn)] == [f.code for f in findings if f.code == "MJ601"]
    assert all("it lies inside geom 'skull'" in f.message for f in findings)


@pytest.mark.parametrize(
    ("hidden", "told", "remedy"),
    [
        ('group="3"', "is in group 3", "--geomgroup 0,1,2,3"),
        ('group="5"', "is in group 5", "--geomgroup 0,1,2,5"),
        ('rgba="1 1 1 0"', "is transparent, with alpha 0", "give it or its material an alpha"),
    ],
)
def test_what_is_hidden_before_a_camera_is_named(hidden: str, told: str, remedy: str, workplace: Path) -> None:
    glass = "" if "rgba" in hidden else 'name="glass" pos="0 0 -3" size="1" rgba="1 1 1 0"/>\n<geom '
    (finding,) = found(looking('zaxis="0 0 1"', f'{glass}name="veiled" pos="0 0 -3" size="1" {hidden}'), workplace)
    assert f"geom 'veiled' before it {told}" in finding.message
    assert remedy in finding.remedy


MUSCLE = ".75 1.05 5 200 .5 1.6 1.5 1.3 1.2"


def largest_force(actuator: str, ctrl: float) -> float:
    """The largest force in 5 s on a joint that is too heavy to move far."""
    body = '<body name="b"><joint name="j" armature="1e9"/><geom name="g" size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(mjcf(body, f"<actuator>{actuator}</actuator>", '<option gravity="0 0 0"/>'))
    data, largest = mujoco.MjData(model), 0.0
    data.ctrl[:] = ctrl
    for _ in range(2500):
        mujoco.mj_step(model, data)
        largest = max(largest, abs(float(data.actuator_force[0])))
    return largest


@pytest.mark.parametrize(
    "actuator",
    [
        '<motor name="a" joint="j"/>',
        '<motor name="a" joint="j" ctrlrange="-1 1"/>',
        '<motor name="a" joint="j" forcerange="-1 1"/>',
        '<position name="a" joint="j"/>',
        '<velocity name="a" joint="j"/>',
        '<intvelocity name="a" joint="j" kp="3" actrange="-1 1"/>',
        '<intvelocity name="a" joint="j" kp="3"/>',
        '<muscle name="a" joint="j" lengthrange="0 1" force="5"/>',
        f'<general name="a" joint="j" gaintype="muscle" lengthrange="0 1" gainprm="{MUSCLE}"/>',
        '<general name="a" joint="j" dyntype="filter" dynprm=".1" actlimited="true" actrange="0 1"/>',
        '<general name="a" joint="j" dyntype="filter" dynprm=".1"/>',
    ],
)
def test_an_actuator_has_limits_exactly_when_a_huge_control_makes_no_huge_force(actuator: str, workplace: Path) -> None:
    codes = [f.code for f in found(hinged(after=f"<actuator>{actuator}</actuator>"), workplace)]
    bounded = largest_force(actuator, 1e6) < 1.01 * largest_force(actuator, 1)
    assert ("MJ301" in codes) == (not bounded)


@pytest.mark.parametrize(
    ("unit", "joint", "mistaken", "remedy"),
    [
        ("degree", 'range="0 6.28"', True, 'range="0 360"'),
        ("degree", 'range="-3.1416 3.14159265"', True, 'range="-180 180"'),
        ("degree", 'range="-1.571 4.71"', True, 'range="-90 270"'),
        ("degree", 'range="-1.5 1.5"', False, ""),
        ("degree", 'range="-3 3.14"', False, ""),
        ("degree", 'type="ball" range="0 1.57"', True, 'range="0 90"'),
        ("degree", 'type="slide" range="-1.57 1.57"', False, ""),
        ("degree", 'range="-90 90"', False, ""),
        ("radian", 'range="-45 45"', True, 'range="-0.7854 0.7854"'),
        ("radian", 'range="-40 40"', False, ""),
        ("radian", 'range="-62.83 62.83"', False, ""),
        ("radian", 'range="-720 720"', False, ""),
        ("radian", 'type="slide" range="-90 90"', False, ""),
    ],
)
def test_a_range_in_the_other_unit_is_one_that_only_that_unit_explains(
    unit: str, joint: str, mistaken: bool, remedy: str, workplace: Path
) -> None:
    told = [f for f in found(hinged(joint, before=f'<compiler angle="{unit}"/>'), workplace) if f.code == "MJ305"]
    assert len(told) == mistaken
    assert all(remedy in f.remedy for f in told)


def test_the_unit_of_an_attached_model_is_told_of_that_model_alone(workplace: Path) -> None:
    assert found(arms(attaching("l_"), joint='range="-1.57 1.57"'), workplace) == []
    assert [f.code for f in inspect(Path("arm.xml"))] == ["MJ305"]


@given(st.floats(0.02, 0.19))
def test_the_depth_of_two_spheres_is_that_of_geometry(depth: float) -> None:
    path = Path("deep.xml")
    path.write_text(apart(-depth))
    subject = LintContext.load(path, read(path))
    ((told, share),) = contacts._shares(subject, None).values()
    np.testing.assert_allclose([told, share], [depth, depth / 0.1], rtol=1e-6)


def test_bodies_are_thrown_as_a_bare_step_throws_them(workplace: Path) -> None:
    path = workplace / "thrown.xml"
    path.write_text(apart(-0.15).replace("<option/>", '<option gravity="0 0 0" timestep="1e-5"/>'))
    subject = LintContext.load(path, read(path))
    data = mujoco.MjData(subject.model)
    mujoco.mj_step(subject.model, data)
    thrown = contacts._accelerations(subject.model, subject.at(None))
    np.testing.assert_allclose(thrown[1], abs(data.qvel[0]) / 1e-5, rtol=1e-6)


def test_a_keyframe_is_a_start_too(workplace: Path) -> None:
    text = apart(0.5).replace("<worldbody>", '<keyframe>\n<key name="in" qpos="0.6"/></keyframe><worldbody>')
    (inside,) = [f for f in found(text, workplace) if f.code == "MJ501"]
    assert inside.message.startswith("in keyframe 'in' it lies 0.1 m deep in geom 'h', 100 %")
    assert inside.line == 4


def test_the_only_joint_of_a_named_body_needs_no_name(workplace: Path) -> None:
    assert found(FINE.replace(' name="j"', ""), workplace) == []


def test_findings_of_one_code_are_counted_when_there_are_many() -> None:
    many = [Finding("MJ301", "note", f"number {i}", "a.xml") for i in range(MOST + 5)]
    told = capped(many)
    assert told[:-1] == many[: MOST - 1]
    assert told[-1].message == "… and 6 more like it"
    assert capped(many[:MOST]) == many[:MOST]


def test_a_detour_in_a_path_is_taken_out_only_if_it_leads_to_the_same_file(workplace: Path) -> None:
    (workplace / "a/b").mkdir(parents=True)
    (workplace / "x.xml").touch()
    (workplace / "link").symlink_to("a/b")
    (workplace / "a/x.xml").touch()
    place = [
        Sighting("", "", "", (Path(p), 1)).finding("MJ301", "note", Path()).file
        for p in ("a/../x.xml", "link/../x.xml")
    ]
    assert place == ["x.xml", "link/../x.xml"]


def test_an_included_circle_is_read_once(workplace: Path) -> None:
    Path("a.xml").write_text('<mujoco><include file="b.xml"/></mujoco>')
    Path("b.xml").write_text('<mujoco><include file="a.xml"/><include file="b.xml"/><size/></mujoco>')
    assert [element.tag for element in read(Path("a.xml")).elements()].count("size") == 1


@pytest.mark.parametrize(
    ("attaches", "circular"),
    [
        ({"a": "bc", "b": "c", "c": ""}, False),
        ({"a": "bc", "b": "d", "c": "d", "d": ""}, False),
        ({"a": "bc", "b": "c", "c": "b"}, True),
        ({"a": "b", "b": "c", "c": "b"}, True),
        ({"a": "a"}, True),
    ],
)
def test_models_that_attach_each_other_in_a_circle_are_read_once(attaches: dict[str, str], circular: bool) -> None:
    for name, others in attaches.items():
        models = "".join(f'<model name="{other}" file="{other}.xml"/>' for other in others)
        Path(f"{name}.xml").write_text(f"<mujoco><asset>{models}</asset></mujoco>")
    source = read(Path("a.xml"))
    assert source.circular == circular
    assert sorted(root.file.stem for root in source.attached) == sorted(set(attaches) - {"a"})


def test_elements_know_what_they_stand_in() -> None:
    outer = Element("default", {}, Path("a.xml"), 1)
    inner = Element("geom", {}, Path("a.xml"), 2, Element("default", {}, Path("a.xml"), 1, outer))
    assert inner.within("default")
    assert not inner.within("geom")


def test_a_folder_means_the_models_below_it_that_stand_by_themselves(workplace: Path) -> None:
    for name, text in {
        "b/two.xml": "<!-- a remark --><mujoco/>",
        "b/part.xml": "<mujocoinclude/>",
        "b/other.xml": "not xml at all",
        "a/one.urdf": '<robot name="r"/>',
        "a/three.mjz": "",
        "a/notes.txt": "<mujoco/>",
        ".hidden/four.xml": "<mujoco/>",
        "five.xml": "<mujoco/>",
    }.items():
        path = workplace / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    models, skipped = found_models([".", "gone.xml", "five.xml"])
    assert models == ["five.xml", "a/one.urdf", "a/three.mjz", "b/two.xml", "gone.xml"]
    assert skipped == 2
    assert found_models(["five.xml", "b/part.xml", "b/other.xml"]) == (["five.xml", "b/other.xml"], 1)


def test_the_root_of_a_pipe_is_not_waited_for(workplace: Path) -> None:

    os.mkfifo("pipe.xml")
    assert root_tag(Path("pipe.xml")) == ""
