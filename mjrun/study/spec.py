"""Specification of a study, its points and their results: picklable values for other processes and machines."""

import dataclasses
import math
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, Self

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import (
    BadValueError,
    MjrunError,
    SystemLimitError,
    UnknownNameError,
    UnstableError,
    UnstableWorldError,
    UsageError,
    clean,
    concerning,
    exception_text,
    flag,
    option,
    quoted,
    system_limit,
)
from mjrun.experiment.design import ABSENT, SHORT_PATHS, Design, numbers, simulation_kinds
from mjrun.model.override import ALTERNATIVES, EQUALS_IN_NAME, ORIENTATIONS, Override, apply, paths_of_field
from mjrun.model.source import ModelSource
from mjrun.model.sources import demonstration_in, source_of
from mjrun.options.datasets import CAMERA
from mjrun.options.kinds import ChoiceKind
from mjrun.options.option import is_given
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.simulation import RUN_REQUIREMENTS, SimulationOptions
from mjrun.packages import installed_version
from mjrun.physics.warp_device import PACKAGE, WARP
from mjrun.python_code import PickledWithCode, imported_packages
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.simulation.policy_episode import policy_packages
from mjrun.simulation.simulation import Simulation
from mjrun.study.dataset_specs import EpisodeSpec, ImageSpec
from mjrun.version import __version__

if TYPE_CHECKING:
    from mjrun.study.simulate import PointSimulator

BUG = 70  # the exit code
Status = Literal["ok", "unstable", "failed", "timeout", "crashed", "missing"]
Controllers = Mapping[str, Callable[..., object]]  # by the values of the parameter `controller`

BY_NAME = ("qpos", "qvel", "ctrl")  # written `qpos/hip`
# Options of a simulation that may vary as a whole.
WHOLE = ("timestep", "integrator", "key", "perturb", "seed", "ctrl_noise", "ctrl_noise_time", "ctrl_from")
WHOLE += ("ctrl_interpolation", "duration", "steps", "control_dt", "push")
MANY = 1000  # texts of a parameter that are checked one by one
MODEL, CONTROLLER = "model", "controller"
FILES = (MODEL, "ctrl_from")  # parameters whose values name files
NO_CONTROLLERS: Controllers = {}
ENDED = "ended"  # metric of studies with a condition `until`


@dataclass(frozen=True)
class StudySpec:
    """The specification of a study: everything that all its points share.

    Attributes:
      base: simulation that the points vary.
      names: parameters that vary.
      metrics: name and text of each metric.
      every: steps between two rows that metrics read.
      engine: physics engine: `c`, or `warp` in single precision.
      controllers: name and function of each controller, where the controller varies.
      product: files of each point of a dataset, which has no metrics: its images, or its episode.
    """

    base: Simulation
    names: tuple[str, ...]
    metrics: tuple[tuple[str, str], ...]
    every: int = 1
    engine: Literal["c", "warp"] = "c"
    controllers: tuple[tuple[str, Callable[..., object]], ...] = ()
    product: ImageSpec | EpisodeSpec | None = None

    def simulation(self, values: tuple[str, ...]) -> Simulation:
        """Returns the simulation of the point with these values."""
        names = self.names
        if self.product:
            names, values = without_cameras(names, values)
        return simulation_at(self.base, names, values, dict(self.controllers)).with_controller_copies

    def values(self, point: "StudyPoint") -> dict[str, str]:
        """Returns the values of a point, by parameter, of those that exist there."""
        return {name: text for name, text in zip(self.names, point.values, strict=True) if text != ABSENT}

    def stored_at(self, root: Path) -> Self:
        """Returns the same specification, whose files are in the folder `root`."""
        snapshot = self.base.snapshot and replace(self.base.snapshot, root=root)
        return replace(self, base=replace(self.base, snapshot=snapshot))

    def simulator(self) -> "PointSimulator":
        """Returns the simulator of the points, in the process that simulates them."""
        from mjrun.study.simulate import PointSimulator

        return PointSimulator(self)

    def models(self, points: Iterable[Sequence[str]]) -> list[ModelSource]:
        """Returns the model of the base simulation, and those that the values of points name instead."""
        place = self.names.index(MODEL) if MODEL in self.names else None
        texts = {} if place is None else dict.fromkeys(values[place] for values in points if values[place] != ABSENT)
        return [source_of(self.base.model), *map(source_of, texts)]

    @property
    def code(self) -> list[object]:
        """Functions and objects in it that the user has written."""
        return [*self.base.code, *(controller for _, controller in self.controllers)]

    @property
    def packages(self) -> Sequence[str]:
        """The packages that compute the results, in addition to those of all studies."""
        engine = (PACKAGE, WARP) if self.engine == "warp" else ()
        return [*engine, *policy_packages(self.base.policy), *imported_packages(self.code)]


