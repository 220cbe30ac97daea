"""Compilation of a model: applies overrides, checks the result, and reports MuJoCo's refusals as errors."""

import math
import re
import zipfile
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TypeVar

import mujoco
import numpy as np

from mjrun.confinement.confinement import confinement
from mjrun.errors import ARENA, MORE_MEMORY, BadValueError, BrokenModelError, clean, concerning, listing, option, quoted
from mjrun.model.mujoco_globals import without_log
from mjrun.model.names import KIND_OF_COUNT, KINDS
from mjrun.model.override import Override, apply, elements_at
from mjrun.shared_status import doing
from mjrun.timeline import rational

# Prefixes and endings of fields that do not affect the motion, or that are checked where they are used.
LEFT_OUT = ("key_", "numeric_", "tuple_", "mesh_normal", "mesh_polynormal")
LEFT_OUT_ENDINGS = ("_user", "_texcoord")
# Endings of bounds and tolerances, which may be infinite.
BOUNDS = ("range", "margin", "gap", "cutoff", "tolerance", "yield", "limited")
# Fields computed from others: a fault in them is a fault in one of the others.
DERIVED = ("0", "_aabb", "_rbound", "_subtreemass", "_L")

T = TypeVar("T")


def load_respecting_confinement(load: Callable[[], T]) -> T:
    """Calls `load`: in a confined process, in a thread that can open only the files of models."""
    if confinement() is None:
        return load()
    from mjrun.confinement.self_confinement import confined_load

    return confined_load(load)


def non_finite_number(model: mujoco.MjModel) -> str | None:
    """Returns a sentence about the first number of a model that is not finite; None if all are finite.

    An example is `dof_damping of joint 'hip' must be finite, not nan`. MuJoCo compiles NaN, and the simulation
    diverges. Bounds may be infinite. Keyframes are not checked: they do no harm unless a simulation starts from them.
    """
    for name in _numbers(mujoco.MjOption):
        if (bad := invalid_number(np.asarray(getattr(model.opt, name)), name)) is not None:
            return f"opt.{name} must be finite, not {bad[1]}"
    for name in checked_arrays():
        if (bad := invalid_number(getattr(model, name), name)) is not None:
            return f"{name}{_owner(model, name, bad[0])} must be finite, not {bad[1]}"
    return None


def checked_arrays() -> list[str]:
    """Returns the names of the arrays of a model whose numbers affect the motion."""
    return _numbers(mujoco.MjModel)


@cache
def _numbers(of: type) -> list[str]:
    """Returns the names of the fields of a model, or of its options, whose numbers affect the motion."""
    example = mujoco.MjSpec().compile()
    owner = example.opt if of is mujoco.MjOption else example
    fields = {name: getattr(owner, name) for name in dir(owner) if not name.startswith("_")}
    names = [
        name
        for name, value in fields.items()
        if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")
        if not name.startswith(LEFT_OUT) and not name.endswith(LEFT_OUT_ENDINGS)
    ]
    return sorted(names, key=lambda name: name.endswith(DERIVED) and name != "qpos0")


def invalid_number(values: np.ndarray, name: str) -> tuple[int, float] | None:
    """Returns the row and the value of the first invalid number in an array; None if all are valid."""
    if np.isfinite(values).all():
        return None
    wrong = np.isnan(values) if name.endswith(BOUNDS) else ~np.isfinite(values)
    if not wrong.any():
        return None
    index = int(wrong.argmax())  # among all numbers, row by row
    row = index // max(1, int(np.prod(values.shape[1:])))
    return row, float(values.flat[index])


def _owner(model: mujoco.MjModel, field: str, row: int) -> str:
    """Returns the owner of a number, ` of joint 'hip'`; empty if it is not one object's."""
    prefix = field.partition("_")[0]
    if prefix == "dof":
        prefix, row = "jnt", int(model.dof_jntid[row])
    kind = KIND_OF_COUNT.get(f"n{prefix}")
    if kind is None:
        return ""
    name = mujoco.mj_id2name(model, KINDS[kind], row)
    return f" of {kind} {quoted(name) if name else row}"


DELAYED = ("actuator", "sensor")


def is_delay(override: Override) -> bool:
    """Returns whether an override changes delays."""
    kind, _, rest = override.target.partition("/")
    return kind in DELAYED and rest.endswith(".delay")


def lengthen_buffers(spec: mujoco.MjSpec, overrides: Iterable[Override]) -> None:
    """Extends the sample buffers of elements whose delay is overridden, if they are shorter than the delay needs.

    MuJoCo reads delayed values from a buffer of samples; a short buffer silently shortens the delay. Interpolation
    reads one more sample. Longer buffers change no value.

    Args:
      overrides: the overrides that were applied to `spec`.
    """
    timestep = spec.option.timestep
    if not timestep > 0:  # the compiler reports it
        return
    for override in overrides:
        if not is_delay(override):
            continue
        for element in elements_at(spec, override)[0]:
            samples = math.ceil(rational(element.delay) / rational(timestep)) + (element.interp > 0)
            element.nsample = max(element.nsample, samples)


