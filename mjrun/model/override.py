"""Overrides, the option `set`: changes to anything in an MjSpec by MuJoCo's own names, before compilation.

Paths are `opt.FIELD`, `opt.flag.NAME`, `vis.SECTION.FIELD`, `stat.FIELD`, `compiler.FIELD`, `size.memory`, and
`KIND/NAME.FIELD` for an element, where NAME may contain `*`, `?` and `[…]`, or be an index.
`FIELD[2]` is one number of several. `scale:PATH` and `add:PATH` are relative to the value in the source. Lengths,
masses and times may have units, as in `geom/ball.size=25mm`; angles are in the unit of the compiler of the model.
"""

import math
import re
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UnknownNameError, UsageError, clean, option
from mjrun.model.additions import add_ground, add_servos, add_to_stage
from mjrun.model.names import PLURALS, enum_members, enum_value, is_enum, is_index
from mjrun.options.model import ModelOptions, ServoOptions
from mjrun.options.number_kinds import UNITS as NUMBER_UNITS
from mjrun.options.setting_kinds import UNITS as SETTING_UNITS
from mjrun.options.setting_kinds import LengthWithUnit
from mjrun.timeline import rational


class _Sizes:
    """The sizes of a model that are not counts, by their names in MJCF's `<size>`."""

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self._spec = spec

    @property
    def memory(self) -> int:
        """The memory for the dynamics [bytes]; −1 lets MuJoCo choose."""
        return self._spec.memory

    @memory.setter
    def memory(self, value: int) -> None:
        self._spec.memory = value


ROOTS: dict[str, Callable[[mujoco.MjSpec], Any]] = {
    "opt": lambda spec: spec.option,
    "vis": lambda spec: spec.visual,
    "stat": lambda spec: spec.stat,
    "compiler": lambda spec: spec.compiler,
    "size": _Sizes,
}
# Options that add or replace elements, with an empty path.
ADDITIONS: dict[str, Callable[[mujoco.MjSpec, str], None]] = {
    "ground": add_ground,
    "stage": add_to_stage,
    "position_control": add_servos,
}
ASSETS = "assets"  # option with a folder, which only demonstrations have
# The list of MjSpec with the elements of each kind.
ELEMENTS = {
    kind: PLURALS.get(kind, f"{kind}s")
    for kind in (
        *("body", "frame", "joint", "geom", "site", "camera", "light", "material", "texture", "mesh", "hfield", "flex"),
        *("skin", "pair", "exclude", "equality", "tendon", "actuator", "sensor", "numeric", "text", "tuple", "key"),
    )
}
SUGGESTED = 3  # paths, at most
# Fields that MjSpec stores as plain integers and MJCF writes by name.
NAMED_INTEGERS = {
    "integrator": mujoco.mjtIntegrator,
    "cone": mujoco.mjtCone,
    "jacobian": mujoco.mjtJacobian,
    "solver": mujoco.mjtSolver,
}
# Arrays of which only the first values may be given, as in MJCF.
PARTIAL = {
    *("size", "friction", "damping", "stiffness", "gear", "gainprm", "biasprm", "dynprm", "solref", "solimp"),
    *("solref_limit", "solimp_limit", "solref_friction", "solimp_friction", "o_solref", "o_solimp"),
}
# Fields with the path of a file of an asset, or with the folder of such files.
FILE_ATTRIBUTES = {"file", "meshdir", "texturedir"}
# Internal fields and other elements, which MjSpec exposes as fields, and the two bit sets behind `opt.flag`.
HIDDEN = {"id", "signature", "info", "name", "parent", "frame", "compiler", "classname", "plugin"}
HIDDEN |= {"disableflags", "enableflags"}
# An orientation in another form takes precedence over the quaternion.
ORIENTATIONS = {
    "axisangle": mujoco.mjtOrientation.mjORIENTATION_AXISANGLE,
    "xyaxes": mujoco.mjtOrientation.mjORIENTATION_XYAXES,
    "zaxis": mujoco.mjtOrientation.mjORIENTATION_ZAXIS,
    "euler": mujoco.mjtOrientation.mjORIENTATION_EULER,
}
ALTERNATIVES = {"quat": "alt", "iquat": "ialt"}
UNITS = {unit: 1024**power for power, unit in enumerate(("", "K", "M", "G", "T"))}  # of memory, as in MJCF
# Units of values, with what they measure and their size in SI units, and the fields that they fit.
QUANTITIES = {
    **{unit: ("length", factor) for unit, (kind, factor) in SETTING_UNITS.items() if kind is LengthWithUnit},
    **{unit: ("time", float(factor)) for unit, factor in NUMBER_UNITS["SECONDS"].items()},
    "kg": ("mass", 1.0),
    "g": ("mass", 0.001),
}
MEASURED = {
    "length": {"pos", "ipos", "size", "fromto", "margin", "gap", "width", "radius", "center", "extent", "cranklength"},
    "mass": {"mass"},
    "time": {"timestep", "delay", "interval"},
}
EQUALS_IN_NAME = "where a name contains =, write ?"
RELATIVE: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {"scale": np.multiply, "add": np.add}
BOOLEANS = {"true": True, "enable": True, "1": True, "false": False, "disable": False, "0": False}
# Switches that MjSpec stores as integers.
SWITCHES = {"orthographic", "ellipsoidinertia", "bvactive", "active", "useexisting", "uselimit"}
INERTIAL = {"mass", "inertia", "fullinertia", "ipos", "iquat"}