class StudyPoint(NamedTuple):
    """A point: its index in the study, and its values. There may be a million of them."""

    index: int  # type: ignore[assignment] # not the method of tuples
    values: tuple[str, ...]


@dataclasses.dataclass(frozen=True, slots=True)  # since there may be a million of them
class PointResult:
    """The result of a point.

    Attributes:
      index: index of the point in the study.
      status: how the simulation ended.
      metrics: values of the metrics in order; NaN if the simulation did not reach its end.
      steps: number of steps completed.
      exit_code: exit code of `mjrun trace` of this point alone; 4 also where that command would only warn.
      message: reason of a failure; empty if the point did not fail.
      wall: wall time including compilation [s]; a share of it for points that ran side by side.
      files: paths in the folder of a dataset, and contents.
    """

    index: int
    status: Status
    metrics: tuple[float, ...]
    steps: int
    exit_code: int = 0
    message: str = ""
    wall: float = 0.0
    files: tuple[tuple[str, bytes], ...] = ()

    @classmethod
    def failed(
        cls,
        index: int,
        error: Exception,
        metrics: int,
        snapshot: InputSnapshot | None,
        steps: int = 0,
        wall: float = 0.0,
    ) -> "PointResult":
        """Returns the result of a point that failed with an error.

        Args:
          metrics: number of metrics.
          snapshot: copies of files, which the reason names as the user does.

        Raises:
          SystemLimitError: a limit of the system is the cause, and not the point.
        """
        for cause in filter(None, (error, error.__context__)):
            if isinstance(limit := system_limit(cause), SystemLimitError):
                raise limit from error
        status: Status = "unstable" if isinstance(error, UnstableError | UnstableWorldError) else "failed"
        code = error.exit_code if isinstance(error, MjrunError) else BUG
        text = error.spelled(flag) if isinstance(error, MjrunError) else exception_text(error)
        text = snapshot.with_original_names(text) if snapshot else text
        return cls(index, status, (math.nan,) * metrics, steps, code, text, wall)


class Simulator(Protocol):
    """A simulator of points, in the process that simulates them."""

    def run(self, points: Sequence[StudyPoint]) -> Iterator[Sequence[PointResult]]:
        """Yields the results of points in the order in which they end."""
        ...


class SimulatorSpec(Protocol):
    """Everything that points share: a picklable value, from which a process makes their simulator."""

    def stored_at(self, root: Path) -> Self:
        """Returns the same specification, whose files are in the folder `root`."""
        ...

    def simulator(self) -> Simulator:
        """Returns the simulator of the points."""
        ...

    def models(self, points: Iterable[Sequence[str]]) -> Sequence[ModelSource]:
        """Returns the models of points, given by their values."""
        ...

    @property
    def packages(self) -> Sequence[str]:
        """The packages that compute the results, in addition to those of all studies."""
        ...


def with_end(metrics: Sequence[tuple[str, str]], simulation: Simulation) -> tuple[tuple[str, str], ...]:
    """Returns `metrics`, and the time at which the condition `until` ends a simulation early, if it has one."""
    return (*metrics, *([(ENDED, f"last(time, {simulation.until})")] if simulation.until is not None else []))


# --- values of points --------------------------------------------------------------------------------


