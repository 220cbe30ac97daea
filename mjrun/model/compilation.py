"""Compilation of a model: overrides applied, the result checked, and MuJoCo's refusals put into errors."""

import math
import re
import zipfile
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from mjrun.confinement.confinement import confinement
from mjrun.errors import ARENA, MORE_MEMORY, BadValueError, BrokenModelError, clean, concerning, listing, option, quoted
from mjrun.model.mujoco_globals import without_log
from mjrun.model.names import KIND_OF_COUNT, KINDS
from mjrun.model.override import Override, apply, elements_at
from mjrun.shared_status import doing
from mjrun.timeline import rational

# Prefixes and endings of fields that no motion comes from, or that are looked at where they are used.
LEFT_OUT = ("key_", "numeric_", "tuple_", "mesh_normal", "mesh_polynormal")
LEFT_OUT_ENDINGS = ("_user", "_texcoord")
# Endings of bounds and tolerances, which may be infinite.
BOUNDS = ("range", "margin", "gap", "cutoff", "tolerance", "yield", "limited")
# Fields that follow from others: a fault of theirs is one of these others.
DERIVED = ("0", "_aabb", "_rbound", "_subtreemass", "_L")


def non_finite_number(model: mujoco.MjModel) -> str | None:
    """The first number of a model that is not finite, `its dof_damping is nan, of joint 'hip'`; None if there is none.

    MuJoCo compiles NaN, and the simulation explodes. Bounds may be infinite. Keyframes are not looked at: one that
    nobody starts from does no harm.
    """
    for name in _numbers(mujoco.MjOption):
        if (value := _bad(np.asarray(getattr(model.opt, name)), name)) is not None:
            return f"its opt.{name} is {value[1]}"
    for name in _numbers(mujoco.MjModel):
        if (value := _bad(getattr(model, name), name)) is not None:
            return f"its {name} is {value[1]}{_owner(model, name, value[0])}"
    return None


@cache
def _numbers(of: type) -> list[str]:
    """The fields of a model, or of its options, that hold numbers from which its motion comes."""
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


def _bad(values: np.ndarray, name: str) -> tuple[int, float] | None:
    """The row and the value of the first number that cannot be."""
    if np.isfinite(values).all():
        return None
    wrong = np.isnan(values) if name.endswith(BOUNDS) else ~np.isfinite(values)
    if not wrong.any():
        return None
    index = int(wrong.argmax())  # of all numbers, row by row
    row = index // max(1, int(np.prod(values.shape[1:])))
    return row, float(values.flat[index])


def _owner(model: mujoco.MjModel, field: str, row: int) -> str:
    """Whose number it is, `, of joint 'hip'`."""
    prefix = field.partition("_")[0]
    if prefix == "dof":
        prefix, row = "jnt", int(model.dof_jntid[row])
    kind = KIND_OF_COUNT.get(f"n{prefix}")
    if kind is None:
        return ""
    name = mujoco.mj_id2name(model, KINDS[kind], row)
    return f", of {kind} {quoted(name) if name else row}"


DELAYED = ("actuator", "sensor")


def lengthen_buffers(spec: mujoco.MjSpec, overrides: Iterable[Override]) -> None:
    """Makes the buffers of all elements whose delay is overridden as long as their delay needs, if they are shorter.

    MuJoCo reads delays from a buffer of samples: one that is too short makes the delay shorter, without a word.

    Args:
      overrides: that were applied to `spec`.
    """
    timestep = spec.option.timestep
    if not timestep > 0:  # which the compiler refuses
        return
    for override in overrides:
        kind, _, rest = override.target.partition("/")
        if kind not in DELAYED or not rest.endswith(".delay"):
            continue
        for element in elements_at(spec, override)[0]:
            element.nsample = max(element.nsample, math.ceil(rational(element.delay) / rational(timestep)))


# Everything that MuJoCo's loaders are known to raise for a bad file. "Caught an unknown exception!" is
# a RuntimeError and means that memory ran out.
FAULTS = (ValueError, RuntimeError, MemoryError, TypeError, mujoco.FatalError, zipfile.BadZipFile, OSError)
LONGEST = 1e12  # [s] a timestep; times of later steps must be finite numbers too
NOT_UTF8 = "a name in it is not UTF-8; save the file as UTF-8"
# "Element 'geom', line 12", "Element name 'x', id 3, line 12", "Line number=12"; names may hold anything.
_LINE = re.compile(r"(?:', |id -?\d+, )line (\d+)$|Line number=(\d+)", re.MULTILINE)


def compile_model(
    parse: Callable[[], mujoco.MjSpec], overrides: Sequence[Override], path: Path, advice: str = ""
) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Compiles what `parse` returns, with overrides; returns both.

    Args:
      overrides: applied in order.
      path: the model as errors call it.
      advice: added as a note to MuJoCo's refusal of a model without overrides.

    Raises:
      BrokenModelError: MuJoCo refuses the model.
      UsageError: an override names nothing, or its value does not fit.
    """
    with without_log():
        try:
            with doing("reading", path):
                spec = parse()
        except FAULTS as error:
            raise broken_model(path, error, advice=advice) from error
        refuse_plugins(spec, path)
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
    """Raises BrokenModelError if the model is run by plugins, which are libraries, in a confined process."""
    if confinement() and spec.plugins:
        names = listing(sorted({plugin.plugin_name for plugin in spec.plugins}))
        hint = f"they are code, and {option('untrusted')} runs none"
        raise BrokenModelError(path, f"it uses plugins: {names}", hint=hint)


def check_model(model: mujoco.MjModel, path: Path, timestep_advice: str = "") -> None:
    """Raises BrokenModelError if names in `model` are not UTF-8, or a number in it cannot be, as its timestep."""
    try:
        model.names.decode("utf-8")
    except UnicodeDecodeError:
        raise BrokenModelError(path, NOT_UTF8) from None
    if not _is_timestep(step := model.opt.timestep):
        must = "be positive and finite" if not step > 0 or math.isinf(step) else f"be at most {LONGEST:g} s"
        raise BrokenModelError(path, f"its timestep is {step:g}, and must {must}", hint=timestep_advice)
    if fault := non_finite_number(model):
        raise BrokenModelError(path, f"{fault}, and must be finite")


def broken_model(path: Path, error: BaseException, hint: str = "", advice: str = "") -> BrokenModelError:
    """MuJoCo's refusal `error` of the model `path` as an error with its line, if MuJoCo says which.

    Args:
      hint: a last line for the message.
      advice: a note for when there is no hint.
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
