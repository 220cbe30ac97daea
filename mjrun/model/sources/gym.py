"""The models of Gymnasium's environments as model sources, written `gym:NAME`."""

import copy
import importlib
import importlib.metadata
import importlib.util
import inspect
import json
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, cast
from urllib.parse import parse_qsl

import mujoco

from mjrun.confinement.confinement import require_unconfined
from mjrun.dataclass import dataclass
from mjrun.errors import (
    BrokenModelError,
    CompiledOverrideError,
    ModelNotFoundError,
    UnknownNameError,
    UsageError,
    clean,
)
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.source import CollectionModelSource, ModelSource, physics_fingerprint
from mjrun.model.sources.file import FileSource
from mjrun.packages import require

if TYPE_CHECKING:
    import gymnasium
    from gymnasium.envs.registration import EnvSpec

LIBRARY = "gymnasium"
EXTRA = "gym"
OWN = "gymnasium.envs.mujoco."  # the package of the MuJoCo environments that come with Gymnasium
NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
RENDER_MODE, EPISODE_STEPS = "render_mode", "max_episode_steps"  # mjrun sets the former, `gymnasium.make` the latter
FIRST = 4  # the first version that does not need mujoco-py
REMOVED = "it needs mujoco-py, which Gymnasium no longer supports; use a later version"


class MujocoEnvironment(Protocol):
    """The common attributes of MuJoCo environments, Gymnasium's own and others."""

    model: mujoco.MjModel
    data: mujoco.MjData


@dataclass(frozen=True)
class GymSource(CollectionModelSource):
    """The model of a registered environment that runs on MuJoCo.

    Its name may end in settings of the environment: `Ant-v5?include_cfrc_ext_in_observation=false&healthy_reward=0`.

    The simulation starts in the initial state of the model, like an environment without reset noise. Noise, control
    period and rewards belong to the environment, which a policy plays.

    Attributes:
      copy: a copy of the model's file, which is compiled in its place; the environment uses the file of its package.
    """

    PREFIX: ClassVar[str] = "gym"

    copy: Path | None = field(default=None, kw_only=True)

    @classmethod
    def descriptions(cls) -> Mapping[str, str]:
        descriptions = {}
        require(f"{cls.PREFIX}:", EXTRA, LIBRARY)
        for name in _own_names():
            try:
                descriptions[name] = environment_model(name).description
            except BrokenModelError:  # Pusher-v4 runs on MuJoCo 2 only
                continue
        return descriptions

    @property
    def stem(self) -> str:
        return re.sub(r"\W+", "_", self.name.partition("?")[0])

    @property
    def main_file(self) -> Path | None:
        return environment_model(self.name).file

    @property
    def files(self) -> tuple[Path, ...]:
        return FileSource(file, overrides=self.overrides).files if (file := self.main_file) else ()

    def stored_at(self, place: Callable[[Path], Path]) -> ModelSource:
        return replace(self, copy=place(file)) if (file := self.main_file) else self

    @property
    def code(self) -> str:
        return environment_model(self.name).code

    def compile(self) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        environment = environment_model(self.name)
        if file := self.copy or environment.file:
            return FileSource(file, overrides=self.overrides).compile()
        if self.overrides:
            raise CompiledOverrideError(self.text, [(s.option, s.option_value) for s in self.overrides])
        return None, copy.copy(environment.model)


class EnvironmentModel(NamedTuple):
    """The model of an environment.

    Attributes:
      file: the file that it is compiled from; None if Python makes the model, or changes it.
      model: the compiled model.
      control_steps: the number of physics steps per action.
      episode_steps: the number of actions in an episode, if the registration limits it.
      code: the environment with its settings, and the versions of its packages.
    """

    file: Path | None
    model: mujoco.MjModel
    control_steps: int
    episode_steps: int | None
    code: str

    @property
    def description(self) -> str:
        """A line about the model."""
        file = self.file.name if self.file else "a model made in Python"
        steps = f"{self.control_steps} steps of {self.model.opt.timestep:g} s per action"
        return ", ".join([file, steps, *([f"{self.episode_steps} actions"] if self.episode_steps else [])])


