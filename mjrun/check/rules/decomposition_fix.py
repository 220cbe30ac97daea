"""The fix of a hull that fills a cavity: the geom collides as convex parts of its mesh, each in a file beside its own.

Mass and inertia stay: the parts have no mass, and the geom itself stays if it has some, or if it is visible.
"""

import hashlib
import itertools
import json
import math
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from mjrun.check.context import CheckContext, declared_name
from mjrun.check.finding import Fix
from mjrun.check.rule import GENERATED
from mjrun.check.rules.asset_files import asset_folders, file_of
from mjrun.check.rules.bodies import bodies_with_inferred_mass
from mjrun.check.rules.contacts import deep_penetrations
from mjrun.check.rules.meshes import MESH, Surface, geom_mass
from mjrun.child_process import limit_this_process
from mjrun.errors import MissingExtraError, WrongVersionError
from mjrun.model.text_edits import TextEdit, escaped
from mjrun.model.xml_source import Element, default_holder
from mjrun.options.check import EXTRAS
from mjrun.packages import installed_version, require_all
from mjrun.platform import system

FINENESS = (0.05, 0.02, 0.01)  # of the parts, tried in turn: their largest concavity relative to half the mesh's size
HIDDEN = 3  # the first group of geoms that viewers hide by default
TIME_LIMIT = 120  # [s] of computing for the parts of a mesh with one degree of fineness
CONTACTS, OTHERS = ("geom1", "geom2"), ("geom", "objname", "refname")  # attributes that refer to geoms
OWN = ("name", "mesh", "mass", "density")  # attributes of a geom that its parts do not share


class _Elements(NamedTuple):
    geom: Element
    mesh: Element


def obstacle() -> str:
    """Returns the reason why no mesh can be decomposed, with the remedy; empty if it can."""
    try:
        require_all(EXTRAS)
    except (MissingExtraError, WrongVersionError) as error:
        return str(error)
    return ""


def decomposed(context: CheckContext, start: int | None, geom: int, pair: tuple[int, int]) -> Fix | str:
    """Returns the fix that makes room, in the mesh of `geom`, for the other one of two geoms at a start."""
    elements = _elements(context, geom)
    if isinstance(elements, str):
        return elements
    if context.spec is None:
        return GENERATED
    if reason := obstacle():
        return reason
    mesh, other = int(context.model.geom_dataid[geom]), pair[0] if geom == pair[1] else pair[1]
    limit = f"up to {TIME_LIMIT} s of computing for each of {len(FINENESS)} degrees of fineness"
    context.announce_slow_fix(f"decomposing {context.object('mesh', mesh)}, {limit}")
    half_size = float(np.ptp(Surface.of(context.model, mesh).vertices, axis=0).max()) / 2
    for fineness in FINENESS:
        parts = _parts(context, mesh, fineness)
        if not parts:
            need = f"more than {TIME_LIMIT} s of computing, or more memory than allowed"
            return f"its convex parts take {need}: make them by hand, or simplify the mesh"
        depth = _remaining_depth(context, context.spec.copy(), start, geom, other, parts)
        if not depth:
            return _fix(context, geom, elements, parts)
        if depth > context.thresholds.static_penetration + fineness * half_size:
            break  # finer parts recede by less than that
    return f"{context.object('geom', other)} penetrates convex parts of the mesh, too: it is not only in the cavity"


def _elements(context: CheckContext, geom: int) -> _Elements | str:
    """Returns the elements of a geom and of its mesh, or the reason why those of parts cannot replace them."""
    element = context.element("geom", geom)
    mesh = context.name("mesh", int(context.model.geom_dataid[geom]))
    meshes = [e for e in context.source.elements() if e.tag == "mesh" and not e.within("default")]
    meshes = [e for e in meshes if declared_name(e) == mesh]
    if element is None or element.tag != "geom" or element.children or context.place("geom", geom).origin:
        return "the geom is attached or generated, or has a plugin"
    if len(meshes) != 1:
        return "no single <mesh> of the model has its name"
    if _is_referred_to(context, element, CONTACTS):
        return "a <pair> or a sensor of contacts refers to the geom by name"
    return _Elements(element, meshes[0])


def _is_referred_to(context: CheckContext, geom: Element, attributes: Sequence[str]) -> bool:
    name = geom.attributes.get("name")
    return name is not None and any(
        e.attributes.get(attribute) == name for e in context.source.elements() for attribute in attributes
    )


