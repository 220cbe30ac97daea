"""Model sources: the functions that parse a source and load it. Each module in this package is a kind of source."""

import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from importlib import import_module
from os import PathLike, fspath
from pathlib import Path

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, CompiledOverrideError
from mjrun.model.mujoco_globals import refuse_python_callbacks
from mjrun.model.override import Override
from mjrun.model.source import CollectionModelSource, ModelSource
from mjrun.model.sources.bundled_scene import bundled_task
from mjrun.model.sources.demonstration import DemonstrationSource
from mjrun.model.sources.file import CollectionFileSource, FileSource
from mjrun.model.sources.stdin import StdinSource
from mjrun.suffixes import REFERRING, is_hdf5, is_yaml, split_episode

ModelLike = mujoco.MjModel | ModelSource | str | PathLike[str]


@dataclass(frozen=True)
class CompiledSource(ModelSource):
    """A compiled model, used unchanged."""

    model: mujoco.MjModel

    @property
    def text(self) -> str:
        return ""

    @property
    def stem(self) -> str:
        return "model"

    def compile(self) -> tuple[None, mujoco.MjModel]:
        refuse_python_callbacks()
        if self.overrides:
            raise CompiledOverrideError("the model", [(s.option, s.option_value) for s in self.overrides])
        return None, self.model


def parse_source(text: str, overrides: Sequence[Override] = ()) -> ModelSource:
    """Returns the source that `text` names.

    It is `PREFIX:NAME` of a collection, `-` for standard input, `demo.hdf5:demo_3` for a demonstration, or else a file.

    Args:
      overrides: the overrides to load it with.
    """
    prefix, colon, name = text.partition(":")
    if text == "-":
        return StdinSource(overrides=tuple(overrides))
    if colon and (collection := model_collections().get(prefix)):
        return collection(name, overrides=tuple(overrides))
    return _in_file(text, overrides)


def _in_file(path: str | PathLike[str], overrides: Sequence[Override] = ()) -> FileSource | DemonstrationSource:
    """Returns the model in a file, or that of a demonstration in a file."""
    file, episode = split_episode(fspath(path))
    if is_hdf5(file):
        return DemonstrationSource(Path(file), episode, overrides=tuple(overrides))
    return FileSource(Path(path), overrides=tuple(overrides))


def is_file(text: str) -> bool:
    """Returns whether `text` names a file, or a demonstration in one."""
    return isinstance(parse_source(text), FileSource | DemonstrationSource)


def demonstration_in(model: ModelLike) -> str | None:
    """Returns the demonstration whose model `model` is, as text; None for other models."""
    source = source_of(model) if not isinstance(model, mujoco.MjModel) else None
    return source.text if isinstance(source, DemonstrationSource) else None


def is_task_name(text: str) -> bool:
    """Returns whether `text` names a task: a document, by its suffix, or a bundled scene."""
    if is_file(text):
        return is_yaml(text)
    return bundled_task(text) is not None


def is_model_name(text: str) -> bool:
    """Returns whether `text` names a model or a task, rather than a table.

    It does so by its suffix, in a collection, or as a demonstration.
    """
    file, episode = split_episode(text)
    return text != "-" and (bool(episode) or not is_file(text) or Path(file).suffix.lower() in REFERRING)


def source_of(model: ModelLike) -> ModelSource:
    """Returns the source of `model`: text is parsed, a path is a file, a compiled model represents itself.

    Raises:
      BadValueError: it is something else.
    """
    match model:
        case ModelSource():
            return model
        case mujoco.MjModel():
            return CompiledSource(model)
        case str():
            return _parsed(model)
        case PathLike():
            return _in_file(model)
    raise BadValueError("model", model, "the name or the path of a model, an MjModel, or a source")


@lru_cache(64)
def _parsed(text: str) -> ModelSource:
    return parse_source(text)


@cache
def model_collections() -> Mapping[str, type[CollectionModelSource]]:
    """Returns the model collections by prefix."""
    for module in pkgutil.iter_modules(__path__):
        import_module(f"{__name__}.{module.name}")
    collections = [*CollectionModelSource.__subclasses__(), *CollectionFileSource.__subclasses__()]
    return {each.PREFIX: each for each in collections if hasattr(each, "PREFIX")}


def listed_collection(text: str) -> type[CollectionModelSource] | None:
    """Returns the collection that `text` names without a model in it, as `scene:` does."""
    return model_collections().get(text[:-1]) if text.endswith(":") else None


def load(
    model: ModelLike,
    *,
    timestep: float | None = None,
    integrator: str | None = None,
    overrides: Mapping[str, str] | Sequence[Override] = (),
) -> mujoco.MjModel:
    """Compiles a model.

    Args:
      model: a file (.xml, .urdf, .mjz, .zip or .mjb), `scene:NAME`, `gym:NAME`, `dm:DOMAIN`, `menagerie:ROBOT/MODEL`,
        `FILE.hdf5:EPISODE` for a demonstration, or `-` for standard input.
      timestep: the timestep [s], in place of the model's.
      integrator: `euler`, `rk4`, `implicit`, `implicitfast` or `discrete`, in place of the model's.
      overrides: values by MuJoCo's own names, `{"opt.gravity": "0,0,10", "geom/floor.friction": ".1,.005,.0001"}`.

    Raises:
      ModelError: the model is missing, unreadable, or refused by MuJoCo.
      UsageError: an override refers to nothing, or its value does not fit.
    """
    by_path = isinstance(overrides, Mapping)
    added = [Override(path, value) for path, value in overrides.items()] if by_path else [*overrides]
    if integrator is not None:
        added.append(Override("opt.integrator", integrator, "integrator"))
    if timestep is not None:
        added.append(Override("opt.timestep", repr(float(timestep)), "timestep"))
    source = source_of(model)
    return replace(source, overrides=(*source.overrides, *added)).load()
