"""The sections of `mjrun info`; most table columns are derived from the declared attributes of descriptions."""

import math
import os.path
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjrun.cli.table_cells import (
    ReportColumn,
    byte_size,
    common,
    number,
    numbers,
    ranges,
    reference,
    slots,
    span,
    stacked,
    texts,
    vector,
    vectors,
)
from mjrun.dataclass import dataclass
from mjrun.errors import clean, counted, listing

if TYPE_CHECKING:
    import mujoco

    from mjrun.hdf5.demonstration_list import DemonstrationList
    from mjrun.model.description import (
        Actuator,
        Body,
        Camera,
        Geom,
        Light,
        ModelObject,
        Tendon,
        TendonPathElement,
    )
    from mjrun.model.info import Asset, ModelDescription, ModelStatistics, ModelSummary
    from mjrun.model.non_default_settings import NonDefaultSetting, Value
    from mjrun.task.description import TaskDescription, TaskSummary

ROWS = 24  # of a section, unless it is requested
ALWAYS = ("nq", "nv", "na", "nu", "nbody", "njnt", "ngeom")  # sizes that are shown even if they are 0
STATE = ("nq", "nv", "na", "nu", "nsensordata", "nuserdata", "nmocap", "npluginstate", "nhistory", "nplastic")
HIDDEN = ("nM", "nB", "nC", "nD")  # sizes that only the JSON document has
NEGLIGIBLE = 1e-9  # relative to the extent of a model
DEFAULT_RGBA = (0.5, 0.5, 0.5, 1)  # of a geom, with which it has the colour of its material
PLAIN = ("joint", "tendon", "site", "body", "so3")  # transmissions that follow from the target
# A column, by the name of its attribute, or as a function of all rows.
ColumnSource = str | Callable[[Sequence[Any]], ReportColumn]


def _declared(name: str, rows: "Sequence[ModelObject]", model: "mujoco.MjModel") -> ReportColumn:
    """Returns the column of an attribute, formatted by its declaration."""
    values = [getattr(row, name) for row in rows]
    some = next((value for value in values if value is not None), None)
    if not rows or name not in (facts := rows[0].facts()):
        return texts(name, values)
    fact = facts[name]
    heading = fact.heading or name.replace("_", " ")
    if some is None or isinstance(some, str):
        return texts(heading, values, extra=fact.is_detail)

    telling = [row.id for row, value in zip(rows, values, strict=True) if value] or [row.id for row in rows]
    unit = stacked(fact.unit(model, index) for index in telling)
    if not isinstance(some, tuple):
        return numbers(heading, values, unit, extra=fact.is_detail, usual=fact.usual)
    if fact.is_range:
        return ranges(heading, values, [unit] * len(values), extra=fact.is_detail)
    return vectors(heading, values, unit, extra=fact.is_detail)


def _tree(rows: "Sequence[Body]") -> ReportColumn:
    """Returns the names of bodies as a tree."""
    last = {row.parent: row.id for row in rows}
    lines: list[str] = []
    stems = {-1: ""}
    for row in rows:
        stem, ends, root = stems[row.parent], last[row.parent] == row.id, row.parent < 0
        lines.append(clean(row.name) if root else f"{stem}{'└─' if ends else '├─'} {clean(row.name)}")
        stems[row.id] = "" if root else stem + ("   " if ends else "│  ")
    return ReportColumn("body", lines, below=[stems[row.id] + ("│" if row.id in last else "") for row in rows])


def _grouped(objects: Sequence[str], types: Sequence[str]) -> str:
    """Lists names with their types: `hip_x, hip_y (hinge)`."""
    groups: list[tuple[str, list[str]]] = []
    for name, kind in zip(objects, types, strict=True):
        if not groups or groups[-1][0] != kind:
            groups.append((kind, []))
        groups[-1][1].append(clean(name))
    return ", ".join(f"{', '.join(group)} ({kind})" for kind, group in groups)


def _tally(types: Sequence[str]) -> str:
    counts = {kind: types.count(kind) for kind in dict.fromkeys(types)}
    return ", ".join(kind if count == 1 else f"{count} {kind}" for kind, count in counts.items())


def _gears(rows: "Sequence[Actuator]") -> ReportColumn:
    gears = [common(vector(gear) or "0" for gear in row.gear) for row in rows]
    return ReportColumn("gear", [] if set(gears) == {"1"} else gears, right=True, extra=True)