def without_cameras(names: Sequence[str], values: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Returns the parameters of a point without those of cameras, which the simulation does not depend on."""
    kept = [pair for pair in zip(names, values, strict=True) if not pair[0].startswith(CAMERA)]
    return tuple(name for name, _ in kept), tuple(value for _, value in kept)


def simulation_at(
    base: Simulation, names: tuple[str, ...], values: tuple[str, ...], controllers: Controllers = NO_CONTROLLERS
) -> Simulation:
    """Returns the simulation of the point at which the parameters `names` have `values`.

    Raises:
      UsageError: a parameter is unknown, or a value is invalid.
    """
    changes: dict[str, object] = {}
    overrides: list[tuple[str, str]] = []
    if MODEL in names and base.replay is not None and base.replay == demonstration_in(base.model):
        changes["replay"] = None  # another demonstration has other states
    for name, text in zip(names, values, strict=True):
        if text == ABSENT:
            continue
        if is_path(name):
            overrides.append((name, text))
            continue
        key, value = _change(name, text, controllers)
        if key in BY_NAME:
            entries = changes.setdefault(key, dict({"qpos": base.qpos, "qvel": base.qvel, "ctrl": base.ctrl}[key]))
            assert isinstance(entries, dict)
            entries |= dict([value])
        else:
            changes[key] = value
    changes |= _without_effect(base, names, changes)
    varied = base.with_values(changes) if changes else base
    return varied.with_overrides(overrides) if overrides else varied


def _without_effect(base: Simulation, names: Sequence[str], changes: Mapping[str, object]) -> dict[str, object]:
    """Returns the defaults of those options of `base` that have no effect at a point.

    Their partner is a parameter that does not exist there.
    """
    defaults = dict[str, object]()
    for each in RUN_REQUIREMENTS:
        is_absent = each.partner in names and each.partner not in changes and not is_given(base, each.partner)
        if is_absent and each.name not in changes and is_given(base, each.name):
            defaults[each.name] = getattr(SimulationOptions, each.name)
    return defaults


def require_values(
    points: Design, controllers: Controllers, spec: mujoco.MjSpec | None, *, has_cameras: bool = False
) -> None:
    """Refuses values that are invalid in every model, such as a seed of 1.5.

    Args:
      spec: specification of the model, if all points share it.
      has_cameras: whether points have parameters of cameras, which are not checked.

    Raises:
      UsageError: a value is invalid.
    """
    for index, name in enumerate(points.names):
        if has_cameras and name.startswith(CAMERA):
            continue
        for text in _representative(points.distinct(index)):
            if text == ABSENT:
                continue
            if not is_path(name):
                _change(name, text, controllers)
            elif spec is not None:
                with concerning("vary", name):
                    apply(spec.copy(), Override(name, text))


def is_path(name: str) -> bool:
    """Returns whether a parameter is the path of an override rather than an option."""
    return "." in name and name.partition("/")[0] not in BY_NAME


def places_in_any_order(names: Sequence[str]) -> list[int]:
    """Returns the places of parameters in an order that is the same for all orders with the same effect.

    The later of two parameters counts where both set a number, as `geom/*.mass` and `geom/box.mass` do. Therefore,
    those of one field, or of the initial positions, velocities or controls, stay in their order.
    """

    def kind(place: int) -> str:
        name = SHORT_PATHS.get(names[place], names[place])
        if not is_path(name):
            return name.partition("/")[0]
        field = Override(name, "").target.rpartition(".")[2]
        return "quat" if field in (*ORIENTATIONS, *ALTERNATIVES) else field

    return sorted(range(len(names)), key=kind)


def _change(name: str, text: str, controllers: Controllers) -> tuple[str, Any]:
    """Returns the option that a parameter changes and its value, or an entry of an option that has entries by name.

    Raises:
      UsageError: the parameter is unknown, or the value is invalid.
    """
    group, slash, rest = name.partition("/")
    if name == MODEL:
        return name, text
    if name == CONTROLLER:
        if text not in controllers:
            message = f"{option('vary')} controller: {clean(text)}: only the command line and Python may name code"
            raise UsageError(message, ("vary", name))
        return name, controllers[text]
    has_entries = slash and group in BY_NAME
    with concerning("vary", name):
        if slash and "=" in text:
            raise UsageError(f"{option('vary')} {clean(name)}: invalid value {quoted(text)}\n{EQUALS_IN_NAME}")
        if not has_entries and name not in WHOLE:
            valid = [*WHOLE, MODEL, CONTROLLER, *(f"{each}/NAME" for each in BY_NAME), "opt.FIELD", "KIND/NAME.FIELD"]
            raise UnknownNameError("parameter", name, valid, where=option("vary"), meant=paths_of_field(name))
        try:
            key, entry = (group, f"{rest}={text}") if has_entries else (name, text)
            kind = simulation_kinds()[key]
            return key, kind(kind.parse(entry)) if isinstance(kind, ChoiceKind) else kind.parse(entry)
        except InvalidValueError as error:
            raise BadValueError(f"{option('vary')} {clean(name)}", text, error.expected) from None


def _representative(distinct: Sequence[str]) -> Sequence[str]:
    """Selects values that show whether any of many is invalid: the extremes and a fraction of numbers."""
    values = numbers(distinct)
    if values is None or np.isnan(values).all():
        return distinct[:MANY]
    is_broken = ~np.isnan(values) & (values != np.floor(values))
    chosen = [0, int(is_broken.argmax()), int(np.nanargmin(values)), int(np.nanargmax(values))]
    return [distinct[place] for place in dict.fromkeys(chosen)]


# --- versions and chunks -----------------------------------------------------------------------------


def versions(packages: Iterable[str] = ()) -> dict[str, str]:
    """Returns the versions of all libraries that determine the results of a simulation.

    Args:
      packages: packages that compute these results in addition; missing ones are left out.
    """
    always = {"mjrun": __version__, "mujoco": mujoco.mj_versionString(), "numpy": np.__version__}
    others = {package: installed_version(package) for package in packages if package not in always}
    return always | {package: version for package, version in others.items() if version}


@dataclass(frozen=True)
class WorkerVersions:
    """The versions that a worker process simulates with.

    Attributes:
      versions: versions of libraries, by name.
      environments: packages of the environments that models come from, by model; see `ModelSource.code`.
      host: name of the machine.
    """

    versions: Mapping[str, str]
    environments: Mapping[str, str]
    host: str

    @classmethod
    def here(cls, models: Iterable[ModelSource], packages: Iterable[str] = ()) -> "WorkerVersions":
        """Returns the versions that this process simulates `models` with; see `versions`."""
        environments = {model.text: code for model in models if (code := model.code)}
        return cls(versions(packages), environments, socket.gethostname())

    def difference(self, expected: "WorkerVersions") -> str:
        """Describes the difference from the expected versions for a message; empty if they are equal."""
        wanted = {**expected.versions, **expected.environments}
        differing = [
            f"{clean(name)} {clean(value)} instead of {clean(wanted[name])}"
            for name, value in {**self.versions, **self.environments}.items()
            if wanted.get(name, value) != value
        ]
        return ", ".join(differing)


@dataclass(frozen=True)
class ShippedStudy:
    """Everything that a process on any machine needs to simulate points of a study.

    Attributes:
      spec: its `SimulatorSpec`, with the user's code.
      metrics: number of metrics.
      snapshot: copies of all files that its points read.
    """

    spec: PickledWithCode
    metrics: int
    snapshot: InputSnapshot

    @classmethod
    def of(cls, spec: StudySpec) -> "ShippedStudy":
        """Seals a study; copies its files unless it already has copies."""
        spec = replace(spec, base=spec.base.with_snapshot())
        assert spec.base.snapshot
        return cls(PickledWithCode.of(spec, spec.code), len(spec.metrics), spec.base.snapshot)


@dataclass(frozen=True)
class ChunkResult:
    """The results of the points of a chunk, in order.

    Attributes:
      results: the results; if they are published, only those of points that are not ok.
      worker_versions: versions that they were simulated with; empty if no process reached its end.
      lacks_files: whether nothing was simulated because this machine has no copies of the study's files.
      is_refused: whether the results are of other versions than the study.
      part: name of the part in which all results are published; empty if they are not.
      steps, wall: sums over the points that are not in `results`, the latter [s].
    """

    results: Sequence[PointResult]
    worker_versions: tuple[WorkerVersions, ...] = ()
    lacks_files: bool = False
    is_refused: bool = False
    part: str = ""
    steps: int = 0
    wall: float = 0.0

    @property
    def hosts(self) -> str:
        """The machines that have simulated the points."""
        return ", ".join(sorted({each.host for each in self.worker_versions} or {socket.gethostname()}))
