"""The interface of model sources (a file, standard input, `scene:dominos`) and the compilation that they share.

Compilation applies overrides, checks the result, and reports MuJoCo's refusals as errors. A compiled model has
fingerprints, and bugs of the installed MuJoCo may affect it.
"""

import hashlib
import math
import re
import threading
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, replace
from functools import cache
from pathlib import Path
from typing import ClassVar, Self, TypeVar

import mujoco
import numpy as np

from mjrun.confinement.confinement import confinement
from mjrun.dataclass import dataclass
from mjrun.errors import (
    ARENA,
    MORE_MEMORY,
    BadValueError,
    BrokenModelError,
    ModelError,
    ModelNotFoundError,
    clean,
    concerning,
    listing,
    option,
    quoted,
    system_limit,
)
from mjrun.model.mujoco_globals import refuse_python_callbacks, without_log
from mjrun.model.names import KIND_OF_COUNT, KINDS
from mjrun.model.override import Override, apply, elements_at
from mjrun.shared_status import doing
from mjrun.timeline import rational


@dataclass(frozen=True)
class ModelSource(ABC):
    """A model source and the overrides to load it with: a picklable value, which compiles the model each time.

    Attributes:
      overrides: the overrides, applied in order before compilation.
    """

    overrides: tuple[Override, ...] = field(default=(), kw_only=True)

    @property
    @abstractmethod
    def text(self) -> str:
        """The source as users, documents and manifests write it."""

    @property
    @abstractmethod
    def stem(self) -> str:
        """The base of output names, without folder and suffix."""

    @property
    def main_file(self) -> Path | None:
        """The model file, or None."""
        return None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that loading reads, the model file first, as far as known without compiling."""
        return ()

    @property
    def hidden_groups(self) -> Mapping[str, Sequence[int]]:
        """The groups of geoms, except planes, and of sites that images omit by default."""
        return {}

    def with_overrides(self, overrides: Sequence[Override]) -> Self:
        """Returns the same source with more overrides, after its own."""
        return replace(self, overrides=(*self.overrides, *overrides))

    def stored_at(self, place: Callable[[Path], Path]) -> "ModelSource":
        """Returns the same model with its files read at `place(path)`; errors and results still name the originals."""
        return self

    @property
    def code(self) -> str:
        """Text that identifies the source together with its files, such as code and versions; empty without any."""
        return ""

    def load(self) -> mujoco.MjModel:
        """Compiles the model.

        Raises:
          ModelError: it cannot be found or read, or MuJoCo refuses it.
          UsageError: an override names nothing, or its value does not fit.
        """
        return self.compile()[1]

    @contextmanager
    def named_in_errors(self) -> Generator[None]:
        """Makes errors about the model within the `with` block begin with this source."""
        try:
            yield
        except ModelError as error:
            if type(error) is not ModelError:  # subclasses name the file themselves
                raise
            raise ModelError(f"{clean(self.text)}: {error}") from None

    @abstractmethod
    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        """Returns the specification, None for a compiled model, and the model; raises the errors of `load`."""


@dataclass(frozen=True)
class CollectionEntry:
    """A line in the list of a collection.

    Attributes:
      facts: what the list states, by the name of the column.
    """

    name: str
    facts: Mapping[str, str]


@dataclass(frozen=True)
class CollectionModelSource(ModelSource):
    """A model in a collection, written `PREFIX:NAME`. A module in `mjrun.model.sources` defines each collection."""

    PREFIX: ClassVar[str]
    KIND: ClassVar[str] = "model"  # the noun for its members
    NO_TASK: ClassVar[str] = ""  # the reason why a policy cannot play it like a task of other collections

    name: str

    @classmethod
    @abstractmethod
    def descriptions(cls) -> Mapping[str, str]:
        """Returns a line about each model of the collection, by name."""

    @classmethod
    def entries(cls) -> Sequence[CollectionEntry]:
        """Returns the lines of a list of the collection; a collection may be listed by groups of its models."""
        return [CollectionEntry(name, {"description": text}) for name, text in cls.descriptions().items()]

    @classmethod
    def remark(cls) -> str:
        """Returns a sentence below the list; empty for none."""
        return ""

    @property
    def text(self) -> str:
        return f"{self.PREFIX}:{self.name}"

    @property
    def stem(self) -> str:
        return re.sub(r"\W+", "_", self.name)

    @property
    def label(self) -> str:
        """The source in errors: the prefix alone if no model is named."""
        return self.text if self.name else self.PREFIX

    def check_name(self, name: str | None = None) -> None:
        """Raises ModelNotFoundError, listing the collection, if it has no model called `name`, by default its own."""
        name = self.name if name is None else name
        if name in (valid := self.descriptions()):
            return
        reason = "no such" if name else "name the"
        raise ModelNotFoundError(self.label, f"{reason} {self.KIND}", [*valid], f"{self.KIND}s", name)


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
# a RuntimeError and means that memory ran out, or that no thread could be started.
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
      UsageError: an override refers to nothing, its value does not fit, or a callback is a Python function.
    """
    refuse_python_callbacks()
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
        expected = f"a positive number of seconds, at most {LONGEST:g}"
        raise BadValueError(option("timestep"), f"{model.opt.timestep:g}", expected)
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
    if "unknown exception" in message:
        _require_thread()
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


