"""Model files to compiled models, with overrides applied to the source before compilation."""

import math
import re
import shlex
import stat
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco

from mjrun.errors import (
    BadValueError,
    BrokenModelError,
    CompiledModelError,
    ModelNotFoundError,
    clean,
)
from mjrun.model.mujoco_globals import without_log
from mjrun.model.override import Setting, apply

SOURCES = (".xml", ".urdf", ".mjz", ".zip")
COMPILED = (".mjb",)
SUFFIXES = SOURCES + COMPILED

# Everything that MuJoCo's loaders are known to raise for a bad file. "Caught an unknown exception!" is
# a RuntimeError and means that memory ran out.
FAULTS = (ValueError, RuntimeError, MemoryError, TypeError, mujoco.FatalError, zipfile.BadZipFile, OSError)


def load(
    path: str | Path,
    *,
    timestep: float | None = None,
    integrator: str | None = None,
    overrides: Mapping[str, str] | Sequence[Setting] = (),
) -> mujoco.MjModel:
    """Compiles the model in `path`: .xml, .urdf, .mjz, .zip or .mjb.

    Args:
      timestep: [s], instead of the model's own.
      integrator: `euler`, `rk4`, `implicit`, `implicitfast` or `discrete`.
      overrides: paths to values, `{"opt.gravity": "0,0,10", "geom/floor.friction": ".1,.005,.0001"}`.

    Raises:
      ModelError: the file is missing, unreadable, or refused by MuJoCo.
      UsageError: an override names nothing, or its value does not fit.
    """
    path = Path(path)
    settings = [Setting(p, v) for p, v in overrides.items()] if isinstance(overrides, Mapping) else [*overrides]
    if integrator is not None:
        settings.append(Setting("opt.integrator", integrator, "--integrator"))
    if timestep is not None:
        settings.append(Setting("opt.timestep", repr(float(timestep)), "--timestep"))
    _check_file(path)
    with without_log():
        model = _compiled(path, settings) if path.suffix in COMPILED else _compile(path, settings)
    _check_names(model, path)
    _check_timestep(model, path, chosen=any(s.path == "opt.timestep" for s in settings))
    return model


def _check_file(path: Path) -> None:
    try:
        kind = path.stat()
    except FileNotFoundError:
        raise ModelNotFoundError(path, "no such model file", path.parent, _siblings(path.parent)) from None
    except (OSError, ValueError) as error:
        raise ModelNotFoundError(path, getattr(error, "strerror", None) or str(error)) from None
    if stat.S_ISDIR(kind.st_mode):
        raise ModelNotFoundError(path, "is a folder, not a model file", path, _siblings(path))
    if not stat.S_ISREG(kind.st_mode):
        raise ModelNotFoundError(path, "is not a regular file")
    if path.suffix not in SUFFIXES:
        lower = "; MuJoCo knows them in lower case only" if path.suffix.lower() in SUFFIXES else ""
        raise ModelNotFoundError(path, f"is not a model file; model files end in {', '.join(SUFFIXES)}{lower}")


def _siblings(folder: Path) -> list[str]:
    """The model files in `folder`."""
    try:
        return sorted(p.name for p in folder.iterdir() if p.suffix in SUFFIXES)
    except OSError:
        return []


def _compiled(path: Path, settings: Sequence[Setting]) -> mujoco.MjModel:
    if settings:
        raise CompiledModelError(path, [s.asked for s in settings])
    try:
        return mujoco.MjModel.from_binary_path(str(path))
    except FAULTS as error:
        raise _broken(path, error) from error


def _compile(path: Path, settings: Sequence[Setting]) -> mujoco.MjModel:
    try:
        spec = _parse(path)
    except FAULTS as error:
        raise _broken(path, error) from error
    try:
        for setting in settings:
            apply(spec, setting)
    except UnicodeDecodeError:  # a name that an override was compared with
        raise BrokenModelError(path, NOT_UTF8) from None
    try:
        return spec.compile()
    except FAULTS as error:
        raise _broken(path, error, settings) from error


def _parse(path: Path) -> mujoco.MjSpec:
    if path.suffix not in (".mjz", ".zip"):
        return mujoco.MjSpec.from_file(str(path))
    # MuJoCo looks for model.xml or one named as the archive; its own `to_zip` writes neither.
    with zipfile.ZipFile(path) as archive:
        sources = [name for name in archive.namelist() if name.endswith(".xml")]
    expected = {"model.xml", f"{path.stem}.xml", f"{path.stem}/{path.stem}.xml", f"{path.stem}/model.xml"}
    if len(sources) == 1 and not expected & set(sources):
        with path.open("rb") as archive:
            return mujoco.MjSpec.from_zip(archive)
    return mujoco.MjSpec.from_file(str(path))


# "Element 'geom', line 12", "Element name 'x', id 3, line 12", "Line number=12"; names may hold anything.
_LINE = re.compile(r"(?:', |id -?\d+, )line (\d+)$|Line number=(\d+)", re.MULTILINE)
NOT_UTF8 = "a name in it is not UTF-8; save the file as UTF-8"


def _broken(path: Path, error: BaseException, settings: Sequence[Setting] = ()) -> BrokenModelError:
    message = str(error).strip()
    if "unknown exception" in message or isinstance(error, MemoryError):
        message = "MuJoCo ran out of memory"
    found = _LINE.findall(message)
    line = int("".join(found[-1])) if found else None
    message = re.sub(r"^(XML Error: )?(Error: )*", "", message)
    message = re.sub(r"\s*\n?\s*Error=(XML_\w+).*", r" \1", message)
    message = re.sub(r"Element name '', id -?\d+(, )?", "", message)
    message = re.sub(r"(, |^)line \d+$", "", message, flags=re.MULTILINE)
    hint = f"with {', '.join(clean(s.asked) for s in settings)}" if settings else ""
    if path.suffix in COMPILED:
        hint = f"a .mjb file loads only in the MuJoCo that wrote it; this is {mujoco.mj_versionString()}"
    broken = BrokenModelError(path, message, line, hint)
    if not hint:  # a note, which is no part of what MuJoCo said
        broken.add_note(f"mjrun check {clean(shlex.quote(str(path)))} says where and what to do")
    return broken


def _check_names(model: mujoco.MjModel, path: Path) -> None:
    try:
        model.names.decode("utf-8")
    except UnicodeDecodeError:
        raise BrokenModelError(path, NOT_UTF8) from None


def _check_timestep(model: mujoco.MjModel, path: Path, chosen: bool) -> None:
    step = model.opt.timestep
    if not (math.isfinite(step) and step > 0):
        if chosen:
            raise BadValueError("timestep", f"{step:g}", "a positive number of seconds")
        hint = "" if path.suffix == ".mjb" else "--timestep overrides it"
        raise BrokenModelError(path, f"its timestep is {step:g}, and must be positive and finite", hint=hint)
