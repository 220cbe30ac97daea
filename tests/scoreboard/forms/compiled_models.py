"""Compiled models that are cut off, of other versions, or changed in one place."""

import random
import struct
from collections.abc import Iterator
from functools import cache

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.file_contents import png
from tests.scoreboard.forms.form import EITHER, REFUSED, Form

INPUTS = inputs_of(__name__)
MODEL = INPUTS["MODEL"]
FLIPS = 120


@cache
def sound() -> bytes:
    """A compiled model that is as it should be."""
    import mujoco
    import numpy as np

    model = mujoco.MjModel.from_xml_string(MODEL)
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def _put(at: int, value: bytes) -> bytes:
    whole = sound()
    return whole[:at] + value + whole[at + len(value) :]


def forms() -> Iterator[Form]:
    for fraction in (0, 0.001, 0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95, 0.999):
        yield _form(f"{fraction:.1%} of a compiled model", sound()[: int(len(sound()) * fraction)], REFUSED)
    yield _form("a compiled model and rubbish", sound() + bytes(1000))
    yield _form("a compiled model twice", sound() * 2)
    yield _form("a PNG as a compiled model", png(), REFUSED)
    yield _form("an XML as a compiled model", MODEL.encode(), REFUSED)
    yield _form(
        "numbers of another order", b"".join(sound()[i : i + 4][::-1] for i in range(0, len(sound()), 4)), REFUSED
    )
    for i in range(5):
        for value in (0, -1, 2**31 - 1, 54320, 320, 3003000, 4000001):
            yield _form(f"{value} as number {i} of its head", _put(4 * i, struct.pack("<i", value)))
    for i in range(80):
        value = (-1, 2**40, 0)[i % 3]
        yield _form(f"{value} as size {i}", _put(20 + 8 * i, struct.pack("<q", value)))
    numbers = random.Random(17)
    for i in range(FLIPS):
        at = numbers.randrange(20, len(sound()) - 8)
        value = numbers.choice(
            (b"\xff\xff\xff\xff", b"\0\0\0\x80", b"\xff\xff\xff\x7f", b"\0\0\xc0\x7f", bytes(4), b"\1\0\0\0")
        )
        yield _form(f"change {i}, of byte {at}", _put(at, value))
    yield Form("a task of a compiled model", {"model.mjb": sound()}, "./model.mjb", EITHER)


def _form(what: str, content: bytes, loads: frozenset[int] | None = None) -> Form:
    return Form(f"{what}: .mjb", {"model.mjb": content}, "model.mjb", loads, frozenset({0, 3, 4}))
