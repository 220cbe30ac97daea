"""The description of a compiled model, section by section, as `mjrun info` shows it.

Sections are a summary, and plain values for each kind of object; each is computed on demand.
"""

import math
import os.path
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError
from mjrun.model import description as described
from mjrun.model.fields import floats
from mjrun.model.model_files import file_content, file_size, first_existing, main_mjcf
from mjrun.model.mujoco_globals import collected_warnings, report_warnings
from mjrun.model.names import BALL, PREFIXES, enum_name, names
from mjrun.model.non_default_settings import NonDefaultSetting, option_differences, visual_differences
from mjrun.model.source import bugs_of_model
from mjrun.model.sources import ModelLike, source_of
from mjrun.model.xml_source import CUBE_FACES, scan
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.shared_status import doing

# Words for files, by the elements that refer to them.
KINDS = {"include": "include", "model": "attached model", "texture": "texture", "flexcomp": "flexcomp"}
# The fields that hold the size of an asset.
CONTENT = {
    "mesh": {"vertices": "mesh_vertnum", "faces": "mesh_facenum"},
    "texture": {"width": "tex_width", "height": "tex_height", "channels": "tex_nchannel"},
    "hfield": {"rows": "hfield_nrow", "columns": "hfield_ncol"},
    "skin": {"vertices": "skin_vertnum", "faces": "skin_facenum"},
}
FOLDERS = ("assetdir", "texturedir", "meshdir")


@dataclass(frozen=True)
class Asset:
    """A file, or an asset without a file: built in, or written in the MJCF.

    Attributes:
      kind: `model`, `include`, `attached model`, `mesh`, `texture`, `hfield`, `skin` or `flexcomp`.
      name: the name of the asset; None for a source.
      path: the path of the file, or None. A path inside an archive begins with the path of the archive.
      bytes: the size on disk; None if the file is missing, as after a compiled model was moved.
      content: the size in the compiled model: `vertices` and `faces`; `width`, `height` and `channels`;
        `rows` and `columns`; empty for a source.
    """

    kind: str
    name: str | None
    path: str | None
    bytes: int | None
    content: dict[str, int]


def assets(model: mujoco.MjModel, path: Path | None) -> tuple[Asset, ...]:
    """Returns all files that exist, the model's own first, and all assets without a file."""
    main = None if path is None else main_mjcf(path)
    referenced = [] if main is None else referenced_files(main)
    faces: dict[str, list[str]] = {}
    for file in referenced:
        if file.kind == "texture":
            faces.setdefault(file.name, []).append(file.path)
    sources = [_file(KINDS[file.kind], file.name or None, file.path) for file in referenced if file.kind != "texture"]
    own = [] if path is None else [_file("model", None, str(path))]
    return (*own, *sources, *_compiled(model, faces))


def _file(kind: str, name: str | None, path: str | None, content: dict[str, int] | None = None) -> Asset:
    return Asset(kind, name, path, None if path is None else file_size(path), content or {})


def _compiled(model: mujoco.MjModel, faces: Mapping[str, Sequence[str]]) -> Iterator[Asset]:
    """Yields the assets of a compiled model; `faces` are the files of textures whose file is not recorded."""
    for kind, sizes in CONTENT.items():
        paths = getattr(model, f"{PREFIXES[kind]}_pathadr")
        for i, name in enumerate(names(model, kind)):
            content = {word: int(getattr(model, field)[i]) for word, field in sizes.items()}
            path = _path(model, paths[i])
            other = faces.get(name) if kind == "texture" and not path else None
            for file in other or [path]:
                yield _file(kind, name, file, content)


def _path(model: mujoco.MjModel, start: np.integer) -> str | None:
    """Returns the path that begins at `start` in the model's list of paths; None for −1."""
    if start < 0:
        return None
    paths = model.paths
    return paths[start : paths.index(b"\0", start)].decode("utf-8", "surrogateescape")


@dataclass(frozen=True)
class ReferencedFile:
    """A file that MJCF refers to: `kind` is `include`, `model`, `texture` or `flexcomp`, `name` that of the element."""

    kind: str
    name: str
    path: str