@cache
def environment_model(name: str) -> EnvironmentModel:
    """Returns the model of the environment `name`, which is created and closed without a reset or rendering.

    Raises:
      MissingExtraError: Gymnasium is not installed.
      ModelNotFoundError: the environment does not exist, or does not run on MuJoCo.
      BrokenModelError: it cannot be made.
    """
    environment = make_environment(name)
    unwrapped = mujoco_environment(environment, name)
    try:
        model = unwrapped.model
        file = _file_of(unwrapped, model)
        limit = environment.spec.max_episode_steps if environment.spec else None
        return EnvironmentModel(file, model, control_steps(unwrapped), limit, f"{name}, {_versions(environment)}")
    finally:
        environment.close()


def make_environment(name: str) -> "gymnasium.Env[Any, Any]":
    """Returns the environment `name` as `gymnasium.make` makes it, with the settings after a `?` in the name.

    Raises:
      UsageError: the environment does not accept these settings, or this process is confined.
      MissingExtraError, ModelNotFoundError, BrokenModelError: as for `environment_model`.
    """
    require_unconfined(f"{GymSource.PREFIX}:{clean(name)} is an environment, which is code")
    registered, _, query = name.partition("?")
    spec = _registered(registered)
    import gymnasium

    settings = _settings(query, name, spec)
    with quiet(), collected_warnings():
        try:
            return gymnasium.make(registered, disable_env_checker=True, **settings)
        except Exception as error:
            raise _broken(name, error) from error


def mujoco_environment(environment: "gymnasium.Env[Any, Any]", name: str) -> MujocoEnvironment:
    """Returns the innermost environment, or one in its attributes, that runs on MuJoCo.

    Raises:
      ModelNotFoundError: none of these environments runs on MuJoCo.
    """
    from gymnasium import Env

    innermost = environment.unwrapped
    held = [member.unwrapped for member in vars(innermost).values() if isinstance(member, Env)]
    for candidate in (innermost, *held):
        model, data = (vars(candidate).get(each) for each in ("model", "data"))
        if isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData):
            return cast(MujocoEnvironment, candidate)
    environment.close()
    raise _not_mujoco(name)


def control_steps(environment: object) -> int:
    """Returns the number of physics steps per action: `frame_skip` in Gymnasium, `n_substeps` in Gymnasium-Robotics."""
    members = vars(environment)
    return int(members.get("frame_skip") or members.get("n_substeps") or 1)


@contextmanager
def quiet() -> Generator[None]:
    """Suppresses warnings that newer versions exist, and redirects what environments print to stderr."""
    with warnings.catch_warnings(), redirect_stdout(sys.stderr):
        warnings.simplefilter("ignore")
        yield


def _file_of(environment: object, model: mujoco.MjModel) -> Path | None:
    """Returns the file that `model` is compiled from; None if no file gives this model."""
    path = vars(environment).get("fullpath")
    if not isinstance(path, str) or not Path(path).is_file():
        return None
    own = type(environment).__module__.startswith(OWN)
    file = FileSource(Path(path))
    with collected_warnings():
        return file.path if own or physics_fingerprint(file.load()) == physics_fingerprint(model) else None


def _versions(environment: "gymnasium.Env[Any, Any]") -> str:
    """Returns the versions of Gymnasium and of the package of the environment."""
    package = type(environment.unwrapped).__module__.partition(".")[0]
    distributions = importlib.metadata.packages_distributions().get(package, []) if package != LIBRARY else []
    versions = []
    for each in (LIBRARY, *distributions):
        with suppress(importlib.metadata.PackageNotFoundError):
            versions.append(f"{each} {importlib.metadata.version(each)}")
    return ", ".join(versions)