@dataclass(frozen=True)
class Override:
    """An override: the `path` in the source, the `value` as text, and the `option` that it comes from.

    The path is empty if the option adds elements.
    """

    path: str
    value: str
    option: str = "set"

    def __str__(self) -> str:
        return f"{self.path or self.option}={self.value}"

    @property
    def operation(self) -> str:
        """`scale` or `add`; empty if the value replaces the one in the source."""
        return _path_parts(self.path)[0]

    @property
    def index(self) -> int | None:
        """The index of the number within the field; None for the whole field."""
        return _path_parts(self.path)[2]

    @property
    def target(self) -> str:
        """The path of the field."""
        return _path_parts(self.path)[1]

    @property
    def file_attribute(self) -> str:
        """The attribute of MJCF that it sets if its value is the path of a file or a folder; else empty."""
        attribute = self.target.rpartition(".")[2]
        return attribute if attribute in FILE_ATTRIBUTES else ""

    @property
    def option_value(self) -> str:
        """The value of the option."""
        return str(self) if self.option == "set" else self.value

    @property
    def name(self) -> str:
        """The name of the override in messages."""
        return clean(self.path) if self.option == "set" else option(self.option)

    @property
    def option_path(self) -> OptionPath:
        """The option that errors are about, and the place in its value."""
        return ("set", self.path) if self.option == "set" else (self.option,)


@lru_cache(1024)
def _path_parts(path: str) -> tuple[str, str, int | None]:
    """Returns the operation, the target and the index in the path of an override."""
    operation, colon, rest = path.partition(":")
    if not colon or operation not in RELATIVE:
        operation, rest = "", path
    match = re.fullmatch(r"(.*)\[(\d+)\]", rest, re.DOTALL)
    return (operation, match[1], int(match[2])) if match else (operation, rest, None)


def overrides_of(options: ModelOptions) -> tuple[Override, ...]:
    """Returns the overrides that `options` define, in the order in which they are applied."""
    overrides: list[Override] = []
    if isinstance(options, ServoOptions):
        overrides += [Override("", folder, ASSETS) for folder in options.assets]
        if options.position_control is not None:  # first, so that other overrides do not change the gains
            overrides.append(Override("", options.position_control, "position_control"))
    overrides += [Override(path, text) for path, text in options.set]
    if options.integrator is not None:
        overrides.append(Override("opt.integrator", options.integrator, "integrator"))
    if options.ground is not None:
        overrides.append(Override("", repr(options.ground), "ground"))
    if options.timestep is not None:
        overrides.append(Override("opt.timestep", repr(float(options.timestep)), "timestep"))
    return tuple(overrides)


def apply(spec: mujoco.MjSpec, override: Override) -> None:
    """Applies an override to `spec`.

    Raises:
      UnknownNameError: the path refers to nothing; the message lists similar and valid names.
      BadValueError: the value does not fit the field.
    """
    if override.option in ADDITIONS:
        ADDITIONS[override.option](spec, override.value)
        return
    if override.option == ASSETS:
        raise UsageError(f"{option(ASSETS)} applies only to the models of demonstrations, as in demo.hdf5:demo_3")
    kind, slash, _ = override.target.partition("/")
    if slash and kind in ELEMENTS:
        elements, fields = elements_at(spec, override)
        for element in elements:
            _check_effect(element, kind, fields, override)
            _assign(element, fields, override)
        return
    root, *fields = override.target.split(".")
    if root not in ROOTS:
        if slash:
            raise UnknownNameError("setting", kind, [*ROOTS, *ELEMENTS])
        raise _unknown_setting(root, fields)
    if [root, *fields[:1]] == ["opt", "flag"]:
        _set_flag(spec.option, fields[1:], override)
    else:
        _assign(ROOTS[root](spec), fields, override)


