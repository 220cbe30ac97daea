"""Selection of probes by name, object and wildcard."""

import re
from collections.abc import Container, Iterable, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, option, quoted
from mjrun.model.names import object_names
from mjrun.model.table_column import Column
from mjrun.options.trace import PROBES
from mjrun.probe.contacts import pair
from mjrun.probe.derived import DERIVED
from mjrun.probe.episode_columns import EPISODE_GROUPS, EpisodeColumns, EpisodeProbe, no_episode
from mjrun.probe.fields import (
    COMPONENTS,
    SPATIAL,
    MjDataProbe,
    RecordedFieldProbe,
    extents,
    field_probe,
    offered,
    unmeasurable,
)

ALIASES = {"sensor": "sensordata"}
# Probes that everyday words, in the singular, may mean.
EVERYDAY_NAMES = {
    "acceleration": ("qacc", "cacc"),
    "action": ("ctrl",),
    "angle": ("qpos",),
    "control": ("ctrl",),
    "force": ("actuator_force", "contact_force", "cfrc_ext"),
    "friction": ("contact_force/friction", "contact_force"),
    "height": ("xpos/BODY/z", "com"),
    "joint_angle": ("qpos",),
    "joint_force": ("qfrc_actuator",),
    "joint_position": ("qpos",),
    "joint_torque": ("qfrc_actuator",),
    "joint_velocity": ("qvel",),
    "orientation": ("xquat", "qpos"),
    "pose": ("xpos", "xquat"),
    "position": ("xpos", "qpos"),
    "rotation": ("xquat", "xmat"),
    "torque": ("qfrc_actuator", "actuator_force"),
    "velocity": ("qvel", "speed", "cvel"),
}
# A bare object may be of another kind than the first one of a name.
FALLBACKS = {
    "xpos": ("geom_xpos", "site_xpos", "cam_xpos", "light_xpos"),
    "xquat": ("geom_xquat", "site_xquat"),
    "xmat": ("geom_xmat", "site_xmat", "cam_xmat"),
}
PAIRS = "contact"  # the group that also has columns for any two objects: `contact/ball/floor`
PARTS = {part for parts in (*COMPONENTS.values(), *SPATIAL.values()) for part in parts}
Probe = RecordedFieldProbe | MjDataProbe | EpisodeProbe
TIME = "time"  # the first column of every table, selected or not


def select(
    model: mujoco.MjModel, probe_names: Iterable[str] = PROBES, episode: EpisodeColumns | None = None
) -> list[Probe]:
    """Returns the probes of these names: `qpos`, `qpos[left_*]`, `sensor[imu]`, or a column such as `xpos/hand/z`.

    `contact/ball/floor` is the number of contacts between two objects, see `mjrun.probe.contacts.pair`.

    A whole group without columns in this model (`act` without activations) is ignored, and so is `time`, which every
    table has.

    Args:
      episode: columns of episodes, if a policy acts.

    Raises:
      UnknownNameError: a name, object or column is unknown; the message lists near and valid names.
      UsageError: two names give the same column, a field cannot be measured at an instant, or no policy acts.
    """
    texts = [text for text in probe_names if text.strip() != TIME]  # spaces at the end may belong to a name
    probes = [_select_one(model, episode, text) for text in texts]
    seen: dict[str, str] = {}
    for probe, text in zip(probes, texts, strict=True):
        for column in probe.columns:
            if column.name in seen:
                raise UsageError(
                    f"{option('probe')}: {quoted(seen[column.name])} and {quoted(text)} both give {quoted(column.name)}"
                )
            seen[column.name] = text
    return [probe for probe in probes if probe.columns]


def split(text: str) -> list[str]:
    """Splits a list of probes at its commas, except those in brackets."""
    return [part for part in re.split(r",(?![^\[]*\])", text) if part.strip()]


def require_measurable(model: mujoco.MjModel, field: str) -> None:
    """Raises `UsageError` if `field` cannot be measured at an instant of `model`."""
    if reason := unmeasurable(model, field):
        raise UsageError(f"{option('probe')}: {field} cannot be measured at an instant: {reason}")