def _registered(name: str) -> "EnvSpec":
    """Returns the registration of an environment that may run on MuJoCo; imports the module of `module:NAME`."""
    require(f"gym:{clean(name)}", EXTRA, LIBRARY)
    import gymnasium

    module, _, registered = name.rpartition(":")
    namespace = registered.partition("/")[0]
    if not registered:
        raise _not_found(name, "name the environment")
    if module:
        _import_installed(module, name)
    try:
        with quiet():
            spec = gymnasium.spec(registered)
    except gymnasium.error.NamespaceNotFound:
        raise _not_found(name, f"no installed package registers environments under {clean(namespace)}/") from None
    except gymnasium.error.Error:
        raise _not_found(name, "no such environment") from None
    entry_point = spec.entry_point
    has_moved = callable(entry_point) and entry_point.__module__ == "gymnasium.envs"
    if has_moved or (str(entry_point).startswith(OWN) and (spec.version or 0) < FIRST):
        raise _not_found(name, REMOVED)
    if isinstance(entry_point, str) and entry_point.startswith("gymnasium.envs.") and not entry_point.startswith(OWN):
        raise _not_mujoco(name)
    return spec


def _settings(query: str, name: str, spec: "EnvSpec") -> dict[str, Any]:
    """Parses the settings of `name?query`: `a=1&b=false`; values are JSON, or else text.

    Raises:
      UsageError: the query is malformed, or the constructor of the environment does not accept the settings.
    """
    if not query:
        return {}
    from gymnasium.envs.registration import load_env_creator

    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True)
    except ValueError:
        raise UsageError(f"gym:{clean(name)}: settings are written ?NAME=VALUE&NAME=VALUE") from None
    texts = dict(pairs)
    if len(texts) < len(pairs):
        raise UsageError(f"gym:{clean(name)}: write each setting once")
    point = spec.entry_point
    signature = inspect.signature(load_env_creator(point) if isinstance(point, str) else cast(Any, point))
    named = [parameter.name for parameter in signature.parameters.values() if parameter.kind in NAMED]
    valid = [*(setting for setting in named if setting != RENDER_MODE), EPISODE_STEPS]
    for setting in texts:
        if setting not in valid:
            raise UnknownNameError("setting", setting, valid, where=f"gym:{spec.id}")
    return {setting: _value(text) for setting, text in texts.items()}


def _value(text: str) -> Any:
    """Parses a setting: JSON, or else the text itself."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def _import_installed(module: str, name: str) -> None:
    """Imports `module`, which registers environments, if an installed package contains it."""
    if module.partition(".")[0] not in importlib.metadata.packages_distributions():
        raise _not_found(name, f"no installed package has the module {clean(module)}")
    try:
        with quiet():
            importlib.import_module(module)
    except Exception as error:
        raise _broken(name, error) from error


@cache
def _own_names() -> tuple[str, ...]:
    """Returns the MuJoCo environments that Gymnasium registers; none if it is not installed."""
    if not importlib.util.find_spec(LIBRARY):
        return ()
    import gymnasium

    own = [spec for spec in gymnasium.registry.values() if str(spec.entry_point).startswith(OWN)]
    return tuple(sorted(spec.id for spec in own if (spec.version or 0) >= FIRST))


def _broken(name: str, error: Exception) -> BrokenModelError:
    """Returns an error about an exception that an environment, or its package, raised while it was made."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"in {place.filename}, line {place.lineno}"
    return BrokenModelError(Path(f"gym:{name}"), f"{type(error).__name__}: {str(error) or place.line}", hint=where)


def _not_found(name: str, reason: str) -> ModelNotFoundError:
    return ModelNotFoundError(
        f"gym:{name}" if name else "gym", reason, _own_names(), "environments of Gymnasium on MuJoCo", name
    )


def _not_mujoco(name: str) -> ModelNotFoundError:
    return _not_found(name, "it does not run on MuJoCo")
