"""Tables whose columns are named or mapped: column names, values of expressions, motions, and controls."""

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, listing, near, option
from mjrun.formats.table_reader import open_table, read_table
from mjrun.model.names import JOINT_TRANSMISSIONS, control_names
from mjrun.options.number_kinds import UNITS as EXACT_UNITS
from mjrun.options.setting_kinds import UNITS
from mjrun.physics.control import ControlTable
from mjrun.physics.kinematic_samples import FIELDS, Interpolation, KinematicMotion, KinematicSamples, quaternions
from mjrun.physics.timed_rows import TimedRows
from mjrun.probe.fields import field_probe, offered
from mjrun.probe.row_expression import RowExpression
from mjrun.probe.scanner import spelled
from mjrun.simulation.column_map import TIME, ColumnMap, column_map, time_hint
from mjrun.timeline import seconds

POSITIONS = ("qpos", "mocap_pos", "mocap_quat")
CONTROL = r"ctrl(/|[_.\[]?[0-9])"  # names of controls begin like this
SI_FACTORS = {
    **{name: float(factor) for name, factor in EXACT_UNITS["SECONDS"].items()},
    **{f"{name}{rate}": factor for name, (_, factor) in UNITS.items() for rate in ("", "/s")},
}
ANGLE, DEGREES = r"\s*\[(deg|°|rad)\]$", r"\[(deg|°)\]$"


def column_names(path: str | Path) -> list[str]:
    """Returns the names of all columns of a table.

    Raises:
      FileError: the table cannot be read.
    """
    names = list[str]()

    def note(name: str) -> bool:
        names.append(name)
        return False

    with open_table(path, note):
        return names


def evaluated(path: str | Path, expressions: Mapping[str, RowExpression]) -> dict[str, np.ndarray]:
    """Evaluates expressions on all rows of a table, `(n,)` each; NaN where a cell is missing.

    A column that is used unchanged is converted to SI units if the table states another unit, such as degrees. Columns
    that no expression reads are not loaded; the others are loaded block by block.

    Raises:
      FileError: the table cannot be read.
    """
    evaluators = {key: expression.evaluator() for key, expression in expressions.items()}
    parts: dict[str, list[np.ndarray]] = {key: [np.empty(0)] for key in expressions}
    read = list(dict.fromkeys(name for expression in expressions.values() for name in expression.columns))
    with open_table(path, read or column_names(path)[:1], missing="nan") as table:  # one column, to count the rows
        for block in table.blocks():
            columns = dict(zip(table.names, block.T, strict=True))
            for key, evaluator in evaluators.items():
                parts[key].append(evaluator.feed(columns))
        table.require_unchanged()
        factors = {key: _si_factor(expression, table.units) for key, expression in expressions.items()}
    return {key: np.concatenate(blocks) * factors[key] for key, blocks in parts.items()}


def _si_factor(expression: RowExpression, units: Mapping[str, str]) -> float:
    """Returns the factor to SI units of a column with a stated unit; 1 for an expression, which converts by itself."""
    return SI_FACTORS.get(units.get(expression.columns[0], ""), 1) if expression.is_column else 1


def state_map(model: mujoco.MjModel, names: Sequence[str], texts: Sequence[str], quat: str, source: str) -> ColumnMap:
    """Maps the columns `names` of a table to the state of `model`, as in `column_map`.

    Raises:
      UsageError: as `column_map`; or the table has no positions, or those of another model.
    """
    known = offered(model)
    columns = {f: [c.name for c in field_probe(model, f).columns] if f in known else [] for f in FIELDS}
    turning = {f: quaternions(model, f) for f in FIELDS}
    mapped = column_map(columns, names, texts, source, quat=quat, quaternions=turning)
    _require_positions(mapped, names, source)
    return mapped


def _require_positions(mapped: ColumnMap, names: Sequence[str], source: str) -> None:
    """Raises UsageError if a table has no positions of a model, or those of another one."""
    unknown = [name for name in mapped.unused if name.startswith("qpos/")]
    lacking = mapped.lacking("qpos")
    if unknown and lacking:
        raise UsageError(
            f"{clean(source)} is a table of another model: it has {listing(unknown)}, and lacks {listing(lacking)}\n"
            f"{_hint(lacking, names)}"
        )
    positions = [name for field in POSITIONS for name in mapped.columns[field]]
    if not any(name in mapped.sources for name in positions):
        raise UsageError(
            f"{clean(source)} has no positions of this model\nit has {listing(names) or 'no columns'}\n"
            f"the model has {listing([TIME, *positions])}\n{_hint(lacking, names)}"
        )


def _hint(wanted: Sequence[str], names: Sequence[str]) -> str:
    """Suggests an entry of a map for one of the model's columns `wanted`."""
    others = [name for name in names if name != TIME]
    for name in wanted:
        leaf = name.partition("/")[2]
        alike = near(leaf, others) or [other for other in others if leaf.casefold() in other.casefold()]
        if alike:
            degrees = "*pi/180" if "deg" in alike[0].casefold() else ""
            return f"{option('map')} assigns columns, as in {clean(name)}={clean(spelled(alike[0]))}{degrees}"
    return f"{option('map')} assigns columns, as in {clean((wanted or ['qpos/JOINT'])[0])}=COLUMN"