def available_columns(
    model: mujoco.MjModel, episode: EpisodeColumns | None = None, groups: Container[str] | None = None
) -> list[Column]:
    """Returns every column that can be measured, except contacts between two objects: there are too many pairs.

    Args:
      groups: groups of the columns, the beginnings of their names; by default all. Columns of episodes belong to none.
    """
    names = [name for name in (*PROBES, *DERIVED, *offered(model)) if name not in (PAIRS, *ALIASES.values())]
    chosen = [name for name in dict.fromkeys([*names, PAIRS]) if groups is None or name in groups]
    by_name = {column.name: column for name in chosen for column in _whole(model, None, name).columns}
    return [*by_name.values(), *(episode.columns if episode else ())]


def selected_columns(
    model: mujoco.MjModel, probe_names: Iterable[str], episode: EpisodeColumns | None = None
) -> list[Column]:
    """Returns the columns of `probe_names`, see `select`."""
    return [column for probe in select(model, probe_names, episode) for column in probe.columns]


def aliases(model: mujoco.MjModel, groups: Container[str] | None = None) -> dict[str, str]:
    """Returns the other names of columns of `model`, such as `xpos/skin/z` of a geom, with the columns' own names.

    Args:
      groups: groups of the other names, by default all.
    """
    others = {**FALLBACKS, **{field: (name,) for name, field in ALIASES.items()}}
    aliases_by_name: dict[str, str] = {}
    for group in [group for group in others if groups is None or group in groups]:
        columns = [column.name for candidate in others[group] for column in _whole(model, None, candidate).columns]
        for column in columns:  # the first of a name counts
            aliases_by_name.setdefault(f"{group}/{column.partition('/')[2]}", column)
    return aliases_by_name


def object_of(name: str) -> str:
    """Returns the object of the column `name`: `left/hand` of `xpos/left/hand/x`."""
    rest = name.partition("/")[2]
    parent, _, part = rest.rpartition("/")
    return parent if parent and (part in PARTS or part.isdigit()) else rest


def _select_one(model: mujoco.MjModel, episode: EpisodeColumns | None, text: str) -> Probe:
    bracketed = re.fullmatch(r"([^\[\]/]+)\[([^\[\]]*)\]", text.strip())
    if bracketed:
        return _objects(model, episode, bracketed[1].strip(), bracketed[2].split(","))
    group, slash, rest = text.partition("/")
    if not slash:
        return _whole(model, episode, text.strip())
    return _named(model, episode, group.strip(), rest)


def _whole(model: mujoco.MjModel, episode: EpisodeColumns | None, name: str) -> Probe:
    if name in EPISODE_GROUPS:
        if episode is None:
            raise no_episode(name)
        return episode.probes[name]
    if name in DERIVED:
        return DERIVED[name](model)
    field = ALIASES.get(name, name)
    require_measurable(model, field)
    if field not in extents():
        called = re.fullmatch(r"(\w+)\((.+)\)", name)  # as in expressions
        meant = (f"{called[1]}[{called[2]}]",) if called else EVERYDAY_NAMES.get(name.lower().removesuffix("s"), ())
        raise UnknownNameError("probe", name, [*dict.fromkeys([*PROBES, *DERIVED, *offered(model)])], meant=meant)
    return field_probe(model, field, name)