def elements_at(spec: mujoco.MjSpec, override: Override) -> tuple[list[Any], list[str]]:
    """Returns the elements that a path `KIND/NAME.FIELD` matches, and the field; a name may itself contain dots.

    Raises:
      UnknownNameError: no element matches.
    """
    indices, fields = indices_at(spec, override)
    elements = getattr(spec, ELEMENTS[override.target.partition("/")[0]])
    return [elements[index] for index in indices], fields


def indices_at(spec: mujoco.MjSpec, override: Override) -> tuple[list[int], list[str]]:
    """Returns the indices of these elements among all of their kind, and the field."""
    kind, _, rest = override.target.partition("/")
    named = {element.name or f"{kind}:{i}": i for i, element in enumerate(getattr(spec, ELEMENTS[kind]))}
    parts = rest.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        pattern, fields = ".".join(parts[:cut]), parts[cut:]
        if pattern in named:
            return [named[pattern]], fields
        matches = [index for name, index in named.items() if fnmatchcase(name, pattern)]
        index = pattern.removeprefix(f"{kind}:")
        if not matches and is_index(index, len(named)):
            matches = [int(index)]
        if matches:
            return matches, fields
    if len(parts) == 1:
        error = UsageError(f"{kind}/{clean(rest)} lacks a field; write {kind}/{clean(rest)}.FIELD=VALUE")
        if "=" in override.value:
            error.add_note(EQUALS_IN_NAME)
        raise error
    raise UnknownNameError(kind, parts[0], list(named), plural=ELEMENTS[kind])


@cache
def holds_whole_number(path: str) -> bool:
    """Returns whether a path names a field that MuJoCo stores as a whole number, as in `opt.iterations`."""
    operation, target, _ = _path_parts(path)
    kind, slash, _ = target.partition("/")
    *above, field = target.split(".")
    spec = mujoco.MjSpec()
    owner = getattr(spec.default, kind, None) if slash else ROOTS[above[0]](spec) if above[:1] == ["opt"] else None
    value = getattr(owner, field, None)
    return not operation and isinstance(value, int) and not isinstance(value, bool) and not is_enum(value)


def source_values(spec: mujoco.MjSpec, override: Override) -> np.ndarray:
    """Returns the number that `override` changes for each object that its path matches, as in the source: `(n,)`.

    Raises:
      UnknownNameError: the path refers to nothing.
      UsageError: the field is not a number, or several numbers.
    """
    owners, fields = _owners(spec, override)
    return np.array([_number_of(owner, fields, override) for owner in owners])


def changes_nothing(spec: mujoco.MjSpec, override: Override) -> bool:
    """Returns whether `override` leaves the source unchanged; False where its field does not show that.

    Raises:
      UnknownNameError: the path refers to nothing.
      BadValueError: the value does not fit the field.
    """
    (owners, fields), changed = _owners(spec, override), spec.copy()
    if fields[-1] in (*ORIENTATIONS, *ALTERNATIVES) or fields[0] == "flag":
        return False
    apply(changed, override)
    others, _ = _owners(changed, override)
    values, new_values = ([_content(_value_of(owner, fields, override)) for owner in each] for each in (owners, others))
    return values == new_values


def _content(value: Any) -> object:
    """Returns a copy of the value of a field, in which zeros with different signs differ."""
    return np.array(value).tobytes() if isinstance(value, float | np.ndarray) or _is_vector(value) else value


def _owners(spec: mujoco.MjSpec, override: Override) -> tuple[list[Any], list[str]]:
    """Returns the objects in the source that `override` changes, and the names of its field within each."""
    kind, slash, _ = override.target.partition("/")
    if slash and kind in ELEMENTS:
        return elements_at(spec, override)
    root, *fields = override.target.split(".")
    if root not in ROOTS:
        raise _unknown_setting(root, fields)
    return [ROOTS[root](spec)], fields