def read_motion(
    path: Path,
    model: mujoco.MjModel,
    start: mujoco.MjData,
    texts: Sequence[str] = (),
    quat: str = "wxyz",
    rate: Fraction | None = None,
    interpolation: Interpolation | None = None,
) -> KinematicMotion:
    """Reads the motion of `model` from a table.

    Args:
      start: state of everything that the table does not contain.
      texts: map, as in `state_map`.
      quat: order of quaternions whose components are not named.
      rate: rows per second [Hz] of a table without times.
      interpolation: interpolation between rows.

    Raises:
      UsageError: the table has no positions of this model or no times, or is not a motion; or the map is invalid.
      FileError: the table cannot be read.
    """
    names = column_names(path)
    mapped = state_map(model, names, texts, quat, str(path))
    if mapped.time is None and rate is None:
        raise UsageError(
            f"{clean(str(path))} has no column 'time'\n"
            f"{time_hint(names)}, or {option('replay_rate')} the number of rows per second"
        )
    if mapped.time is not None and rate is not None:
        raise UsageError(
            f"{clean(str(path))} has a column 'time', and {option('replay_rate')} is for tables without one\n"
            f"{option('map')} can specify another time: time=EXPRESSION"
        )
    values = evaluated(path, mapped.sources if mapped.time is None else {**mapped.sources, TIME: mapped.time})
    if rate is None:
        times = values.pop(TIME)
    else:
        times = np.array(seconds(np.arange(len(next(iter(values.values())))), 1 / rate), float)
    by_field = {
        field: {place: values[name] for place, name in enumerate(columns) if name in values}
        for field, columns in mapped.columns.items()
    }
    return KinematicMotion(model, start, KinematicSamples(str(path), times, mapped.columns, by_field), interpolation)


def read_controls(
    path: Path, model: mujoco.MjModel, source: str, constants: Mapping[str, Sequence[int]], *, linear: bool
) -> ControlTable:
    """Reads the controls of `model` from a table.

    Args:
      source: name of the table for messages.
      constants: indices of the controls that the option `ctrl` sets, by its key; `*` means the others.
      linear: whether controls change in straight lines; otherwise they hold until the next one.

    Raises:
      UnknownNameError: a column names an actuator that is not in the model.
      UsageError: the table lacks times or an actuator, drives one that has a constant, or has invalid numbers.
      FileError: the table cannot be read.
    """
    actuators, available = control_names(model), column_names(path)
    names = [f"ctrl/{name}" for name in actuators]
    others = _other_controls(model, available)
    table = read_table(path, lambda name: name in {TIME, *others} or re.match(CONTROL, name) is not None)
    columns = table.columns
    mapped = column_map({"ctrl": names}, list(columns), list(others.values()), source)

    if mapped.time is None:
        raise UsageError(
            f"{clean(source)} has no column 'time'\nit needs 'time' in seconds, and ctrl/ACTUATOR for each actuator"
        )
    driven = [index for index, name in enumerate(names) if name in mapped.sources]
    twice = [key for key, held in constants.items() if key != "*" and not set(held).isdisjoint(driven)]
    if twice:
        raise UsageError(f"{option('ctrl')} and {clean(source)} both drive {listing(twice)}")
    for name in mapped.unused:
        if name.startswith("ctrl/") and name not in others:
            raise UnknownNameError("actuator", name.removeprefix("ctrl/"), actuators, where=f"the columns of {source}")
    held = {index for indices in constants.values() for index in indices}
    missing = [name for index, name in enumerate(names) if index not in driven and index not in held]
    if not driven or missing:
        wanted = listing(missing or names) or "nothing: it has no actuators"
        raise UsageError(
            f"{clean(source)} lacks columns for actuators of the model: {wanted}\n"
            f"it has {listing(available)}; a column may also be named after the actuator or its joint, with [deg] for "
            f"degrees, and {option('ctrl')} sets the others"
        )

    def values(expression: RowExpression) -> np.ndarray:
        return expression.values(columns) * _si_factor(expression, table.units)

    controls = {names[index]: values(mapped.sources[names[index]]) for index in driven}
    return ControlTable(TimedRows(values(mapped.time), controls, source, linear), driven)


def _other_controls(model: mujoco.MjModel, columns: Sequence[str]) -> dict[str, str]:
    """Returns the entries of a map for columns that are named after an actuator, or after a joint that only one drives.

    A unit in brackets behind the name converts degrees to radians, also of columns such as `ctrl/hip [deg]`.
    """
    joints = _joints_of_controls(model)
    driven = [joint for joint in joints.values() if joint]
    found = {column.removeprefix("ctrl/") for column in columns if column.startswith("ctrl/")}
    entries: dict[str, str] = {}
    for control, joint in joints.items():
        for name in (control, *([joint] if driven.count(joint) == 1 and joint not in joints else [])):
            column = next((each for each in columns if _without_unit(each) == name), None)
            if column and control not in found:
                found.add(control)
                degrees = "*pi/180" if re.search(DEGREES, column) else ""
                entries[column] = f"ctrl/{control}={spelled(column)}{degrees}"
    return entries


def _without_unit(column: str) -> str:
    """Returns the name of a control or joint for a column such as `hip [deg]`; an empty text for `ctrl/hip`."""
    name = re.sub(ANGLE, "", column)
    return name.removeprefix("ctrl/") if name != column else "" if name.startswith("ctrl/") else name


def _joints_of_controls(model: mujoco.MjModel) -> dict[str, str]:
    """Returns the controls, each with the joint that its actuator drives, or an empty text."""
    names = control_names(model)
    joints = dict.fromkeys(names, "")
    for i in range(model.nactuator):
        if model.actuator_ctrlnum[i] == 1 and model.actuator_trntype[i] in JOINT_TRANSMISSIONS:
            joint = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, int(model.actuator_trnid[i, 0])) or ""
            joints[names[int(model.actuator_ctrladr[i])]] = joint
    return joints