def _objects(model: mujoco.MjModel, episode: EpisodeColumns | None, name: str, patterns: Sequence[str]) -> Probe:
    """Selects the columns of the objects that match any of `patterns`, with the spaces around them or without."""
    for candidate in (name, *FALLBACKS.get(name, ())):
        probe = _whole(model, episode, candidate)
        patterns = [p if any(_matches(column, p) for column in probe.columns) else p.strip() for p in patterns]
        indices = [i for i, column in enumerate(probe.columns) if any(_matches(column, p) for p in patterns)]
        if indices:
            missing = [p for p in patterns if not any(_matches(probe.columns[i], p) for i in indices)]
            if not missing:
                return probe.only(indices)
            patterns = [missing[0]]
    objects = list(dict.fromkeys(object_of(column.name) for column in _whole(model, episode, name).columns))
    joints = joints_of(model, patterns[0], objects)
    error = UnknownNameError("object", patterns[0], objects, where=f"probe {name}", meant=joints)
    if name == PAIRS:
        error.add_note(f"{PAIRS}/A/B counts the contacts between two bodies or geoms")
    raise _with_advice(error, name, patterns[0], objects)


def _named(model: mujoco.MjModel, episode: EpisodeColumns | None, group: str, rest: str) -> Probe:
    """Selects the column `group/rest`, or all that begin with it; of a geom or site if no body has this name."""
    candidates = {candidate: _whole(model, episode, candidate) for candidate in (group, *FALLBACKS.get(group, ()))}
    for name in dict.fromkeys((rest, rest.strip())):
        for candidate, probe in candidates.items():
            text, names = f"{candidate}/{name}", [column.name for column in probe.columns]
            inner = [i for i, column in enumerate(names) if column.startswith(f"{text}/")]
            if indices := [names.index(text)] if text in names else inner:
                return probe.only(indices)

    if group == PAIRS:
        for name in (rest, rest.rstrip(), rest.lstrip()):  # a name may begin or end with spaces
            with suppress(UnknownNameError):
                return pair(name, model)
        return pair(rest.strip(), model)

    rest = rest.strip()
    for probe in candidates.values():  # lists of probes lose the spaces at the end of a name
        objects = [object_of(column.name) for column in probe.columns]
        if len({name for name in objects if name.strip() == rest}) == 1:
            return probe.only([i for i, name in enumerate(objects) if name.strip() == rest])
    columns = [column.name for column in _whole(model, episode, group).columns]
    objects = dict.fromkeys(object_of(name) for name in columns)
    joints = joints_of(model, rest, objects)
    error = UnknownNameError("column", f"{group}/{rest}", columns, meant=[f"{group}/{joint}" for joint in joints])
    raise _with_advice(error, group, rest, objects)


def _with_advice(error: UnknownNameError, group: str, text: str, objects: Iterable[str]) -> UnknownNameError:
    """Adds how to write the name of an object that contains a comma, if `text` is the part before it."""
    if meant := next((name for name in objects if name.startswith(f"{text},")), ""):
        error.add_note(f"commas separate probes: write {clean(group)}[{clean(meant.replace(',', '?'))}]")
    return error


def joints_of(model: mujoco.MjModel, body: str, objects: Container[str]) -> list[str]:
    """Returns the joints of the body of this name, if it exists, that are among `objects`."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)
    joints = object_names(model, "joint", np.flatnonzero(model.jnt_bodyid == index).tolist())
    return [joint for joint in joints if joint in objects]


def _matches(column: Column, pattern: str) -> bool:
    rest = column.name.split("/", 1)[-1]
    return any(name == pattern or fnmatchcase(name, pattern) for name in (rest, rest.rpartition("/")[0]) if name)


@dataclass(frozen=True)
class ColumnGroup:
    """The columns whose names begin with the same word.

    Attributes:
      name: that word, by which a probe selects all of them.
      columns: the columns, in order.
    """

    name: str
    columns: Sequence[Column]

    def texts(self, attribute: str) -> list[str]:
        """Returns the different texts of an attribute of the columns, in order, without empty ones."""
        return [text for text in dict.fromkeys(getattr(column, attribute) for column in self.columns) if text]


def column_groups(columns: Iterable[Column]) -> list[ColumnGroup]:
    """Returns the groups of columns, in the order of their first columns."""
    groups: dict[str, list[Column]] = {}
    for column in columns:
        groups.setdefault(column.name.partition("/")[0], []).append(column)
    return [ColumnGroup(name, members) for name, members in groups.items()]
