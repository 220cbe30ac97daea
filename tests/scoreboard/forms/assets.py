"""Meshes, height fields, skins and textures that are cut off, malformed or larger than they look."""

import struct
import zlib
from collections.abc import Iterator, Mapping

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.file_contents import FACES, VERTICES, gmsh, hfield, msh, obj, png, png_chunk, skin, stl
from tests.scoreboard.forms.form import EITHER, Codes, Content, Form, simple

INPUTS = inputs_of(__name__)
NAMINGS: Mapping[str, str] = INPUTS["NAMINGS"]  # models that name the file {0}
MESH, GMSH, FLEX, SKIN, FIELD, TEXTURE, CUBE = NAMINGS.values()
INLINE = '<asset><mesh name="m" vertex="{}"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody>'
NAN, INF = float("nan"), float("inf")
FRACTIONS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.9, 0.99)


def _bytes(content: str | bytes) -> bytes:
    return content if isinstance(content, bytes) else content.encode()


def _cut(content: str | bytes) -> Iterator[tuple[str, bytes]]:
    """Yields beginnings of a file, and the file followed by rubbish."""
    whole = _bytes(content)
    for fraction in FRACTIONS:
        yield f"{fraction:.0%} of", whole[: int(len(whole) * fraction)]
    yield "all but a byte of", whole[:-1]
    yield "rubbish behind", whole + bytes(1000)


def _form(what: str, naming: str, file: str, content: Content, loads: Codes | None = None, drawn: bool = False) -> Form:
    return simple(what, naming.replace("{0}", file), loads, {file: content}, drawn=drawn)


def forms() -> Iterator[Form]:
    yield from _truncated()
    yield from _meshes()
    yield from _skins_and_fields()
    yield from _textures()


def _truncated() -> Iterator[Form]:
    for name, naming, content in (
        ("m.stl", MESH, stl()),
        ("m.obj", MESH, obj()),
        ("m.msh", MESH, msh()),
        ("g.msh", GMSH, gmsh()),
        ("old.msh", GMSH, gmsh(version="2.2")),
        ("f.obj", FLEX, obj()),
        ("f.stl", FLEX, stl()),
        ("s.skn", SKIN, skin()),
        ("h.bin", FIELD, hfield()),
        ("h.png", FIELD, png()),
        ("t.png", TEXTURE, png()),
    ):
        for how, damaged in _cut(content):
            yield _form(f"{how} {name}", naming, name, damaged, drawn=name == "t.png")
        yield _form(f"a sound {name}", naming, name, content)
        yield _form(f"zeros as {name}", naming, name, bytes(500), drawn=name == "t.png")
        yield _form(f"ones as {name}", naming, name, b"\xff" * 500)