def _targets(rows: "Sequence[Actuator]") -> ReportColumn:
    """Returns the targets of actuators, with their kind if it varies."""
    kinds = {row.target_kind for row in rows}
    is_one = len(kinds) == 1
    heading = f"acts on {next(iter(kinds))}" if is_one else "acts on"
    return ReportColumn(heading, [_target(row, bare=is_one) for row in rows])


def _target(row: "Actuator", *, bare: bool) -> str:
    target = clean(row.target or "") if bare else reference(row.target_kind, row.target)
    origin = f" from {clean(row.reference)}" if row.reference else ""
    by = "" if row.transmission in PLAIN else f" ({row.transmission})"
    return f"{target}{origin}{by}"


def _gain(row: "Actuator") -> str:
    return "" if row.kind == "motor" else _law(row.gain, "fixed", row.gain_parameters)


def _law(kind: str, usual: str, parameters: Sequence[float]) -> str:
    """Formats the parameters of a gain, bias or dynamics, after its type unless that is the usual one."""
    return "" if kind == "none" else " ".join(filter(None, ("" if kind == usual else kind, vector(parameters))))


def _contact_bits(rows: "Sequence[Geom]") -> ReportColumn:
    """Returns contype and conaffinity, if any geom has values other than 1 and 1."""
    bits = [f"{row.contype} {row.conaffinity}" for row in rows]
    return ReportColumn("contact bits", bits if set(bits) != {"1 1"} else [], extra=True)


def _resolution(row: "Camera") -> str:
    return "x".join(map(str, row.resolution)) if row.resolution != (1, 1) else ""


def _outputs(rows: "Sequence[Camera]") -> ReportColumn:
    has_resolution = any(map(_resolution, rows))
    return ReportColumn("outputs", [" ".join(row.outputs) if has_resolution else "" for row in rows], extra=True)


def _mode(row: "Camera | Light") -> str:
    return f"{row.mode} {clean(row.target)}" if row.target else row.mode


def _point(point: "TendonPathElement") -> str:
    if point.kind == "pulley":
        return f"pulley /{number(point.coefficient)}"
    name = clean(point.name or "")
    return name if point.coefficient is None else f"{number(point.coefficient)} {name}"


def _lengths(rows: "Sequence[Tendon]") -> ReportColumn:
    return numbers("length", [row.length0 for row in rows], stacked(row.unit for row in rows))


def _cells(heading: str, cell: Callable[[Any], str], **options: Any) -> Callable[[Sequence[Any]], ReportColumn]:
    """Returns a column with a text per row."""
    return lambda rows: ReportColumn(heading, [cell(row) for row in rows], **options)


def _settings(rows: "Sequence[NonDefaultSetting]", model: "mujoco.MjModel") -> list[ReportColumn]:
    return [
        texts("setting", [row.path for row in rows]),
        ReportColumn("value", [_value(row.value) for row in rows]),
        ReportColumn("default", [_value(row.default) for row in rows]),
        texts("unit", [row.unit for row in rows]),
    ]


def _value(value: "Value") -> str:
    return vector(value) if isinstance(value, tuple) else value if isinstance(value, str) else number(value)


def _assets(rows: "Sequence[Asset]", model: "mujoco.MjModel") -> list[ReportColumn]:
    own = next((row.path for row in rows if row.kind == "model" and row.path), None)
    return [
        texts("kind", [row.kind for row in rows]),
        texts("name", [row.name for row in rows]),
        ReportColumn("size", ["" if row.path is None else byte_size(row.bytes) for row in rows], right=True),
        ReportColumn("content", [_content(row) for row in rows]),
        ReportColumn(
            "file" if own is None else "file, from the model's folder",
            [_beside(own, row.path) for row in rows],
            whole=True,
        ),
    ]


def _beside(own: str | None, path: str | None) -> str:
    """Returns a path relative to the folder of the model."""
    if path is None:
        return ""
    return clean(path if own is None else os.path.relpath(path, Path(own).parent))


def _content(row: "Asset") -> str:
    if "width" in row.content:
        return "x".join(map(str, row.content.values()))
    return ", ".join(f"{count} {what}" for what, count in row.content.items())


@dataclass(frozen=True)
class _TableSection:
    """A section with one row per object.

    Attributes:
      columns: makes the columns from the rows and the model.
      is_detail: shown only on request.
      is_news: returns whether the rows add anything to the summary.
    """

    columns: "Callable[[Sequence[Any], mujoco.MjModel], list[ReportColumn]]"
    is_detail: bool = False
    is_news: Callable[[Sequence[Any]], bool] = bool