def _require_thread() -> None:
    """Raises SystemLimitError if this process can start no thread, as MuJoCo does to compile a model."""
    try:
        threading.Thread(target=int).start()
    except RuntimeError as error:
        raise system_limit(error) or error from error


def _is_timestep(value: float) -> bool:
    return 0 < value <= LONGEST


SPARSE_NEWTON = (
    "MuJoCo 4.0.0 factors the sparse Newton matrix wrongly for some models (issue 3767, fixed in 4.0.1); "
    "upgrade, or set opt.jacobian=dense"
)


def bugs_of_version(version: str) -> list[str]:
    """Returns the known bugs of a version of MuJoCo."""
    return [SPARSE_NEWTON] if version == "4.0.0" else []


def bugs_of_model(model: mujoco.MjModel) -> list[str]:
    """Returns the known bugs of the installed MuJoCo that can change the motion of `model`."""
    sparse_newton = model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON and mujoco.mj_isSparse(model)
    return bugs_of_version(mujoco.mj_versionString()) if sparse_newton else []


# Arrays of MjModel that only affect images, keyframes and names, and their sizes.
VISUAL = ("cam_", "key_", "light_", "mat_", "name_", "names", "paths", "skin_", "tex_", "text_")
VISUAL += ("nbuffer", "ncam", "nkey", "nlight", "nmat", "nnames", "npaths", "nskin", "ntex", "signature")
VISUAL_SUFFIXES = ("_rgba", "_group", "_matid", "_texcoord", "_texcoordadr", "_texcoordnum")
LOCATIONS = ("_pathadr", "npaths", "nbuffer")  # fields that depend on the lengths of file names


def model_fingerprint(model: mujoco.MjModel) -> str:
    """Returns the SHA-256 of the compiled model, with all its assets and overrides."""
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return hashlib.sha256(content.data).hexdigest()


def content_fingerprint(model: mujoco.MjModel) -> str:
    """Returns the SHA-256 of the compiled model with all its assets, independent of the folder of their files."""
    digest = hashlib.sha256()
    for name, value in _fields(model):
        if name != "paths" and not name.endswith(LOCATIONS):
            digest.update(name.encode() + b"\0" + value)
    return digest.hexdigest()


def _fields(owner: object) -> Iterator[tuple[str, bytes]]:
    """Yields the numbers, texts and arrays of a structure and of its inner structures."""
    for name in _public(type(owner)):
        value = getattr(owner, name)
        if isinstance(value, bytes):
            yield name, value
        elif isinstance(value, (int, float, np.ndarray, np.generic)):
            yield name, np.ascontiguousarray(value).data.tobytes()
        elif type(value).__module__ == type(owner).__module__:
            yield from _fields(value)


def physics_fingerprint(model: mujoco.MjModel) -> str:
    """Returns the SHA-256 of the options, and of every array that does not only affect images, keyframes and names."""
    digest = hashlib.sha256()
    for name, value in physics_fields(model):
        digest.update(name.encode() + b"\0" + value.tobytes())
    return digest.hexdigest()


def physics_fields(model: mujoco.MjModel) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the numbers and arrays of a model and of its options, except those that only affect images and names."""
    for owner in (model, model.opt):
        for name in _names(type(owner)):
            value = getattr(owner, name)
            if isinstance(value, (int, float, np.ndarray, np.generic)):
                yield name, np.asarray(value)


@cache
def _names(owner: type) -> tuple[str, ...]:
    return tuple(name for name in _public(owner) if not name.startswith(VISUAL) and not name.endswith(VISUAL_SUFFIXES))


@cache
def _public(owner: type) -> tuple[str, ...]:
    return tuple(name for name in sorted(dir(owner)) if not name.startswith("_"))