def _unknown_setting(root: str, fields: list[str]) -> UnknownNameError:
    meant = [] if fields else paths_of_field(root)
    return UnknownNameError("setting", root, [*ROOTS, *(f"{kind}/NAME" for kind in ELEMENTS)], meant=meant)


def _value_of(owner: Any, fields: list[str], override: Override) -> Any:
    for field in fields:
        if field not in (valid := fields_of(owner)):
            raise UnknownNameError("setting", field, valid, where=override.target.rpartition(".")[0])
        owner = getattr(owner, field)
    return owner


def _number_of(owner: Any, fields: list[str], override: Override) -> float:
    owner = _value_of(owner, fields, override)
    if isinstance(owner, bool | str) or is_enum(owner) or not _is_leaf(owner):
        raise UsageError(f"{clean(override.path)} is not a number")
    values = np.ravel(np.array(list(owner) if _is_vector(owner) else owner, float))
    if override.index is None and values.size > 1 and fields[-1] not in PARTIAL:
        path = clean(override.path)
        raise UsageError(f"{path} has {values.size} numbers; write {path}[0] for the first")
    return float(values[_chosen(fields[-1], values.size, override)][0])


def _check_effect(element: Any, kind: str, fields: list[str], override: Override) -> None:
    # The compiler infers the inertia from the geoms and silently ignores that of the body.
    if kind == "body" and fields[0] in INERTIAL and not element.explicitinertial:
        remedy = f"set the mass or density of a geom instead, as in geom/NAME.mass={clean(override.value)}"
        if operation := override.operation:  # few geoms have a mass in the source
            remedy = f"{operation} the density of its geoms instead, as in {operation}:geom/NAME.density=VALUE"
        raise UsageError(
            f"{clean(override.path)} has no effect: the inertia of this body comes from its geoms\n{remedy}"
        )
    # Likewise, the end points of a geom or site determine its position.
    if fields[0] in {"pos", "quat", "alt"} and hasattr(element, "fromto") and math.isfinite(element.fromto[0]):
        raise UsageError(
            f"{clean(override.path)} has no effect: the end points determine the placement\n"
            f"set {kind}/{clean(element.name)}.fromto=X,Y,Z,X,Y,Z instead"
        )


def _set_flag(option: Any, fields: list[str], override: Override) -> None:
    disable, enable = enum_members(mujoco.mjtDisableBit), enum_members(mujoco.mjtEnableBit)
    name = ".".join(fields)
    if override.operation or override.index is not None:
        raise UsageError(f"{clean(override.path)}: a flag is not a number")
    if name not in disable and name not in enable:
        raise UnknownNameError("flag", name, [*disable, *enable], where="opt.flag")
    if name == "autoreset":
        raise UsageError(
            "opt.flag.autoreset cannot be set: a reset during the run would mix two simulations in one output\n"
            "mjrun stops an unstable simulation instead, and reports the step and the joint"
        )
    on = _parse_bool(override)
    bits, bit, set_it = ("enableflags", enable[name], on) if name in enable else ("disableflags", disable[name], not on)
    value = getattr(option, bits)
    setattr(option, bits, value | bit if set_it else value & ~bit)


def _assign(owner: Any, fields: list[str], override: Override) -> None:
    if not fields:
        raise UnknownNameError("setting", override.target, [f"{override.target}.{field}" for field in fields_of(owner)])
    field, *deeper = fields
    valid = fields_of(owner)
    if field not in valid:
        above = override.target.removesuffix("".join(f".{part}" for part in fields))
        raise UnknownNameError("setting", field, [*valid, *(["flag"] if above == "opt" else [])], where=above)
    current = getattr(owner, field)
    if not _is_leaf(current):
        _assign(current, deeper, override)
        return
    if deeper:
        above = override.target.removesuffix("".join(f".{part}" for part in deeper))
        raise UsageError(f"{clean(override.path)}: {clean(above)} is a value and has no settings")
    try:
        setattr(owner, field, _new_value(field, current, override))
    except TypeError:
        raise BadValueError(override.name, override.value, f"a valid value of {field}") from None
    if field in ORIENTATIONS and hasattr(owner, "euler"):
        owner.type = ORIENTATIONS[field]
    if hasattr(owner, ALTERNATIVES.get(field, "")):
        getattr(owner, ALTERNATIVES[field]).type = mujoco.mjtOrientation.mjORIENTATION_QUAT


_FIELDS: dict[type, list[str]] = {}  # by type of MjSpec