# All exceptions that MuJoCo's loaders are known to raise for a bad file. "Caught an unknown exception!" is
# a RuntimeError and means that memory ran out.
FAULTS = (ValueError, RuntimeError, MemoryError, TypeError, mujoco.FatalError, zipfile.BadZipFile, OSError)
LONGEST = 1e12  # [s] the longest timestep: the times of later steps must be finite numbers, too
NOT_UTF8 = "it contains a name that is not UTF-8; save the file as UTF-8"
# "Element 'geom', line 12", "Element name 'x', id 3, line 12", "Line number=12"; names may hold anything.
_LINE = re.compile(r"(?:', |id -?\d+, )line (\d+)$|Line number=(\d+)", re.MULTILINE)


@contextmanager
def model_errors(path: Path, advice: str = "") -> Generator[None]:
    """Raises what MuJoCo refuses within the `with` block, where a model is parsed, as BrokenModelError.

    Args:
      path: the name of the model in errors.
      advice: a note for MuJoCo's refusal.
    """
    try:
        with without_log(), doing("reading", path):
            yield
    except FAULTS as error:
        raise broken_model(path, error, advice=advice) from error


def compile_spec(
    spec: mujoco.MjSpec, overrides: Sequence[Override], path: Path, advice: str = ""
) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Applies overrides to a specification, in place, and compiles it; returns both.

    Args:
      overrides: overrides, applied in order.
      path: the name of the model in errors.
      advice: a note for MuJoCo's refusal of a model without overrides.

    Raises:
      BrokenModelError: MuJoCo refuses the model.
      UsageError: an override refers to nothing, or its value does not fit.
    """
    refuse_plugins(spec, path)
    with without_log():
        try:
            for override in overrides:
                with concerning(*override.option_path):
                    apply(spec, override)
            lengthen_buffers(spec, overrides)
        except UnicodeDecodeError:  # a name that an override was compared with
            raise BrokenModelError(path, NOT_UTF8) from None
        try:
            with doing("compiling", path):
                model = spec.compile()
        except FAULTS as error:
            spelled_overrides = ", ".join(f"{option(o.option)} {clean(o.option_value)}" for o in overrides)
            raise broken_model(path, error, f"with {spelled_overrides}" if overrides else "", advice) from error

    if any(override.target == "opt.timestep" for override in overrides) and not _is_timestep(model.opt.timestep):
        raise BadValueError(option("timestep"), f"{model.opt.timestep:g}", "a positive number of seconds")
    check_model(model, path, f"{option('timestep')} overrides it")
    return spec, model


def refuse_plugins(spec: mujoco.MjSpec, path: Path) -> None:
    """Raises BrokenModelError if this process is confined and the model uses plugins, which are native code."""
    if confinement() and spec.plugins:
        names = listing(sorted({plugin.plugin_name for plugin in spec.plugins}))
        hint = f"plugins are code, which {option('untrusted')} does not run"
        raise BrokenModelError(path, f"it uses plugins: {names}", hint=hint)


def check_model(model: mujoco.MjModel, path: Path, timestep_advice: str = "") -> None:
    """Raises BrokenModelError if a name in `model` is not UTF-8, or if its timestep or another number is invalid."""
    try:
        model.names.decode("utf-8")
    except UnicodeDecodeError:
        raise BrokenModelError(path, NOT_UTF8) from None
    if not _is_timestep(step := model.opt.timestep):
        must = "be positive and finite" if not step > 0 or math.isinf(step) else f"be at most {LONGEST:g} s"
        raise BrokenModelError(path, f"the timestep must {must}, not {step:g}", hint=timestep_advice)
    if fault := non_finite_number(model):
        raise BrokenModelError(path, fault)


def broken_model(path: Path, error: BaseException, hint: str = "", advice: str = "") -> BrokenModelError:
    """Returns MuJoCo's refusal `error` of the model `path` as an error, with its line if MuJoCo reports one.

    Args:
      hint: the last line of the message.
      advice: a note that is added if there is no hint.
    """
    message = str(error).strip()
    if "unknown exception" in message or isinstance(error, MemoryError):
        message = "MuJoCo ran out of memory"
    lines = _LINE.findall(message)
    line = int("".join(lines[-1])) if lines else None
    message = re.sub(r"^(XML Error: )?(Error: )*", "", message)
    message = re.sub(r"\s*\n?\s*Error=(XML_\w+).*", r" \1", message)
    message = re.sub(r"Element name '', id -?\d+(, )?", "", message)
    message = re.sub(r"(, |^)line \d+$", "", message, flags=re.MULTILINE)

    broken = BrokenModelError(path, message, line, MORE_MEMORY if ARENA in message else hint)
    if advice and not hint:  # a note is not part of MuJoCo's message
        broken.add_note(advice)
    return broken


def _is_timestep(value: float) -> bool:
    return 0 < value <= LONGEST