def _meshes() -> Iterator[Form]:
    for count in (0, 1, 3, 5, 1000, 2**31 - 1, 2**32 - 1):
        yield _form(f"an STL that claims {count} faces", MESH, "m.stl", stl(count=count))
    for counts in INPUTS["MESH_COUNTS"]:
        yield _form(f"a mesh that claims {counts}", MESH, "m.msh", msh(counts=counts))
    for what, bad in (("NaN", NAN), ("infinity", INF), ("1e38", 1e38), ("1e-38", 1e-38), ("-0", -0.0)):
        vertices = ((bad, 0.0, 0.0), *VERTICES[1:])
        for name, make in (("m.stl", stl), ("m.obj", obj), ("m.msh", msh)):
            yield _form(f"{what} in {name}", MESH, name, make(vertices), drawn=True)
    for what, vertices in (
        ("one point", [(0, 0, 0)] * 4),
        ("a line", [(i, 0, 0) for i in range(4)]),
        ("a plane", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]),
        ("a speck", [tuple(x * 1e-12 for x in v) for v in VERTICES]),
        ("a world", [tuple(x * 1e12 for x in v) for v in VERTICES]),
    ):
        for name, make in (("m.stl", stl), ("m.obj", obj), ("m.msh", msh)):
            yield _form(f"{what} as {name}", MESH, name, make(vertices), drawn=True)
    for what, faces in {
        **INPUTS["FACES"],
        "double": FACES * 2,
        "reversed": tuple(face[::-1] for face in FACES),
    }.items():
        for name, naming, make in (("m.msh", MESH, msh), ("m.obj", MESH, obj), ("f.obj", FLEX, obj)):
            yield _form(f"faces {what} in {name}", naming, name, make(VERTICES, faces))
    lines = "".join(f"v {x} {y} {z}\n" for x, y, z in VERTICES)
    for what, text in {
        "a face of 100,000 corners": lines + "f " + "1 2 3 4 " * 25000,
        "a face of two": lines + "f 1 2\n",
        "a face 0": lines + "f 0 1 2\n",
        "words": lines.replace("0.0", "zero") + "f 1 2 3\n",
        "a secret as material": "mtllib /etc/passwd\nusemtl root\n" + obj(),
        "escape sequences": "# \x1b[2J\no \x1b]0;owned\x07\n" + obj(),
        "escape sequences as words": "\x1b[2J 1 2 3\n" + lines,
        "texture coordinates out of range": obj() + "vt 0 0\nf 1/9 2/9 3/9\n",
        "normals out of range": obj() + "vn 0 0 1\nf 1//9 2//9 3//9\n",
        "a line of 10 MB": "v " + "0 " * 5_000_000 + "\n" + obj(),
        "nulls": obj().replace("\n", "\0\n"),
        "curves": "curv 0 1 1 2 3\n" + obj(),
        "1e999": obj().replace("1.0", "1e999"),
        "a million vertices": lines + "v 1 1 1\n" * 1_000_000,
    }.items():
        yield _form(f"{what} in an OBJ", MESH, "m.obj", lambda text=text: text.encode())
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0"
    ascii_stl = f"solid x\nfacet normal 0 0 0\nouter loop\n{corners}\nendloop\nendfacet\nendsolid\n"
    yield _form("a text as STL", MESH, "m.stl", ascii_stl)
    yield _form("a mesh without a suffix", MESH, "mesh", stl())
    yield _form("a mesh in another format", MESH, "m.dae", "<COLLADA/>")
    yield _form("a PNG as STL", MESH, "m.stl", png())
    yield _form("an STL as PNG", TEXTURE, "t.png", stl())
    for nodes, elements in INPUTS["GMSH_COUNTS"]:
        for version in ("4.1", "2.2"):
            text = gmsh(nodes, elements, version)
            yield _form(f"{nodes} nodes and {elements} elements of Gmsh {version}", GMSH, "g.msh", text)
    for what, (old, new) in INPUTS["GMSH_CHANGES"].items():
        yield _form(f"{what} in Gmsh", GMSH, "g.msh", gmsh().replace(old, new))
    for vertices in INPUTS["VERTEX_LISTS"]:
        yield simple(f"vertices {vertices}", INLINE.format(vertices))
    for faces in INPUTS["FACE_LISTS"]:
        yield simple(f"faces {faces}", INLINE.format(f'0 0 0 1 0 0 0 1 0 0 0 1" face="{faces}'))


def _skins_and_fields() -> Iterator[Form]:
    for counts in INPUTS["SKIN_COUNTS"]:
        yield _form(f"a skin that claims {counts}", SKIN, "s.skn", skin(counts), drawn=True)
    for what, content in {
        "faces out of range": skin(faces=((0, 1, 99), *FACES[1:])),
        "faces below zero": skin(faces=((0, 1, -1), *FACES[1:])),
        "vertices out of range": skin(bone_vertices=(0, 1, 2, 99)),
        "vertices below zero": skin(bone_vertices=(0, 1, 2, -1)),
        "more vertices than there are": skin(bone_count=2**31 - 1),
        "fewer vertices than none": skin(bone_count=-1),
        "weights that are NaN": skin(weights=(NAN, 1, 1, 1)),
        "no weight": skin(weights=(0, 0, 0, 0)),
        "a bone that is no body": skin(bone=b"nobody"),
        "a bone without an end": skin(bone=b"b" * 40),
        "a bone of escape sequences": skin(bone=b"\x1b[2J"),
        "a bone that is not UTF-8": skin(bone=b"\xff\xfe"),
    }.items():
        yield _form(f"{what} in a skin", SKIN, "s.skn", content, drawn=True)
    for rows, columns in INPUTS["FIELD_SIZES"]:
        yield _form(f"a height field of {rows} by {columns}", FIELD, "h.bin", hfield(rows, columns))
    for what, value in (("NaN", NAN), ("infinity", INF), ("minus infinity", -INF), ("1e38", 1e38)):
        yield _form(f"{what} in a height field", FIELD, "h.bin", hfield(values=(0, 1, 2, 3, 4, value)), drawn=True)
    yield _form("a flat height field", FIELD, "h.bin", hfield(values=(1,) * 6), drawn=True)


