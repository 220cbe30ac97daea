"""Results of a benchmark. As JSON (`mjrun bench --json`), these dataclasses are objects with the same keys.

All wall times and simulated times are in seconds; `SampleStatistics` say how often something was measured, and give its
median with an interval and its spread. Files with the same `schema` have these keys, and may have new ones.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from mjrun.bench.baseline import SCHEMA, BaselineComparison
from mjrun.bench.frame_timing import FrameTiming
from mjrun.bench.machine_info import MachineInfo
from mjrun.bench.output_timing import LoadTiming, OutputTiming
from mjrun.bench.reference_workload import WorkloadInfo
from mjrun.bench.rollout_timing import Phase
from mjrun.bench.statistics import SampleStatistics
from mjrun.bench.step_timing import ThreadScaling
from mjrun.bench.warp_timing import WARP, C, WarpOptions


@dataclass(frozen=True)
class ModelInfo:
    """The model that was measured.

    Attributes:
      path: of its file; empty for one that was given compiled.
      sha256: of its compiled form, with all assets and overrides, without those of the scan.
      file_sha256: of its file alone; None without one.
      nq, nv, nu, nbody, ngeom: MuJoCo's sizes.
    """

    path: str
    sha256: str
    file_sha256: str | None
    nq: int
    nv: int
    nu: int
    nbody: int
    ngeom: int

    @classmethod
    def of(cls, model: mujoco.MjModel, path: str, sha256: str, file: Path | None) -> "ModelInfo":
        """With the sizes of `model`, and the fingerprint of its `file`."""
        file_sha256 = file and hashlib.sha256(file.read_bytes()).hexdigest()
        return cls(path, sha256, file_sha256, model.nq, model.nv, model.nu, model.nbody, model.ngeom)


@dataclass(frozen=True)
class BenchSettings:
    """Options of the benchmark.

    Attributes:
      key: keyframe that it starts from.
      noise_std, noise_rate: of the noise on the controls, as `Bench` has them.
      steps, repeats: as given; None when the budget decided.
      budget: wall time [s].
      settings: overrides, as given.
      scan: settings and their values.
    """

    key: str | None
    noise_std: float
    noise_rate: float
    steps: int | None
    repeats: int | None
    budget: float
    settings: Sequence[str]
    scan: Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class EngineInfo:
    """What takes the steps.

    Attributes:
      name: `c`, MuJoCo itself, or `warp`, MuJoCo Warp in single precision.
      version: of mujoco_warp and Warp; None of MuJoCo, whose version is that of the benchmark.
      device: `cpu`, or Warp's alias, such as `cuda:0`.
      device_name: the name that the device gives itself.
      worlds: copies of the model that are stepped at once.
      nconmax, njmax: contacts and constraints of a world that there is room for; None where not given.
    """

    name: str
    version: str | None
    device: str
    device_name: str
    worlds: int
    nconmax: int | None
    njmax: int | None

    @classmethod
    def of(cls, warp: WarpOptions | None, machine: MachineInfo) -> "EngineInfo":
        """Of MuJoCo itself, or of MuJoCo Warp if there are options for it."""
        if warp is None:
            return cls(C, None, "cpu", machine.cpu, 1, None, None)
        name = machine.cpu if warp.device == "cpu" else warp.device_name  # Warp calls every processor CPU
        return cls(WARP, warp.version, warp.device, name, warp.worlds, warp.nconmax, warp.njmax)


@dataclass(frozen=True)
class StepCounts:
    """What a step of one world consists of, on average.

    Attributes:
      contacts, constraints: number of them.
      solver, iterations: of the constraint solver, averaged over islands.
      arena, arena_size: most of the arena that was in use at once, and its size [bytes]; None with `warp`.
    """

    contacts: float
    constraints: float
    solver: str
    iterations: float
    arena: int | None
    arena_size: int | None


@dataclass(frozen=True)
class Accuracy:
    """How accurate the motion is, without noise on the controls.

    Attributes:
      horizon: simulated time after which this is measured [s].
      energy_drift: potential and kinetic energy less those at the start [J]; this is the integrator's error only
        where nothing drives or brakes the model.
      reference: timestep of the finer run that it is compared with [s]; all else is the same.
      distance: root mean square of the difference of the positions, over all degrees of freedom [m and rad].
      failure: why there are no numbers; else None.
    """

    horizon: float
    energy_drift: float | None
    reference: float
    distance: float | None
    failure: str | None = None


@dataclass(frozen=True)
class GridPointResult:
    """One point of the grid, or the only simulation.

    Attributes:
      point: settings of the grid.
      integrator, timestep: of this simulation.
      steps, block: of one rollout, and those that are timed at once.
      step: wall time per step of one world, a sample for each rollout; `p5` and `p95` are of blocks of steps.
      reference_workload: wall time per step of the reference workload, a sample after each rollout; None with `warp`.
      steps_per_second, realtime_factor: of the median, of all worlds together.
      first_step: wall time of the first step of all worlds [s], in which `warp` compiles what it has not cached; None
        with `c`.
      counts: what a step consists of.
      phases: MuJoCo's own, timed in a separate rollout, in which the timers themselves cost time; None with `warp`.
      threads: independent copies of the simulation.
      overflows: what `warp` had no room for, and what to raise, a sentence each.
      accuracy: None where it was not asked for.
      failure: why it could not be measured, such as an instability; else None.
    """

    point: Mapping[str, str]
    integrator: str
    timestep: float
    steps: int = 0
    block: int = 0
    step: SampleStatistics | None = None
    reference_workload: SampleStatistics | None = None
    steps_per_second: float | None = None
    realtime_factor: float | None = None
    first_step: float | None = None
    counts: StepCounts | None = None
    phases: Phase | None = None
    threads: Sequence[ThreadScaling] = ()
    overflows: Sequence[str] = ()
    accuracy: Accuracy | None = None
    failure: str | None = None


@dataclass(frozen=True)
class BenchResult:
    """A benchmark.

    Attributes:
      schema: of this document.
      mjrun, mujoco, numpy, python: versions.
      command: the command line.
      machine, load_after: what it ran on, and the load average when it was done.
      engine: what took the steps.
      model, options: what was measured.
      reference_workload: what was timed in turn with the figures, for comparisons; None with `warp`.
      load: loading the model; None for one that was given compiled.
      rows: points of the grid.
      frames: drawing, if it was asked for.
      whole: a trace and a video from start to end, if they were asked for.
      comparison: with a baseline, if there was one.
      notes: what a reader of these figures should know.
      wall: wall time of the benchmark itself.
    """

    mjrun: str
    mujoco: str
    numpy: str
    python: str
    command: str
    machine: MachineInfo
    load_after: float | None
    engine: EngineInfo
    model: ModelInfo
    options: BenchSettings
    reference_workload: WorkloadInfo | None
    load: LoadTiming | None
    rows: Sequence[GridPointResult] = ()
    frames: Sequence[FrameTiming] = ()
    whole: Sequence[OutputTiming] = ()
    comparison: BaselineComparison | None = None
    notes: Sequence[str] = ()
    wall: float = 0.0
    schema: str = SCHEMA
