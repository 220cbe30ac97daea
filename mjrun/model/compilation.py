"""Compilation of a model: overrides applied, the result checked, and MuJoCo's refusals put into errors."""

import math
import re
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco

from mjrun.activity import doing
from mjrun.confinement.confinement import confinement
from mjrun.errors import ARENA, MORE_MEMORY, BadValueError, BrokenModelError, clean, concerning, listing, option
from mjrun.model import finiteness
from mjrun.model.delays import lengthen_buffers
from mjrun.model.mujoco_globals import without_log
from mjrun.model.override import Override, apply

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
    if fault := finiteness.fault(model):
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
