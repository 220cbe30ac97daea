"""Small valid files in the formats that models name, which other modules damage."""

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping, Sequence

VERTICES = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
Points = Sequence[Sequence[float]]
Triangles = Sequence[Sequence[int]]


def stl(vertices: Points = VERTICES, faces: Triangles = FACES, count: int | None = None) -> bytes:
    """Returns a binary STL; `count` faces are claimed."""
    parts = [bytes(80), struct.pack("<I", len(faces) if count is None else count)]
    parts += [struct.pack("<12fH", 0, 0, 0, *(x for i in face for x in vertices[i]), 0) for face in faces]
    return b"".join(parts)


def obj(vertices: Points = VERTICES, faces: Triangles = FACES) -> str:
    """Returns a Wavefront OBJ."""
    lines = [f"v {' '.join(map(str, vertex))}" for vertex in vertices]
    return "\n".join([*lines, *(f"f {' '.join(str(i + 1) for i in face)}" for face in faces)]) + "\n"


def msh(vertices: Points = VERTICES, faces: Triangles = FACES, counts: Sequence[int] | None = None) -> bytes:
    """Returns MuJoCo's own binary mesh; `counts` of vertices, normals, texture coordinates and faces are claimed."""
    head = struct.pack("<4i", *(counts or (len(vertices), 0, 0, len(faces))))
    flat = [x for vertex in vertices for x in vertex]
    return head + struct.pack(f"<{len(flat)}f", *flat) + b"".join(struct.pack("<3i", *face) for face in faces)


def gmsh(nodes: int | None = None, elements: int | None = None, version: str = "4.1") -> str:
    """Returns a tetrahedron in Gmsh's text format; `nodes` and `elements` are claimed."""
    node_count, element_count = 4 if nodes is None else nodes, 1 if elements is None else elements
    points = [" ".join(f"{x:g}" for x in vertex) for vertex in VERTICES]
    if version == "2.2":
        body = [f"{i} {point}" for i, point in enumerate(points, 1)]
        lines = ["$Nodes", str(node_count), *body, "$EndNodes", "$Elements", str(element_count), "1 4 2 0 1 1 2 3 4"]
    else:
        lines = ["$Nodes", f"1 {node_count} 1 {node_count}", f"3 1 0 {node_count}", "1", "2", "3", "4", *points]
        lines += ["$EndNodes", "$Elements", f"1 {element_count} 1 {element_count}", f"3 1 4 {element_count}"]
        lines += ["1 1 2 3 4"]
    return "\n".join(["$MeshFormat", f"{version} 0 8", "$EndMeshFormat", *lines, "$EndElements"]) + "\n"


def hfield(rows: int = 2, columns: int = 3, values: Sequence[float] = (0, 1, 2, 3, 4, 5)) -> bytes:
    """Returns MuJoCo's own binary height field."""
    return struct.pack("<2i", rows, columns) + struct.pack(f"<{len(values)}f", *values)


def skin(
    counts: Sequence[int] = (4, 0, 4, 1),
    faces: Triangles = FACES,
    bone_count: int = 4,
    bone_vertices: Sequence[int] = (0, 1, 2, 3),
    weights: Sequence[float] = (1, 1, 1, 1),
    bone: bytes = b"b",
) -> bytes:
    """Returns MuJoCo's own binary skin of one bone; `counts` of vertices, texture coordinates, faces, bones."""
    parts = [struct.pack("<4i", *counts), struct.pack("<12f", *(x for vertex in VERTICES for x in vertex))]
    parts += [struct.pack("<3i", *face) for face in faces]
    parts += [bone.ljust(40, b"\0")[:40], struct.pack("<7f", 0, 0, 0, 1, 0, 0, 0), struct.pack("<i", bone_count)]
    parts += [struct.pack(f"<{len(bone_vertices)}i", *bone_vertices), struct.pack(f"<{len(weights)}f", *weights)]
    return b"".join(parts)


def png_chunk(kind: bytes, data: bytes, checksum: int | None = None) -> bytes:
    """Returns a chunk of a PNG, with its own checksum by default."""
    checksum = zlib.crc32(kind + data) if checksum is None else checksum
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", checksum)


def png(
    width: int = 4,
    height: int = 4,
    *,
    pixels: bytes | None = None,
    depth: int = 8,
    color: int = 2,
    interlace: int = 0,
    chunks: Sequence[tuple[bytes, bytes]] = (),
) -> bytes:
    """Returns a PNG; `pixels` are its lines with their filters, grey RGB by default; `chunks` precede them."""
    if pixels is None:
        pixels = (b"\0" + b"\x80" * (3 * width)) * height
    head = struct.pack(">2I5B", width, height, depth, color, 0, 0, interlace)
    parts = [png_chunk(b"IHDR", head), *(png_chunk(kind, data) for kind, data in chunks)]
    parts += [png_chunk(b"IDAT", zlib.compress(pixels, 9)), png_chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def archive(members: Mapping[str, str | bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Returns a zip of these members."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as opened:
        for name, content in members.items():
            opened.writestr(name, content)
    return buffer.getvalue()
