"""Models in other formats than MJCF that are wrong: URDF and compiled models."""

import random
import re
import struct
from collections.abc import Iterator
from functools import cache

import mujoco
import numpy as np

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.file_contents import png, stl
from tests.scoreboard.forms.form import EITHER, REFUSED, Content, Form

INPUTS = inputs_of(__name__)
COMPILED = INPUTS["COMPILED"]
FLIPS = 120
INERTIA = '<inertial><mass value="{0}"/><inertia ixx="{1}" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
SOUND = INERTIA.format("1", "1")
LINK = '<link name="{0}">' + SOUND + "</link>"
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
    '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)
PAIR = LINK.format("a") + LINK.format("b") + JOINT.format("j", "a", "b")
PARTS = {"{pair}": PAIR, "{inertial}": SOUND, **{f"{{{name}}}": LINK.format(name) for name in "abc"}}


def robot(inner: str) -> str:
    return f'<robot name="r">{inner}</robot>'


def _filled(text: str) -> str:
    """Returns a description with its parts, `{a}` a link and `{jab}` a joint j from a to b, filled in."""
    for part, content in PARTS.items():
        text = text.replace(part, content)
    return re.sub(r"\{([jkl])([abcx])([abcx])\}", lambda found: JOINT.format(*found.groups()), text)


def meshed(path: str) -> str:
    """Returns a description of a link that is a mesh."""
    geometry = f'<geometry><mesh filename="{path}"/></geometry>'
    return robot(f'<link name="a">{SOUND}<visual>{geometry}</visual><collision>{geometry}</collision></link>')


def urdf() -> Iterator[Form]:
    """Yields URDF that is wrong."""
    for what, text in INPUTS["ROBOTS"].items():
        yield Form(f"URDF: {what}", {"model.urdf": _filled(text)}, "model.urdf")
    for value in ("nan", "inf", "-1", "0", "1e308", "1e-320", "", "one"):
        for what, text in INPUTS["ROBOT_VALUES"].items():
            name = f"URDF: {value or 'nothing'} as {what}"
            yield Form(name, {"model.urdf": _filled(text).replace("{0}", value)}, "model.urdf")
    for length in (10, 300, 3000):
        links = "".join(LINK.format(i) for i in range(length))
        joints = "".join(JOINT.format(f"j{i}", i, i + 1) for i in range(length - 1))
        yield Form(
            f"URDF: a chain of {length}",
            {"model.urdf": robot(links + joints)},
            "model.urdf",
            None if length < 1000 else EITHER,
        )
    for path in INPUTS["PATHS"]:
        files: dict[str, Content] = {"model.urdf": meshed(path), "m.stl": stl()}
        yield Form(f"URDF: a mesh at {path[:30]!r}", files, "model.urdf")


@cache
def sound() -> bytes:
    """Returns a compiled model without a fault."""
    model = mujoco.MjModel.from_xml_string(COMPILED)
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def _put(at: int, value: bytes) -> bytes:
    whole = sound()
    return whole[:at] + value + whole[at + len(value) :]


def compiled_models() -> Iterator[Form]:
    """Yields compiled models that are cut off, of other versions, or changed in one place."""
    for fraction in (0, 0.001, 0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95, 0.999):
        yield _compiled(f"{fraction:.1%} of a compiled model", sound()[: int(len(sound()) * fraction)], REFUSED)
    yield _compiled("a compiled model and rubbish", sound() + bytes(1000))
    yield _compiled("a compiled model twice", sound() * 2)
    yield _compiled("a PNG as a compiled model", png(), REFUSED)
    yield _compiled("an XML as a compiled model", COMPILED.encode(), REFUSED)
    yield _compiled(
        "numbers of another order", b"".join(sound()[i : i + 4][::-1] for i in range(0, len(sound()), 4)), REFUSED
    )
    for i in range(5):
        for value in (0, -1, 2**31 - 1, 54320, 320, 3003000, 4000001):
            yield _compiled(f"{value} as number {i} of its head", _put(4 * i, struct.pack("<i", value)))
    for i in range(80):
        value = (-1, 2**40, 0)[i % 3]
        yield _compiled(f"{value} as size {i}", _put(20 + 8 * i, struct.pack("<q", value)))
    numbers = random.Random(17)
    for i in range(FLIPS):
        at = numbers.randrange(20, len(sound()) - 8)
        value = numbers.choice(
            (b"\xff\xff\xff\xff", b"\0\0\0\x80", b"\xff\xff\xff\x7f", b"\0\0\xc0\x7f", bytes(4), b"\1\0\0\0")
        )
        yield _compiled(f"change {i}, of byte {at}", _put(at, value))
    yield Form("a task of a compiled model", {"model.mjb": sound()}, "./model.mjb", EITHER)


def _compiled(what: str, content: bytes, loads: frozenset[int] | None = None) -> Form:
    return Form(f"{what}: .mjb", {"model.mjb": content}, "model.mjb", loads, frozenset({0, 3, 4}))