def referenced_files(main: str) -> list[ReferencedFile]:
    """Returns the existing files that the MJCF at `main`, its includes and its attached models refer to, each once.

    A file that cannot be read or is not XML refers to no files.
    """
    files: dict[str, ReferencedFile] = {}
    queue, visited = [(main, main)], {main}
    while queue:
        path, root = queue.pop(0)
        for file in _references(path, root):
            files.setdefault(file.path, file)
            if file.kind in ("include", "model") and file.path not in visited:
                visited.add(file.path)
                queue.append((file.path, root if file.kind == "include" else file.path))
    return list(files.values())


def _references(path: str, root: str) -> Iterator[ReferencedFile]:
    """Yields the files that the MJCF at `path` refers to, which `root` includes."""
    elements: list[tuple[str, dict[str, str]]] = []
    folders: dict[str, str] = {}  # set by the compiler element, which may come last

    def start(tag: str, attributes: dict[str, str], line: int) -> None:
        if tag in KINDS:
            elements.append((tag, attributes))
        elif tag == "compiler":
            folders.update({key: attributes[key] for key in FOLDERS if key in attributes})

    scan(file_content(path) or b"", start)
    for tag, attributes in elements:
        for key in CUBE_FACES if tag == "texture" else ("file",):
            if place := _resolve(attributes.get(key, ""), path, root, folders):
                yield ReferencedFile(tag, attributes.get("name", ""), place)


def _resolve(file: str, path: str, root: str, folders: dict[str, str]) -> str | None:
    """Returns the path of a file next to the source that refers to it, next to the main one, or in an asset folder."""
    if not file:
        return None
    bases = [os.path.dirname(path), os.path.dirname(root)]  # noqa: PTH120 – a pathlib path would drop the leading ./
    places = [os.path.join(base, folder, file) for folder in ("", *folders.values()) for base in bases]  # noqa: PTH118
    # MuJoCo may strip the folders from a file name; both forms are tried.
    places += [os.path.join(base, folder, Path(file).name) for folder in folders.values() for base in bases]  # noqa: PTH118
    return first_existing(places)


SIZES = (
    *("nq", "nv", "na", "nu", "nsensordata", "nuserdata", "nmocap", "npluginstate", "nhistory", "nplastic"),
    *("nbody", "njnt", "ngeom", "nsite", "ncam", "nlight", "nflex", "ntree"),
    *("nactuator", "nsensor", "ntendon", "neq", "npair", "nexclude", "nkey", "nplugin"),
    *("nmesh", "nskin", "nhfield", "ntex", "nmat", "nmeshvert", "nmeshface", "nflexvert", "nflexelem"),
    *("nnumeric", "ntext", "ntuple", "nM", "nB", "nC", "nD"),
)
SLACK = 1e-9  # relative to a range, for the rounding of angles written in decimals
T = TypeVar("T", bound=described.ModelObject)


@dataclass(frozen=True)
class MemorySize:
    """The memory that the model needs [bytes].

    Attributes:
      model, data: the sizes of the model, and of its data without the arena.
      arena: the size of the arena, which holds contacts, constraints and temporary values.
    """

    model: int
    data: int
    arena: int


@dataclass(frozen=True)
class ModelSummary:
    """The key properties of a model.

    Attributes:
      name: the name of the model.
      file: its path; None for a model that exists in memory only.
      mujoco: the version that compiled it.
      mass: the mass of all bodies [kg].
      centre_of_mass: that of all bodies in the initial configuration [m]; None if nothing has mass.
      extent, center: the size and centre of the model in space, according to its statistics [m].
      timestep: [s].
      gravity: [m/s²].
      integrator, solver, cone: MuJoCo's names.
      jacobian: the effective type, `dense` or `sparse`.
      memory: the memory that it needs [bytes].
      sizes: the sizes by MuJoCo's names: `nq`, `nv`, `nbody` …
    """

    name: str
    file: str | None
    mujoco: str
    mass: float
    centre_of_mass: tuple[float, ...] | None
    extent: float
    center: tuple[float, ...]
    timestep: float
    gravity: tuple[float, ...]
    integrator: str
    solver: str
    cone: str
    jacobian: str
    memory: MemorySize
    sizes: dict[str, int]


