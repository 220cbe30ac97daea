"""Results of a benchmark. In JSON (`mjrun bench --json`), these dataclasses are objects with the same keys.

All wall times and simulated times are in seconds; `SampleStatistics` contain the number of measurements, and their
median with an interval and percentiles. Files with the same `schema` have these keys, and may have additional ones.
"""

import hashlib
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco

from mjrun.bench.baseline import SCHEMA, BaselineComparison
from mjrun.bench.block_timing import ReferenceWorkloadInfo, StepPhase
from mjrun.bench.output_timing import FrameTiming, LoadTiming, OutputTiming
from mjrun.bench.statistics import SampleStatistics
from mjrun.bench.step_timing import WARP, C, ThreadTiming, WarpSettings
from mjrun.dataclass import dataclass
from mjrun.platform.cores import available_cores

CPU_INFO = Path("/proc/cpuinfo")
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
BUSY = 0.25  # load per core above which figures are unreliable


@dataclass(frozen=True)
class MachineInfo:
    """Facts about a machine, and its load.

    Attributes:
      system: operating system and architecture.
      cpu: model name of the processor.
      cores, available: logical processors, and those that this process may use.
      governor: Linux' policy for the processor's frequency; None if it cannot be read.
      load: average number of running or waiting processes over the last minute; None if it cannot be read.
    """

    system: str
    cpu: str
    cores: int
    available: int
    governor: str | None
    load: float | None

    @property
    def disturbances(self) -> Sequence[str]:
        """Sentences on conditions that distort figures."""
        causes = list[str]()
        if self.load is not None and self.load > BUSY * self.cores:
            causes.append(f"other processes keep this machine busy: load average {self.load:.2f} on {self.cores} cores")
        if self.governor not in (None, "performance"):
            causes.append(f"the processor's governor is {self.governor}; performance makes figures steadier")
        return causes


def machine_info() -> MachineInfo:
    """Returns the facts about this machine."""
    return MachineInfo(
        system=f"{platform.system()} {platform.machine()}",
        cpu=_cpu(),
        cores=os.cpu_count() or 1,
        available=available_cores(),
        governor=_text(GOVERNOR),
        load=round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    )


def _cpu() -> str:
    for line in (_text(CPU_INFO) or "").splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine()


def _text(path: Path) -> str | None:
    try:
        return path.read_text("utf-8", "replace").strip() or None
    except OSError:
        return None


@dataclass(frozen=True)
class ModelInfo:
    """Facts about the measured model.

    Attributes:
      path: path of its file; empty for a compiled model.
      sha256: hash of the compiled model with all assets and overrides, without those of the scan.
      file_sha256: hash of its file alone, or None.
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
        """Returns the sizes of `model`, and the fingerprint of its `file`."""
        file_sha256 = file and hashlib.sha256(file.read_bytes()).hexdigest()
        return cls(path, sha256, file_sha256, model.nq, model.nv, model.nu, model.nbody, model.ngeom)


@dataclass(frozen=True)
class BenchSettings:
    """Options of the benchmark.

    Attributes:
      key: keyframe of the start.
      noise_std, noise_rate: noise on the controls; see `Bench`.
      steps, repeats: steps and repeats of rollouts as specified; None if the budget determined them.
      budget: wall time [s].
      settings: overrides.
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
    """Facts about the engine that steps.

    Attributes:
      name: `c`, MuJoCo itself, or `warp`, MuJoCo Warp in single precision.
      version: version of mujoco_warp and Warp; None for MuJoCo, whose version is that of the benchmark.
      device: `cpu`, or Warp's alias, such as `cuda:0`.
      device_name: name that the device reports.
      worlds: number of copies of the model that are stepped at once.
      nconmax, njmax: maximum contacts and constraints of a world; None if not specified.
    """

    name: str
    version: str | None
    device: str
    device_name: str
    worlds: int
    nconmax: int | None
    njmax: int | None

    @classmethod
    def of(cls, warp: WarpSettings | None, machine: MachineInfo) -> "EngineInfo":
        """Returns facts about MuJoCo Warp if there are options for it, else about MuJoCo."""
        if warp is None:
            return cls(C, None, "cpu", machine.cpu, 1, None, None)
        name = machine.cpu if warp.device == "cpu" else warp.device_name  # Warp calls every processor CPU
        return cls(WARP, warp.version, warp.device, name, warp.worlds, warp.nconmax, warp.njmax)