@dataclass(frozen=True)
class LineSection:
    """A section of labelled lines.

    Attributes:
      lines: makes labels and values.
      title: the title, if it is not the section's name.
      is_detail: shown only on request.
    """

    lines: "Callable[[ModelDescription], Sequence[tuple[str, str]]]"
    title: "Callable[[ModelDescription], str] | None" = None
    is_detail: bool = False


def _objects(*sources: ColumnSource, is_detail: bool = False) -> _TableSection:
    """Returns the section of a kind of objects."""

    def columns(rows: Sequence[Any], model: "mujoco.MjModel") -> list[ReportColumn]:
        return [source(rows) if callable(source) else _declared(source, rows, model) for source in sources]

    return _TableSection(columns, is_detail)


def _has_files(assets: "Sequence[Asset]") -> bool:
    """Returns whether the model has further files, which the summary names."""
    return any(asset.path and asset.kind != "model" for asset in assets)


def summary(of: "ModelSummary") -> list[tuple[str, str]]:
    """Describes a model in a few lines."""
    memory = of.memory
    state = [name for name in of.sizes if name in STATE]
    rest = [name for name in of.sizes if name not in (*STATE, *HIDDEN)]
    return [
        ("file", clean(of.file or "")),
        ("mass", f"{number(of.mass)} kg"),
        ("centre of mass", _point_in_space(of.centre_of_mass, of.extent)),
        ("extent", f"{number(of.extent)} m around {vector(of.center)}"),
        ("timestep", f"{number(of.timestep)} s, {of.integrator} integrator"),
        ("solver", f"{of.solver}, {of.jacobian} Jacobian, {of.cone} friction cone"),
        ("gravity", f"{vector(of.gravity)} m/s²"),
        ("memory", f"model {byte_size(memory.model)}, data {byte_size(memory.data)}, arena {byte_size(memory.arena)}"),
        ("state", _sizes(of, state)),
        ("objects", _sizes(of, rest)),
        ("compiled by", f"MuJoCo {of.mujoco}"),
    ]


def _point_in_space(values: Sequence[float] | None, extent: float) -> str:
    """Formats a position; components that are negligible relative to the extent of the model are 0."""
    return "" if values is None else f"{vector(value if abs(value) > NEGLIGIBLE * extent else 0 for value in values)} m"


def _sizes(of: "ModelSummary", fields: Sequence[str]) -> str:
    shown = [name for name in fields if of.sizes[name] or name in ALWAYS]
    return "  ".join(f"{name}={of.sizes[name]}" for name in shown)


def statistics(of: "ModelStatistics") -> list[tuple[str, str]]:
    return [
        ("center", f"{vector(of.center)} m"),
        ("extent", f"{number(of.extent)} m"),
        ("meansize", f"{number(of.meansize)} m"),
        ("meanmass", f"{number(of.meanmass)} kg"),
        ("meaninertia", f"{number(of.meaninertia)} kg·m²"),
    ]


