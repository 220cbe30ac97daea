"""URDF as it should not be."""

from collections.abc import Iterator

from tests.scoreboard.forms.file_contents import stl
from tests.scoreboard.forms.form import EITHER, Content, Form

INERTIA = '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
SOUND = INERTIA.format("1", "1")
LINK = '<link name="{0}">' + SOUND + "</link>"
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
    '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)
TWO = LINK.format("a") + LINK.format("b")
PAIR = TWO + JOINT.format("j", "a", "b")


def robot(inner: str, attributes: str = 'name="r"') -> str:
    return f"<robot {attributes}>{inner}</robot>"


def meshed(path: str) -> str:
    """A link that is a mesh."""
    geometry = f'<geometry><mesh filename="{path}"/></geometry>'
    return robot(f'<link name="a">{SOUND}<visual>{geometry}</visual><collision>{geometry}</collision></link>')


def forms() -> Iterator[Form]:
    for what, text in {
        "empty": robot(""),
        "without a name": robot(PAIR, ""),
        "a link alone": robot(LINK.format("a")),
        "two roots": robot(TWO),
        "a circle": robot(TWO + JOINT.format("j", "a", "b") + JOINT.format("k", "b", "a")),
        "a joint of itself": robot(LINK.format("a") + JOINT.format("j", "a", "a")),
        "a diamond": robot(
            TWO
            + LINK.format("c")
            + JOINT.format("j", "a", "b")
            + JOINT.format("k", "a", "c")
            + JOINT.format("l", "b", "c")
        ),
        "a missing child": robot(LINK.format("a") + JOINT.format("j", "a", "x")),
        "a missing parent": robot(LINK.format("a") + JOINT.format("j", "x", "a")),
        "links of one name": robot(LINK.format("a") * 2),
        "joints of one name": robot(TWO + LINK.format("c") + JOINT.format("j", "a", "b") + JOINT.format("j", "b", "c")),
        "a link without a name": robot("<link/>"),
        "an unknown joint": robot(PAIR.replace("revolute", "screw")),
        "a joint without a type": robot(PAIR.replace('type="revolute"', "")),
        "a joint without a parent": robot(PAIR.replace('<parent link="a"/>', "")),
        "a mimic of nothing": robot(PAIR.replace("<axis", '<mimic joint="x" multiplier="2"/><axis')),
        "a mimic of itself": robot(PAIR.replace("<axis", '<mimic joint="j" multiplier="2"/><axis')),
        "xacro": robot(
            '<xacro:include filename="/etc/passwd"/>' + PAIR, 'name="r" xmlns:xacro="http://ros.org/wiki/xacro"'
        ),
        "a gazebo plugin": robot(PAIR + '<gazebo><plugin filename="libx.so" name="x"/></gazebo>'),
        "a transmission": robot(PAIR + '<transmission name="t"><type>x</type></transmission>'),
        "an extension": robot(
            PAIR + '<mujoco><compiler meshdir="/etc" discardvisual="false"/><size memory="1M"/></mujoco>'
        ),
        "an extension that includes": robot(PAIR + '<mujoco><include file="/etc/passwd"/></mujoco>'),
        "an unknown element": robot(PAIR + "<unknown/>"),
        "a long name": robot(PAIR, f'name="{"x" * 66000}"'),
        "links of slashes": robot(PAIR.replace('"a"', '"a/b"')),
        "an axis of nothing": robot(PAIR.replace("0 0 1", "0 0 0")),
        "limits turned round": robot(PAIR.replace('lower="-1" upper="1"', 'lower="1" upper="-1"')),
        "another root": "<mujoco/>",
        "SDF": '<sdf version="1.7"><model name="m"/></sdf>',
    }.items():
        yield Form(f"URDF: {what}", {"model.urdf": text}, "model.urdf")
    for value in ("nan", "inf", "-1", "0", "1e308", "1e-320", "", "one"):
        for what, text in {
            "mass": robot(LINK.format("a").replace('mass value="1"', f'mass value="{value}"')),
            "inertia": robot(LINK.format("a").replace('ixx="1"', f'ixx="{value}"')),
            "inertia off the diagonal": robot(LINK.format("a").replace('ixy="0"', f'ixy="{value}"')),
            "limit": robot(PAIR.replace('upper="1"', f'upper="{value}"')),
            "effort": robot(PAIR.replace('effort="1"', f'effort="{value}"')),
            "origin": robot(PAIR.replace("<axis", f'<origin xyz="0 0 {value}" rpy="{value} 0 0"/><axis')),
            "axis": robot(PAIR.replace("0 0 1", f"{value} 0 1")),
            "radius": robot(
                f'<link name="a">{SOUND}<collision><geometry><sphere radius="{value}"/></geometry></collision></link>'
            ),
            "box": robot(
                f'<link name="a">{SOUND}<collision><geometry><box size="1 1 {value}"/></geometry></collision></link>'
            ),
            "damping": robot(PAIR.replace("<axis", f'<dynamics damping="{value}" friction="{value}"/><axis')),
        }.items():
            yield Form(f"URDF: {value or 'nothing'} as {what}", {"model.urdf": text}, "model.urdf")
    for length in (10, 300, 3000):
        links = "".join(LINK.format(i) for i in range(length))
        joints = "".join(JOINT.format(f"j{i}", i, i + 1) for i in range(length - 1))
        yield Form(
            f"URDF: a chain of {length}",
            {"model.urdf": robot(links + joints)},
            "model.urdf",
            None if length < 1000 else EITHER,
        )
    for path in (
        "m.stl",
        "package://r/m.stl",
        "package://../m.stl",
        "../m.stl",
        "/etc/passwd",
        "file:///etc/passwd",
        "http://127.0.0.1:9/m.stl",
        "",
        "m.dae",
        "\u202em.stl",
        "%s.stl",
        "x" * 5000,
        "model://r/m.stl",
        "package://",
    ):
        files: dict[str, Content] = {"model.urdf": meshed(path), "m.stl": stl()}
        yield Form(f"URDF: a mesh at {path[:30]!r}", files, "model.urdf")