def summary(model: mujoco.MjModel, path: Path | None) -> ModelSummary:
    """Returns the summary of a model."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mass = float(mujoco.mj_getTotalmass(model))
    return ModelSummary(
        name=model.names[: model.names.index(b"\0")].decode("utf-8", "replace"),
        file=None if path is None else str(path),
        mujoco=mujoco.mj_versionString(),
        mass=mass,
        centre_of_mass=floats(data.subtree_com[0]) if mass else None,
        extent=float(model.stat.extent),
        center=floats(model.stat.center),
        timestep=float(model.opt.timestep),
        gravity=floats(model.opt.gravity),
        integrator=enum_name(mujoco.mjtIntegrator, model.opt.integrator),
        solver=enum_name(mujoco.mjtSolver, model.opt.solver),
        cone=enum_name(mujoco.mjtCone, model.opt.cone),
        jacobian="sparse" if mujoco.mj_isSparse(model) else "dense",
        memory=MemorySize(int(model.nbuffer), int(data.nbuffer), int(data.narena)),
        sizes={name: int(getattr(model, name)) for name in SIZES},
    )


@dataclass(frozen=True)
class ModelStatistics:
    """The statistics of a model, by which MuJoCo scales images and solver.

    Attributes:
      center: the point that the free camera looks at [m].
      extent: the size of the model in space [m].
      meansize, meanmass: the means over its bodies [m], [kg].
      meaninertia: the mean of the diagonal of its inertia matrix.
    """

    center: tuple[float, ...]
    extent: float
    meansize: float
    meanmass: float
    meaninertia: float


def statistics(model: mujoco.MjModel) -> ModelStatistics:
    """Returns the model's statistics, computed by MuJoCo or set in the model."""
    stat = model.stat
    return ModelStatistics(
        floats(stat.center), float(stat.extent), float(stat.meansize), float(stat.meanmass), float(stat.meaninertia)
    )


def _joints_outside(model: mujoco.MjModel, key: int) -> Iterator[str]:
    joints = names(model, "joint")
    for joint in np.flatnonzero(model.jnt_limited):
        qpos = model.key_qpos[key, model.jnt_qposadr[joint] :]
        value = _turned(qpos[:4]) if int(model.jnt_type[joint]) == BALL else qpos[0]
        if _beyond(value, model.jnt_range[joint]):
            yield f"qpos/{joints[joint]}"


def _actuators_outside(model: mujoco.MjModel, key: int) -> Iterator[str]:
    for i, name in enumerate(names(model, "actuator")):
        control, activation = model.actuator_ctrladr[i], model.actuator_actadr[i]
        controls = range(control, control + model.actuator_ctrlnum[i])
        if any(
            model.actuator_ctrllimited[k] and _beyond(model.key_ctrl[key, k], model.actuator_ctrlrange[k])
            for k in controls
        ):
            yield f"ctrl/{name}"
        limited = model.actuator_actnum[i] if model.actuator_actlimited[i] else 0
        if any(
            _beyond(model.key_act[key, k], model.actuator_actrange[i]) for k in range(activation, activation + limited)
        ):
            yield f"act/{name}"


def _turned(quaternion: np.ndarray) -> float:
    """Returns the angle of a rotation [rad], which the range of a ball joint limits."""
    return 2 * float(np.arctan2(np.linalg.norm(quaternion[1:]), abs(quaternion[0])))


def _beyond(value: float, limits: np.ndarray) -> bool:
    low, high = limits
    slack = SLACK * max(1.0, abs(low), abs(high))
    return bool(value < low - slack or value > high + slack)


def _is_finite(model: mujoco.MjModel, key: int) -> bool:
    fields = (
        *(model.key_time, model.key_qpos, model.key_qvel, model.key_act, model.key_ctrl),
        *(model.key_mpos, model.key_mquat, model.key_plastic),
    )
    return all(bool(np.isfinite(field[key]).all()) for field in fields)


@dataclass(frozen=True)
class KeyframeDescription(described.ModelObject):
    """The description of a keyframe.

    Attributes:
      time: the time [s].
      finite: true if every number in it is finite.
      outside: the columns whose values are outside their range: `qpos/knee`, `ctrl/motor`, `act/muscle`.
    """

    KIND = "keyframe"

    time: float = described.of_field("key_time", usual=-1)
    finite: bool = described.computed(_is_finite)
    outside: tuple[str, ...] = described.computed(
        lambda model, key: (*_joints_outside(model, key), *_actuators_outside(model, key))
    )