SECTIONS: "Mapping[str, _TableSection | LineSection]" = {
    "summary": LineSection(lambda of: summary(of.summary), lambda of: clean(of.summary.name)),
    "bodies": _objects(
        _tree,
        _cells("joints", lambda body: _grouped(body.joints, body.joint_types)),
        _cells("", lambda body: "mocap" if body.mocap else ""),
        "mass",
        "subtree_mass",
        _cells("geoms", lambda body: _tally(body.geom_types), extra=True),
        "gravity_compensation",
    ),
    "joints": _objects(
        *("name", "type", "range"),
        _cells("qpos", lambda joint: slots(joint.qpos, joint.qpos_size), right=True),
        _cells("qvel", lambda joint: slots(joint.dof, joint.dof_size), right=True),
        *("stiffness", "damping", "armature", "frictionloss", "body", "axis"),
    ),
    "geoms": _objects(
        *("name", "type", "body", "size", "asset", "condim", "friction"),
        _contact_bits,
        *("margin", "gap", "group", "material"),
        _cells("rgba", lambda geom: "" if geom.rgba == DEFAULT_RGBA else vector(geom.rgba), extra=True),
        is_detail=True,
    ),
    "sites": _objects("name", "type", "body", "size", "position", "group", is_detail=True),
    "actuators": _objects(
        *("name", "kind"),
        _targets,
        _cells("ctrl", lambda actuator: slots(actuator.ctrl, actuator.ctrl_size), right=True),
        _cells("ctrl range", lambda actuator: common(map(span, actuator.ctrl_range)), right=True),
        _gears,
        "force_range",
        _cells("act", lambda actuator: slots(actuator.act, actuator.act_size), right=True, extra=True),
        "act_range",
        _cells("gain", _gain, right=True, extra=True),
        _cells("bias", lambda actuator: _law(actuator.bias, "affine", actuator.bias_parameters), extra=True),
        _cells("dynamics", lambda actuator: _law(actuator.dynamics, "", actuator.dynamics_parameters), extra=True),
        *("delay", "group"),
    ),
    "sensors": _objects(
        *("name", "type"),
        _cells("of", lambda sensor: reference(sensor.object_kind, sensor.object)),
        _cells("relative to", lambda sensor: reference(sensor.reference_kind, sensor.reference)),
        _cells("sensordata", lambda sensor: slots(sensor.address, sensor.dim), right=True, extra=True),
        *("unit", "cutoff", "noise", "delay", "period", "plugin"),
    ),
    "cameras": _objects(
        *("name", "body"),
        _cells("mode", _mode),
        *("fovy", "height"),
        _cells("", lambda camera: "" if camera.projection == "perspective" else camera.projection),
        *("sensor_size", "focal_length"),
        _cells("resolution", _resolution, unit="px", extra=True),
        "position",
        _outputs,
    ),
    "lights": _objects(
        *("name", "type", "body"),
        _cells("mode", _mode),
        _cells("", lambda light: "" if light.active else "off"),
        _cells("shadow", lambda light: "yes" if light.shadow else "no"),
        "position",
        is_detail=True,
    ),
    "keyframes": _objects(
        *("name", "time"),
        _cells("", lambda keyframe: "" if keyframe.finite else "not finite"),
        _cells("outside its range", lambda keyframe: ", ".join(map(clean, keyframe.outside))),
    ),
    "tendons": _objects(
        *("name", "type"),
        _cells("path", lambda tendon: ", ".join(map(_point, tendon.path))),
        _lengths,
        *("range", "stiffness", "damping", "armature", "frictionloss"),
    ),
    "equalities": _objects(
        *("name", "type"),
        _cells("of", lambda equality: reference(equality.object_kind, equality.object1)),
        _cells("and", lambda equality: reference(equality.object_kind, equality.object2)),
        _cells("", lambda equality: "" if equality.active else "off"),
        *("data", "solref"),
    ),
    "pairs": _objects("name", "geom1", "geom2", "condim", "friction", "margin", "gap", "solref", "solimp"),
    "excludes": _objects("name", "body1", "body2"),
    "flexes": _objects(
        *("name", "elements_are", "elements", "vertices", "edges", "nodes", "radius"),
        _cells("kept by", lambda flex: "" if flex.edge_equality == "none" else flex.edge_equality),
        *("self_collision", "edge_stiffness", "edge_damping", "damping"),
    ),
    "plugins": _objects(
        *("name", "plugin"),
        _cells("computes", lambda plugin: ", ".join(map(clean, plugin.users))),
        _cells("settings", lambda plugin: clean(", ".join(f"{key}={value}" for key, value in plugin.settings.items()))),
        "state",
    ),
    "options": _TableSection(_settings),
    "visual": _TableSection(_settings, is_detail=True),
    "statistics": LineSection(lambda of: statistics(of.statistics), is_detail=True),
    "assets": _TableSection(_assets, is_news=_has_files),
}


def demonstrations_page(listed: "DemonstrationList") -> str:
    """Formats the origin of the demonstrations in a file, and a table of them."""
    from mjrun.cli.terminal_layout import TerminalReport

    page, origin, episodes = TerminalReport(), listed.origin, listed.demonstrations
    rate = origin.control_rate
    page.lines(
        clean(listed.path),
        [
            ("task", clean(origin.task)),
            ("instruction", clean(origin.instruction)),
            ("robot", listing(origin.robots)),
            ("made with", common(_programs(listed))),
            ("control rate", f"{number(rate)} Hz" if rate else ""),
            ("cameras", listing(listed.cameras)),
            ("subsets", listing([f"{name} ({count})" for name, count in listed.subsets.items()])),
        ],
    )
    columns = [
        texts("name", [each.name for each in episodes]),
        numbers("states", [each.states for each in episodes]),
        numbers("duration", [each.duration for each in episodes], "s"),
        numbers("reward", [each.reward for each in episodes]),
        texts("images", [listing(each.images) for each in episodes]),
        texts("instruction", [each.instruction for each in episodes]),
    ]
    page.table("demonstrations", columns, len(episodes))
    camera = f" --camera {shlex.quote(listed.cameras[0])}" if listed.cameras else ""
    page.note(clean(f"mjrun video {shlex.quote(f'{listed.path}:{episodes[0].name}')}{camera}"))
    return page.text()