def _bomb(width: int, height: int) -> bytes:
    """Returns a PNG of one grey."""
    packer = zlib.compressobj(9)
    line = bytes(1 + width)
    data = b"".join([packer.compress(line * 100) for _ in range(height // 100)] + [packer.flush()])
    head = struct.pack(">2I5B", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", head) + png_chunk(b"IDAT", data) + png_chunk(b"IEND", b"")


def _textures() -> Iterator[Form]:
    for width, height in ((30000, 30000), (60000, 20000)):
        content = lambda width=width, height=height: _bomb(width, height)  # noqa: E731
        yield _form(f"a PNG of {width} by {height}", TEXTURE, "t.png", content, EITHER)
        yield _form(f"a PNG of {width} by {height} as a height field", FIELD, "h.png", content, EITHER)
    for width, height in INPUTS["PNG_SIZES"]:
        content = png(width, height, pixels=(b"\0" + b"\x80" * 12) * 4)
        for role, naming in (("texture", TEXTURE), ("height field", FIELD)):
            yield _form(f"a PNG that claims {width} by {height} as a {role}", naming, "t.png", content)
    for depth in (1, 2, 4, 8, 16, 3, 0, 255):
        for color in (0, 2, 3, 4, 6, 1, 255):
            content = png(depth=depth, color=color, pixels=bytes(4 * 40))
            yield _form(f"a PNG of depth {depth} and colour type {color}", TEXTURE, "t.png", content, drawn=depth == 8)
    image = png()
    for what, content in {
        "a wrong checksum": image.replace(image[29:33], b"\0\0\0\0"),
        "interlaced": png(interlace=1),
        "an unknown interlace": png(interlace=7),
        "a bomb of text": png(chunks=[(b"zTXt", b"k\0\0" + zlib.compress(bytes(100_000_000), 9))]),
        "a bomb of a profile": png(chunks=[(b"iCCP", b"k\0\0" + zlib.compress(bytes(100_000_000), 9))]),
        "escape sequences": png(chunks=[(b"tEXt", b"Title\0\x1b[2J")]),
        "an unknown critical chunk": png(chunks=[(b"XXXX", b"")]),
        "too many pixels": png(pixels=bytes(50_000_000)),
        "too few pixels": png(pixels=bytes(5)),
        "wrong filters": png(pixels=(b"\x09" + bytes(12)) * 4),
        "no data": image[:33] + png_chunk(b"IEND", b""),
        "no head": image[:8] + png_chunk(b"IEND", b""),
        "a chunk of 2 GB": image[:33] + struct.pack(">I", 2**31 - 1) + b"IDAT",
        "a chunk of 4 GB": image[:33] + struct.pack(">I", 2**32 - 1) + b"IDAT",
        "a JPEG": b"\xff\xd8\xff\xe0\x00\x10JFIF\0" + bytes(100),
        "a GIF": b"GIF89a\x01\x00\x01\x00\x00\x00\x00;",
        "a KTX": b"\xabKTX 11\xbb\r\n\x1a\n" + bytes(100),
    }.items():
        yield _form(f"a texture with {what}", TEXTURE, "t.png", content, drawn=True)
    for suffix in ("ktx", "hdr", "bmp", "tga", "jpg", "exr", "xyz"):
        yield _form(f"a texture.{suffix}", TEXTURE, f"t.{suffix}", bytes(1000))
    for width, height in INPUTS["CUBE_SIZES"]:
        yield _form(f"a cube of {width} by {height}", CUBE, "t.png", png(width, height), drawn=True)
    for layout in INPUTS["CUBE_LAYOUTS"]:
        yield _changed(f"a cube laid out as {layout[:15]}", CUBE, ".U..LFRB.D..", layout, png(12, 16))
    for gridsize in INPUTS["CUBE_GRIDS"]:
        yield _changed(f"a cube of grid {gridsize}", CUBE, "3 4", gridsize, png(12, 16))
    for channels in (-1, 0, 1, 2, 3, 4, 5, 99, 2**31 - 1):
        setting = f' type="2d" nchannel="{channels}"'
        yield _changed(f"a texture of {channels} channels", TEXTURE, ' type="2d"', setting, png(), drawn=True)
    for kind in INPUTS["CONTENT_TYPES"]:
        setting = f' type="2d" content_type="{kind}"'
        yield _changed(f"a texture said to be {kind}", TEXTURE, ' type="2d"', setting, png())


def _changed(what: str, naming: str, old: str, new: str, content: Content, *, drawn: bool = False) -> Form:
    inner = naming.replace("{0}", "t.png").replace(old, new)
    return simple(what, inner, files={"t.png": content}, drawn=drawn)