def _section(kind: type[T]) -> "cached_property[tuple[T, ...]]":
    """Returns a section with a row for each object of a kind."""

    def rows(description: "ModelDescription") -> tuple[T, ...]:
        return described.objects(kind, description.model)

    rows.__annotations__["return"] = tuple[kind, ...]
    return cached_property(rows)


@dataclass(frozen=True)
class ModelDescription:
    """The description of `model`; each section is computed on first use.

    Attributes:
      model: a compiled model. It is not changed.
      path: the file that it was compiled from; None for a model that exists in memory only.
      summary: its key properties.
      bodies, joints, geoms, sites, actuators, sensors, cameras, lights, keyframes: its objects, in order of id.
      tendons, equalities, pairs, excludes, flexes, plugins: its other objects, in order of id.
      options, visual: its settings that differ from MuJoCo's defaults.
      statistics: its statistics, by which MuJoCo scales images and solver.
      assets: its files, and its assets without a file.
    """

    model: mujoco.MjModel
    path: Path | None = None

    def section(self, name: str) -> Any:
        """Returns the section of this name, one of `SECTIONS`."""
        return getattr(self, name)

    @cached_property
    def summary(self) -> ModelSummary:
        return summary(self.model, self.path)

    bodies = _section(described.Body)
    joints = _section(described.Joint)
    geoms = _section(described.Geom)
    sites = _section(described.Site)
    actuators = _section(described.Actuator)
    sensors = _section(described.Sensor)
    cameras = _section(described.Camera)
    lights = _section(described.Light)
    keyframes = _section(KeyframeDescription)
    tendons = _section(described.Tendon)
    equalities = _section(described.EqualityConstraint)
    pairs = _section(described.ContactPair)
    excludes = _section(described.ContactExclusion)
    flexes = _section(described.Flex)
    plugins = _section(described.PluginInstance)

    @cached_property
    def options(self) -> tuple[NonDefaultSetting, ...]:
        return option_differences(self.model)

    @cached_property
    def visual(self) -> tuple[NonDefaultSetting, ...]:
        return visual_differences(self.model)

    @cached_property
    def statistics(self) -> ModelStatistics:
        return statistics(self.model)

    @cached_property
    def assets(self) -> tuple[Asset, ...]:
        return assets(self.model, self.path)


SECTION_TYPES: dict[str, type] = {
    name: value.func.__annotations__["return"]
    for name, value in vars(ModelDescription).items()
    if isinstance(value, cached_property)
}
SECTIONS = tuple(SECTION_TYPES)


@dataclass(frozen=True)
class Info:
    """A request for the description of a model.

    Args:
      model: a file, `scene:NAME`, another source, or a compiled model. It is not changed.
      sections: some of `mjrun.model.info.SECTIONS`; all of them if empty.
    """

    model: ModelLike
    sections: Sequence[str] = ()

    def run(self, reporter: Reporter | None = None) -> "InfoResult":
        """Loads the model and describes it.

        Raises:
          UnknownNameError: a section does not exist; the model is not loaded.
          ModelError: the model cannot be loaded.
        """
        reporter = reporter or PythonApiReporter()
        for name in self.sections:
            if name not in SECTIONS:
                raise UnknownNameError("section", name, SECTIONS)
        sections = tuple(dict.fromkeys(self.sections)) or SECTIONS
        with doing("simulating"), collected_warnings() as warnings:
            source = source_of(self.model)
            description = ModelDescription(source.load(), source.main_file)
            for name in sections:
                description.section(name)  # computed here, so that warnings are collected
        bugs = bugs_of_model(description.model)
        for text in bugs:
            reporter.warn(text)
        report_warnings(warnings, reporter)
        return InfoResult(description, sections, (*bugs, *warnings))


@dataclass(frozen=True)
class InfoResult:
    """The description of a model.

    Attributes:
      description: the description, with an attribute for each section.
      sections: the names of the requested sections, in order.
      warnings: MuJoCo's warnings, and those about its known bugs that affect the model.
    """

    description: ModelDescription
    sections: Sequence[str]
    warnings: Sequence[str]

    def document(self) -> dict[str, Any]:
        """Returns the sections by name, and `warnings`, as a JSON object; numbers that are not finite become null."""
        sections = {name: _plain(self.description.section(name)) for name in self.sections}
        return {**sections, "warnings": list(self.warnings)}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