@lru_cache(maxsize=8)
def _parts(context: CheckContext, mesh: int, fineness: float) -> list[Surface]:
    """Returns convex parts of a mesh, in the frame of its principal axes, along which CoACD cuts it; none if that takes
    too long.
    """
    import coacd

    surface = Surface.of(context.model, mesh)
    faces = surface.faces if surface.volume > 0 else surface.faces[:, ::-1]
    facts = surface.vertices.tobytes() + faces.tobytes() + f"{fineness} {installed_version('coacd')}".encode()
    key = hashlib.sha256(facts).hexdigest()
    parts = context.cache.read(key) if context.cache else None
    if not parts:
        coacd.set_log_level("error")
        whole = coacd.Mesh(surface.vertices, faces)
        parts = _limited(lambda: coacd.run_coacd(whole, threshold=fineness))
        if context.cache and parts:
            limit_this_process(file_size=math.inf)
            context.cache.write(key, parts)
            context.cache.trim()
            limit_this_process(file_size=0)
    return [Surface(np.array(vertices), np.array(triangles)) for vertices, triangles in parts]


def _limited(decompose: Callable[[], Sequence[Any]]) -> list[list[Any]]:
    """Returns the vertices and triangles that a fork of this process computes; nothing if that takes too long.

    Where the system cannot fork, only the limits of the whole check apply.
    """

    def lists() -> list[list[Any]]:
        return [[np.asarray(each).tolist() for each in part] for part in decompose()]

    if not system.CAN_FORK_LATE:
        return lists()
    reading, writing = os.pipe()
    if pid := os.fork():
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            content = pipe.read()
        _, status = os.waitpid(pid, 0)
        return json.loads(content) if content and not status else []
    try:
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        limit_this_process(cpu=TIME_LIMIT)
        content = json.dumps(lists()).encode()
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(content)
    finally:
        os._exit(0)


def _remaining_depth(
    context: CheckContext, spec: mujoco.MjSpec, start: int | None, geom: int, other: int, parts: Sequence[Surface]
) -> float:
    """Returns how deeply a geom that collides as parts of its mesh, in `spec`, penetrates another one [m].

    It is 0 if no finding would report it, and NaN if the parts do not compile.
    """
    whole, neighbour = (next(each for each in spec.geoms if each.id == index) for index in (geom, other))
    pose = context.model.geom_pos[geom], context.model.geom_quat[geom]
    bits = {"contype": whole.contype, "conaffinity": whole.conaffinity}
    added: list[mujoco.MjsGeom] = []
    for i, part in enumerate(parts):
        name = f"{whole.meshname}/{i}/{context.model.nmesh}"
        spec.add_mesh(name=name, uservert=part.vertices.ravel(), userface=part.faces.ravel(), scale=np.ones(3))
        added.append(whole.parent.add_geom(type=MESH, meshname=name, mass=0, pos=pose[0], quat=pose[1], **bits))
    whole.contype = whole.conaffinity = 0
    try:
        model = spec.compile()
    except ValueError:
        return math.nan
    deep = deep_penetrations(CheckContext(context.path, model, spec, context.source, context.thresholds), start)
    pairs = {frozenset((neighbour.id, piece.id)) for piece in added}
    return max((depth for pair, (depth, _) in deep.items() if frozenset(pair) in pairs), default=0.0)


def _fix(context: CheckContext, geom: int, elements: _Elements, parts: Sequence[Surface]) -> Fix:
    edits = list(_files(context, geom, elements.mesh, parts))
    names = [Path(edit.file).stem for edit in edits]
    edits.append(context.editor.followed_by(elements.mesh, [*_meshes(elements.mesh, names)]))
    stays = _stays(context, geom, elements.geom)
    pieces = [*_pieces(elements.geom, names, HIDDEN if stays and context.model.geom_group[geom] < HIDDEN else None)]
    if stays:
        edits += [context.editor.with_value(elements.geom, name, "0") for name in ("contype", "conaffinity")]
        edits.append(context.editor.followed_by(elements.geom, pieces))
    else:
        edits.append(context.editor.replaced_by(elements.geom, pieces))
    own = context.name("geom", geom)
    added = [f"{own}_part{i}" for i in range(1, len(names) + 1)] if "name" in elements.geom.attributes else ["geom:*"]
    changes = [("geom_*", own), *(("geom", name) for name in (own, *added)), *(("mesh", name) for name in names)]
    return Fix(tuple(edits), tuple(changes))


