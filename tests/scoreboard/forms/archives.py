"""Archives: bombs, ways out of them, members that are links, double, encrypted, nameless, or not there."""

import io
import itertools
import struct
import zipfile
from collections.abc import Iterator
from functools import partial

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.assets import CUBE, MESH, TEXTURE
from tests.scoreboard.forms.file_contents import archive, png, stl
from tests.scoreboard.forms.form import EITHER, LOADED, REFUSED, Content, Form, mjcf
from tests.scoreboard.forms.texts import ESCAPES, HINGE

INPUTS = inputs_of(__name__)
MODEL = mjcf(HINGE)
MESHED = mjcf(MESH.replace("{0}", "m.stl"))


def _member(name: str, content: bytes, mode: int) -> bytes:
    """Returns an archive of a model and a member of this mode, such as a link."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as opened:
        opened.writestr("model.xml", mjcf(MESH.replace("{0}", name)))
        info = zipfile.ZipInfo(name)
        info.create_system, info.external_attr = 3, mode << 16
        opened.writestr(info, content)
    return buffer.getvalue()


def _bomb(name: str, megabytes: int) -> bytes:
    """Returns an archive with a member of zeros."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as opened:
        if name != "model.xml":
            opened.writestr("model.xml", mjcf(MESH.replace("{0}", name)))
        with opened.open(name, "w", force_zip64=True) as member:
            for _ in range(megabytes):
                member.write(bytes(2**20))
    return buffer.getvalue()


def _doubled() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as opened:
        opened.writestr("model.xml", MODEL)
        opened.filelist[0].filename = "x"  # else a warning of the standard library
        opened.writestr("model.xml", "<mujoco/>")
    return buffer.getvalue()


def _changed(whole: bytes, signature: bytes, offset: int, value: bytes) -> bytes:
    """Returns an archive with some bytes changed in each record of this signature."""
    changed, at = bytearray(whole), whole.find(signature)
    while at >= 0:
        changed[at + offset : at + offset + len(value)] = value
        at = whole.find(signature, at + 4)
    return bytes(changed)


LOCAL, CENTRAL, END = b"PK\3\4", b"PK\1\2", b"PK\5\6"


def forms() -> Iterator[Form]:
    yield from _forms("model.zip")
    yield from itertools.islice(_forms("model.mjz"), None, None, 5)  # which is the same, but for its name