def paths_of_field(name: str) -> list[str]:
    """Returns paths of fields called `name`, of options and of all elements of a kind: `geom/*.friction`."""
    field, bracket, index = name.partition("[")
    classes = {each.removeprefix("Mjs").lower(): value for each, value in vars(mujoco).items() if each[:3] == "Mjs"}
    owners = {"opt": mujoco.MjOption, "stat": mujoco.MjStatistic}
    owners |= {f"{kind}/*": classes.get(kind) for kind in ELEMENTS}
    known = [owner for owner, cls in owners.items() if field in dir(cls) and field not in HIDDEN and field[0] != "_"]
    return [f"{owner}.{field}{bracket}{index}" for owner in known][:SUGGESTED]


def fields_of(owner: Any) -> list[str]:
    """Returns the fields of an MjSpec object that can be set, or that contain fields that can."""
    if type(owner) not in _FIELDS:
        _FIELDS[type(owner)] = [name for name in dir(type(owner)) if _is_field(owner, name)]
    return _FIELDS[type(owner)]


def _is_field(owner: Any, name: str) -> bool:
    if name.startswith("_") or name.endswith("_") or name in HIDDEN:
        return False
    value = getattr(owner, name)
    holds_fields = type(value).__module__.startswith("mujoco") and not callable(value)
    return _is_leaf(value) or (holds_fields and bool(fields_of(value)))


def _is_leaf(value: object) -> bool:
    return isinstance(value, bool | int | float | str | np.ndarray) or is_enum(value) or _is_vector(value)


def _is_vector(value: object) -> bool:
    """Returns whether `value` is one of MjSpec's growable arrays of numbers."""
    return type(value).__name__ in ("MjDoubleVec", "MjFloatVec", "MjIntVec")


def _new_value(field: str, current: Any, override: Override) -> Any:
    """Returns the new value of a field whose value in the source is `current`."""
    if not override.operation and override.index is None:
        return _parse_value(field, current, override)
    is_array = isinstance(current, np.ndarray) or _is_vector(current)
    if override.index is not None and not is_array:
        raise UsageError(f"{clean(override.path)}: {field} is a single value")
    if isinstance(current, bool | str) or is_enum(current) or field in SWITCHES or field in NAMED_INTEGERS:
        raise UsageError(f"{clean(override.path)}: {field} is not a number")

    values = np.array(list(current) if _is_vector(current) else current, float)
    chosen = _chosen(field, values.size, override)
    numbers, own = np.array(_parse_numbers(override)), values.ravel()[chosen]
    if override.operation and np.isnan(own).any():
        origin = " from density" if field == "mass" else ""
        reason = f"{field} has no value in the source to {override.operation}: the compiler computes it{origin}"
        raise UsageError(f"{clean(override.path)}: {reason}")
    changed = relative_values(own, numbers, override) if override.operation else numbers
    if changed is None or (not override.operation and changed.size != 1):
        most = "at most " if field in PARTIAL else ""
        is_several = override.operation == "add" and own.size > 1
        expected = f"{most}{own.size} numbers separated by commas" if is_several else "one number"
        raise BadValueError(override.name, override.value, expected)
    if not np.isfinite(changed[np.isfinite(own)]).all():
        raise BadValueError(override.name, override.value, "a value that gives finite numbers")
    values.reshape(-1)[chosen] = changed
    return _like(current, values, override)


def relative_values(values: np.ndarray, numbers: np.ndarray, override: Override) -> np.ndarray | None:
    """Returns values `(…, size)` after an override that is relative to them; None if its numbers `(n,)` do not fit.

    A single factor scales all values. Added numbers are those of the first values where a field may be given by them.
    """
    size, is_sum = values.shape[-1], override.operation == "add"
    if is_sum and override.index is None and override.target.rpartition(".")[2] in PARTIAL and 0 < len(numbers) < size:
        numbers = np.concatenate([numbers, np.zeros(size - len(numbers))])
    fits = len(numbers) == size or (len(numbers) == 1 and not is_sum)
    with np.errstate(over="ignore"):
        return RELATIVE[override.operation](values, numbers) if fits else None


def _chosen(field: str, size: int, override: Override) -> slice:
    """Returns the slice of the numbers to change in a field of `size` numbers."""
    index = override.index
    if index is None:
        return slice(None)
    if index >= size:
        raise BadValueError(override.name, f"{field}[{index}]", f"one of {field}[0] to {field}[{size - 1}]")
    return slice(index, index + 1)