@dataclass(frozen=True)
class StepCounts:
    """Average counts per step of one world: contacts, constraints and solver iterations.

    Attributes:
      contacts, constraints: number of contacts and constraints.
      solver, iterations: constraint solver, and its iterations averaged over islands.
      arena, arena_size: largest use of the arena, and its size [bytes]; None with `warp`.
    """

    contacts: float
    constraints: float
    solver: str
    iterations: float
    arena: int | None
    arena_size: int | None


@dataclass(frozen=True)
class IntegrationAccuracy:
    """Accuracy of the motion, without noise on the controls.

    Attributes:
      horizon: simulated time after which accuracy is measured [s].
      energy_drift: potential and kinetic energy minus those at the start [J]; an error of the integrator only if
        nothing drives or brakes the model.
      reference: timestep of the finer run for comparison [s]; all else is the same.
      distance: root mean square of the difference of the positions, over all degrees of freedom [m and rad].
      failure: reason why there are no numbers, if any.
    """

    horizon: float
    energy_drift: float | None
    reference: float
    distance: float | None
    failure: str | None = None


@dataclass(frozen=True)
class GridPointResult:
    """The result of one point of the grid, or of the only simulation.

    Attributes:
      point: settings of the grid.
      integrator, timestep: integrator and timestep of this simulation.
      steps, block: steps in a rollout, and steps that are timed at once.
      step: wall time per step of one world, one sample per rollout; `p5` and `p95` are of blocks of steps.
      reference_workload: wall time per step of the reference workload, one sample after each rollout; None with `warp`.
      steps_per_second, realtime_factor: rates from the median, of all worlds together.
      first_step: wall time of the first step of all worlds [s], in which `warp` compiles what it has not cached; None
        with `c`.
      counts: average contents of a step.
      phases: phases as timed by MuJoCo in a separate rollout, in which the timers take time themselves; None with
        `warp`.
      threads: timings of independent copies of the simulation.
      overflows: sentences on the memory that `warp` lacked, and the options to raise.
      accuracy: accuracy, if requested.
      failure: reason why the point could not be measured, such as an instability, if any.
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
    phases: StepPhase | None = None
    threads: Sequence[ThreadTiming] = ()
    overflows: Sequence[str] = ()
    accuracy: IntegrationAccuracy | None = None
    failure: str | None = None


@dataclass(frozen=True)
class BenchResult:
    """The result of a benchmark.

    Attributes:
      schema: name of this schema.
      mjrun, mujoco, numpy, python: versions.
      command: command line.
      machine, load_after: machine, and its load average at the end.
      engine: engine that steps.
      model, options: measured model, and options.
      reference_workload: workload that was timed alternately with the figures, for comparisons; None with `warp`.
      load: timing of loading the model; None for a compiled model.
      rows: points of the grid.
      frames: timings of frames, if requested.
      whole: timings of a whole trace and a whole video, if requested.
      comparison: comparison with a baseline, if requested.
      notes: remarks on these figures.
      wall: wall time of the benchmark.
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
    reference_workload: ReferenceWorkloadInfo | None
    load: LoadTiming | None
    rows: Sequence[GridPointResult] = ()
    frames: Sequence[FrameTiming] = ()
    whole: Sequence[OutputTiming] = ()
    comparison: BaselineComparison | None = None
    notes: Sequence[str] = ()
    wall: float = 0.0
    schema: str = SCHEMA