def _forms(model: str) -> Iterator[Form]:
    whole = archive({"model.xml": MESHED, "m.stl": stl()})
    make = partial(_of, model)
    yield make("a sound archive", whole, LOADED)
    for fraction in (0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
        yield make(f"{fraction:.0%} of an archive", whole[: int(len(whole) * fraction)], REFUSED)
    yield make("an archive but for its last byte", whole[:-1])
    yield make("an archive behind a program", b"#!/bin/sh\n" + whole)
    yield make("an archive before rubbish", whole + b"rubbish")
    yield make("an archive of nothing", archive({}), REFUSED)
    yield make("an archive of a folder", archive({"model.xml/": ""}), REFUSED)
    yield make("an archive of a text", archive({"readme.txt": "hello"}), REFUSED)
    yield make("an archive of an empty model", archive({"model.xml": ""}), REFUSED)
    yield make("an archive of two models", archive({"a.xml": MODEL, "b.xml": MODEL}), REFUSED)
    yield make("an archive of one model of any name", archive({"a.xml": MODEL}), LOADED)
    yield make("an archive in an archive", archive({"model.zip": whole}), REFUSED)
    yield make(
        "an archive that includes an archive",
        archive({"model.xml": mjcf('<include file="a.zip"/>'), "a.zip": whole}),
        REFUSED,
    )
    yield make("a model of two names", _doubled())
    yield make("20,000 members", archive({"model.xml": MODEL, **{f"m{i}": "" for i in range(20000)}}))
    yield make("a folder of 1,000 levels", archive({"a/" * 1000 + "model.xml": MODEL}), EITHER)
    for name in INPUTS["MODEL_NAMES"]:
        yield make(f"a model that is called {name[:40]!r}", archive({name: MODEL}), EITHER)
    for name in INPUTS["MESH_NAMES"]:
        yield make(f"a mesh at {name}", archive({"model.xml": mjcf(MESH.replace("{0}", name))}), REFUSED)
        yield make(f"a mesh within at {name}", archive({"model.xml": mjcf(MESH.replace("{0}", name)), name: stl()}))
        yield make(f"an include of {name}", archive({"model.xml": mjcf(f'<include file="{name}"/>')}), REFUSED)
    yield make("a missing mesh", archive({"model.xml": MESHED}), REFUSED)
    yield make("a link to a secret", _member("m.stl", b"/etc/passwd", 0o120777), REFUSED)
    yield make("a pipe within", _member("m.stl", b"", 0o010666), REFUSED)
    yield make("a device within", _member("m.stl", b"", 0o020666), REFUSED)
    yield make("a wrong checksum", _changed(whole, CENTRAL, 16, b"\1\2\3\4"))
    yield make(
        "wrong checksums everywhere",
        _changed(_changed(whole, CENTRAL, 16, b"\1\2\3\4"), LOCAL, 14, b"\1\2\3\4"),
        REFUSED,
    )
    yield make("encrypted members", _changed(_changed(whole, CENTRAL, 8, b"\1\0"), LOCAL, 6, b"\1\0"), REFUSED)
    for method in (1, 8, 12, 14, 93, 97, 99):
        code = struct.pack("<H", method)
        yield make(
            f"compression {method}",
            _changed(_changed(whole, CENTRAL, 10, code), LOCAL, 8, code),
            LOADED if method == 8 else REFUSED,
        )
    for size in (0, 1, 2**31 - 1, 2**32 - 2, 2**32 - 1):
        yield make(f"members that claim {size} bytes", _changed(whole, CENTRAL, 24, struct.pack("<I", size)))
        yield make(f"members that claim {size} packed bytes", _changed(whole, CENTRAL, 20, struct.pack("<I", size)))
        yield make(f"members that begin at {size}", _changed(whole, CENTRAL, 42, struct.pack("<I", size)))
        yield make(f"a directory at {size}", _changed(whole, END, 16, struct.pack("<I", size)))
        yield make(f"a directory of {size} bytes", _changed(whole, END, 12, struct.pack("<I", size)))
    for count in (0, 1, 65535):
        yield make(f"a directory of {count} members", _changed(whole, END, 8, struct.pack("<2H", count, count)))
    yield make("a mesh of 2 GB of zeros", lambda: _bomb("m.stl", 2048), REFUSED)
    yield make("a model of 2 GB of zeros", lambda: _bomb("model.xml", 2048), REFUSED)
    yield make("an unnamed bomb", lambda: _bomb("other.bin", 1024), REFUSED)
    laughs = '<!DOCTYPE mujoco [<!ENTITY a "' + "x" * 1000 + '">]><mujoco model="' + "&a;" * 1000 + '"/>'
    yield make("laughs in an archive", archive({"model.xml": laughs}))
    texture = archive({"model.xml": mjcf(TEXTURE.replace("{0}", "t.png")), "t.png": png()})
    yield make("a texture within", texture, EITHER)
    yield make(
        "half a texture within",
        archive({"model.xml": mjcf(TEXTURE.replace("{0}", "t.png")), "t.png": png()[:40]}),
        REFUSED,
    )
    yield make(
        "a cube within", archive({"model.xml": mjcf(CUBE.replace("{0}", "t.png")), "t.png": png(12, 16)}), EITHER
    )
    for what, text in ESCAPES.items():
        yield make(f"{what} in the name of the model within", archive({f"{text}.xml": MODEL}), EITHER)
        yield make(
            f"{what} in the name of a broken model within",
            archive({f"{text}.xml": "<mujoco><x/></mujoco>"}),
            REFUSED,
        )
        yield make(
            f"{what} in the name of a missing include within",
            archive({"model.xml": mjcf(f'<include file="{text}.xml"/>')}),
            REFUSED,
        )
    comment = _changed(whole, END, 20, struct.pack("<H", 7)) + b"\x1b[2J\x07\x9b\0"
    yield make("a comment of escape sequences", comment)


def _of(model: str, what: str, content: Content, loads: frozenset[int] | None = None) -> Form:
    return Form(f"{what}: {model}", {model: content}, model, loads)