def _like(current: Any, values: np.ndarray, override: Override) -> Any:
    """Converts `values` to the type of `current`."""
    if isinstance(current, np.ndarray):
        if current.dtype.kind == "i" and not _are_whole(values, np.iinfo(current.dtype).max):
            raise BadValueError(override.name, override.value, "values that give whole numbers")
        return values.reshape(current.shape).astype(current.dtype)
    if _is_vector(current):
        return values.tolist()
    if isinstance(current, int) and not _are_whole(values, math.inf):
        raise BadValueError(override.name, override.value, "a value that gives a whole number")
    return type(current)(values)


def _are_whole(values: np.ndarray, limit: float) -> bool:
    """Returns whether all values are whole numbers up to a limit."""
    return bool((np.isfinite(values) & (values == np.round(values)) & (np.abs(values) <= limit)).all())


def _parse_value(field: str, current: Any, override: Override) -> Any:
    """Parses the text of `override` as a value of the type of `current`."""
    if field in NAMED_INTEGERS:
        return enum_value(NAMED_INTEGERS[field], field, override.value)
    if is_enum(current):
        return type(current)(enum_value(type(current), field, override.value))
    if isinstance(current, bool):
        return _parse_bool(override)
    if field in SWITCHES and isinstance(current, int):
        return int(_parse_bool(override))
    if field == "memory":
        return _parse_memory(override)
    if isinstance(current, int):
        return int(_parse_number(override.value, override, "a whole number", int))
    if isinstance(current, float):
        return _parse_number(override.value, override, "a number", float)
    if isinstance(current, np.ndarray):
        return _parse_array(field, current, override)
    if _is_vector(current):
        return _parse_numbers(override)
    return override.value


def _parse_bool(override: Override) -> bool:
    if override.value.lower() not in BOOLEANS:
        raise BadValueError(override.name, override.value, "enable or disable (true or false)")
    return BOOLEANS[override.value.lower()]


def _parse_memory(override: Override) -> int:
    """Parses a number of bytes with MJCF's units: `100M`."""
    match = re.fullmatch(r"([0-9]{1,15})([KMGT]?)", override.value.strip().upper())
    if not match or not int(match[1]):
        raise BadValueError(override.name, override.value, "a memory size such as 500K, 100M or 1G")
    return int(match[1]) * UNITS[match[2]]


def _parse_number(text: str, override: Override, expected: str, kind: Callable[[str], float]) -> float:
    number, factor = _without_unit(text, override) if kind is float else (text, 1.0)
    try:
        value = kind(number)
        if factor != 1:
            value = float(rational(value) * rational(factor))  # rounded once: 9ms is 0.009
        is_finite = math.isfinite(value)
    except (ValueError, OverflowError):  # the latter of a number that is no float
        is_finite, value = False, math.nan
    if not is_finite:
        raise BadValueError(override.name, override.value, expected)
    return value


def _without_unit(text: str, override: Override) -> tuple[str, float]:
    """Splits a number from its unit, and returns the size of that in SI units: 1 without a unit.

    Raises:
      UsageError: the field does not measure what the unit does, or the value is a factor.
    """
    match = re.fullmatch(r"\s*([-+.\deE]*[.\d])\s*([a-z]+)\s*", text)
    if not match or match[2] not in QUANTITIES:
        return text, 1.0
    kind, factor = QUANTITIES[match[2]]
    field = override.target.rpartition(".")[2]
    if field not in MEASURED[kind] or override.operation == "scale":
        reason = "a factor has none" if override.operation == "scale" else f"{clean(field)} is no {kind}"
        raise UsageError(f"{override.name}: {clean(override.value)} has a unit, and {reason}: give a number alone")
    return match[1], factor


def _parse_numbers(override: Override) -> list[float]:
    return [
        _parse_number(part, override, "numbers separated by commas", float)
        for part in override.value.replace(",", " ").split()
    ]


def _parse_array(field: str, current: np.ndarray, override: Override) -> np.ndarray:
    values, size = _parse_numbers(override), current.size
    fits = 0 < len(values) <= size if field in PARTIAL else len(values) == size
    if not fits:
        most = "at most " if field in PARTIAL else ""
        raise BadValueError(override.name, override.value, f"{most}{size} numbers separated by commas")
    result = current.astype(float).ravel()
    result[: len(values)] = values
    return _like(current, result, override)