def _files(context: CheckContext, geom: int, mesh: Element, parts: Sequence[Surface]) -> Iterator[TextEdit]:
    """Yields the edits that create the files of the parts, named after the mesh, but not like another file or mesh."""
    source, stem = context.source, declared_name(mesh)
    file = file_of(mesh, source) or context.path.parent / asset_folders(source).get("meshdir", "") / stem
    texts = [_obj(_placed(context, geom, part), i, len(parts), stem) for i, part in enumerate(parts, 1)]
    taken = {context.name("mesh", i) for i in range(context.model.nmesh)}
    for number in itertools.count(1):
        prefix = f"{stem}_part" if number == 1 else f"{stem}_{number}_part"
        places = [file.with_name(f"{prefix}{i}.obj") for i in range(1, len(parts) + 1)]
        if not any(place.stem in taken or _differs(place, text) for place, text in zip(places, texts, strict=True)):
            yield from (TextEdit(str(place), 0, 0, text) for place, text in zip(places, texts, strict=True))
            return


def _differs(place: Path, text: str) -> bool:
    """Returns whether something else than `text` is at a path."""
    try:
        return place.read_text() != text
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True


def _placed(context: CheckContext, geom: int, part: Surface) -> Surface:
    """Returns a part of the mesh of a geom in the frame in which the text of the model places the mesh."""
    mesh, rotation = int(context.model.geom_dataid[geom]), np.zeros(9)
    mujoco.mju_quat2Mat(rotation, context.model.mesh_quat[mesh])
    return Surface(part.vertices @ rotation.reshape(3, 3).T + context.model.mesh_pos[mesh], part.faces)


def _obj(part: Surface, number: int, count: int, mesh: str) -> str:
    """Returns a part as a Wavefront file."""
    vertices = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in part.vertices.tolist()]
    faces = [f"f {a} {b} {c}" for a, b, c in (part.faces + 1).tolist()]
    title = f"# convex part {number} of {count} of the mesh {mesh!a}, made by CoACD"
    return "\n".join([title, *vertices, *faces, ""])


def _meshes(mesh: Element, names: Sequence[str]) -> Iterator[str]:
    """Yields the elements of the meshes of the parts, which have the scale of the model already."""
    folder = mesh.attributes.get("file", "")
    folder = folder[: max(folder.rfind("/"), folder.rfind("\\")) + 1]
    scaled = default_holder(Element("mesh", {}, mesh.file, mesh.line, mesh.parent), "scale")
    scale = ' scale="1 1 1"' if scaled else ""
    for name in names:
        yield f'<mesh name="{escaped(name)}" file="{escaped(f"{folder}{name}.obj")}"{scale}/>'


def _stays(context: CheckContext, geom: int, element: Element) -> bool:
    """Returns whether a geom that no longer collides has another use: it is visible, has mass, or is referred to."""
    model, body = context.model, int(context.model.geom_bodyid[geom])
    others = np.flatnonzero((model.geom_bodyid == body) & (model.geom_dataid == model.geom_dataid[geom]))
    shown = [int(each) for each in others if each != geom and model.geom_group[each] < HIDDEN]
    own = [each for each in context.spec.geoms if each.id == geom] if context.spec else []
    has_mass = body in bodies_with_inferred_mass(context) and any(geom_mass(context, each) for each in own)
    visible = model.geom_group[geom] < HIDDEN and not shown
    return bool(visible or has_mass or _is_referred_to(context, element, OTHERS))


def _pieces(geom: Element, names: Sequence[str], group: int | None) -> Iterator[str]:
    """Yields the elements of the geoms of the parts."""
    own = geom.attributes.get("name")
    shared = {key: value for key, value in geom.attributes.items() if key not in OWN}
    shared |= {} if group is None else {"group": str(group)}
    for i, mesh in enumerate(names, 1):
        attributes = ({} if own is None else {"name": f"{own}_part{i}"}) | shared | {"mesh": mesh, "mass": "0"}
        written = "".join(f' {name}="{escaped(value)}"' for name, value in attributes.items())
        yield f"<geom{written}/>"