def _programs(listed: "DemonstrationList") -> list[str]:
    """Returns the programs that made the file, with their versions."""
    versions = {"MuJoCo": listed.origin.mujoco, "robosuite": listed.origin.robosuite}
    return [clean(f"{program} {version}") for program, version in versions.items() if version]


def task_page(task: "TaskDescription", sections: Sequence[str], command_line: str) -> str:
    """Formats the sections as text; without names, all sections, with long ones cut."""
    from mjrun.cli.terminal_layout import TerminalReport

    page = TerminalReport()
    for name in sections or ("task", *TASK_TABLES):
        if name == "task":
            page.lines("task", _task_facts(task.task))
            continue
        columns = TASK_TABLES[name](task)
        count = len(columns[0].cells)
        if count or sections:
            page.table(name, columns, count, None if sections else ROWS, f"{command_line} {name}")
    return page.text()


def _task_facts(task: "TaskSummary") -> list[tuple[str, str]]:
    steps = f"{counted(task.control_steps, 'step')} of {number(task.timestep)} s"
    return [
        ("model", clean(task.model)),
        ("control period", f"{number(task.control_dt)} s, {steps}"),
        ("episode", _length(task)),
        ("derived quantities", task.derived),
        ("policy", f"{task.observations} numbers in, {task.actions} out"),
    ]


def _length(task: "TaskSummary") -> str:
    if task.duration is None or task.periods is None:
        return "no limit"
    return f"{number(task.duration)} s, {counted(task.periods, 'control period')}"


def _observations(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.observations
    return [
        ReportColumn("index", [str(row.index) for row in rows], right=True),
        texts("name", [row.name for row in rows]),
        texts("source", [row.source for row in rows]),
        texts("unit", [row.unit for row in rows]),
        numbers("offset", [row.offset for row in rows]),
        numbers("scale", [row.scale for row in rows], usual=1),
        ranges("clip", [_limits(row.low, row.high) for row in rows]),
        texts("frame", [row.frame for row in rows]),
        texts("noise", [row.noise for row in rows]),
        numbers("delay", [row.delay for row in rows], "periods"),
    ]


def _actions(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.actions
    return [
        ReportColumn("index", [str(row.index) for row in rows], right=True),
        texts("name", [row.name for row in rows]),
        texts("target", [row.target for row in rows]),
        texts("unit", [row.unit for row in rows]),
        texts("squash", ["" if row.squash == "none" else row.squash for row in rows]),
        ranges("clip", [_limits(row.low, row.high) for row in rows]),
        numbers("scale", [row.scale for row in rows], usual=1),
        numbers("offset", [row.offset for row in rows]),
        numbers("kp", [row.kp for row in rows]),
        numbers("kd", [row.kd for row in rows]),
        numbers("delay", [row.delay for row in rows], "periods"),
        texts("actuator", ["" if row.actuator == row.name else row.actuator for row in rows]),
        ranges("ctrlrange", [row.range for row in rows]),
    ]


def _commands(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.commands
    return [
        texts("name", [row.name for row in rows]),
        ReportColumn("numbers", [str(row.size) for row in rows], right=True),
        texts("source", [row.source for row in rows]),
    ]


def _rewards(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.rewards
    return [
        texts("name", [row.name for row in rows]),
        numbers("weight", [row.weight for row in rows], usual=1),
        texts("value", [row.value for row in rows]),
    ]


def _terminations(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.terminations
    return [
        texts("name", [row.name for row in rows]),
        texts("ends in", [row.kind for row in rows]),
        texts("when", [row.when for row in rows]),
    ]


def _reset(task: "TaskDescription") -> list[ReportColumn]:
    rows = task.reset
    return [
        texts("", [row.what for row in rows]),
        texts("name", [row.name for row in rows]),
        texts("value", [row.value for row in rows]),
    ]


def _limits(low: float | None, high: float | None) -> tuple[float, float] | None:
    if low is None and high is None:
        return None
    return -math.inf if low is None else low, math.inf if high is None else high


TASK_TABLES: "Mapping[str, Callable[[TaskDescription], list[ReportColumn]]]" = {
    "observations": _observations,
    "actions": _actions,
    "commands": _commands,
    "rewards": _rewards,
    "terminations": _terminations,
    "reset": _reset,
}
