"""Results of a benchmark. In JSON (`mjrun bench --json`), these dataclasses are objects with the same keys.

All wall times and simulated times are in seconds; `SampleStatistics` contain the number of measurements, and their
median with an interval and percentiles. Files with the same `schema` have these keys, and may have additional ones.

A comparison with a saved baseline states whether a benchmark is slower, and with what certainty. Wall times of two
benchmarks differ with the state of the machine as well as with the measured model. If both have timed the same
reference workload alternately with a timing, its samples `s` are divided by those of the workload, `r`, of the same
turn, and the quotients of both benchmarks are compared by the ratio of their medians:

    ratio = median(s_i / r_i) now / median(s_j / r_j) in the baseline

A machine that is slower as a whole changes neither quotient. The interval of the ratio is the `ratio_interval` of the
quotients; it only assumes that turns are independent of each other.

The interval reflects how samples differ within a benchmark, not how another process has slowed down all of them. Such a
disturbance can only increase a wall time, and affects the fastest sample least: a timing must therefore be slower by
its median and by its fastest sample.
"""

import hashlib
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco

from mjrun.bench.block_timing import ReferenceWorkloadInfo, StepPhase
from mjrun.bench.output_timing import EndToEndTiming, FrameTiming, LoadTiming
from mjrun.bench.statistics import CONFIDENCE, SampleStatistics, median, ratio_interval
from mjrun.bench.step_timing import WARP, C, ThreadTiming, WarpSettings
from mjrun.dataclass import dataclass
from mjrun.errors import FileError, UsageError, clean, file_errors, listing, option
from mjrun.platform.cores import available_cores

CPU_INFO = Path("/proc/cpuinfo")
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
BUSY = 0.25  # load per core above which figures are unreliable
TimingId = tuple[str, str]  # name, and device if that is not the processor
Document = Mapping[str, Any]  # a benchmark as JSON

SCHEMA = "mjrun-bench-1"
FAILED, SLOWER, INCONCLUSIVE, FASTER, NOT_SLOWER = "failed", "slower", "inconclusive", "faster", "not slower"
WORST_FIRST = (FAILED, SLOWER, INCONCLUSIVE, NOT_SLOWER, FASTER)

# Keys that must be equal for a comparison.
OPTIONS = ("key", "noise_std", "noise_rate", "settings")
MACHINE = ("system", "cpu", "cores", "available")
ENGINE = ("name", "device", "device_name", "worlds", "nconmax", "njmax")


@dataclass(frozen=True)
class TimingSamples:
    """Wall times [s] of one timing and, if it was timed, of the reference workload in the same turns."""

    times: Sequence[float]
    workload: Sequence[float] | None

    @classmethod
    def read(cls, statistics: Document, workload: Document | None) -> "TimingSamples":
        """Reads `SampleStatistics` in JSON."""
        times = _positive(statistics["samples"])
        if workload is None:
            return cls(times, None)
        workload_times = _positive(workload["samples"])
        if len(workload_times) != len(times):
            raise ValueError("the reference workload needs as many samples as the timing")
        return cls(times, workload_times)

    @property
    def median(self) -> float:
        """Median of the wall times [s]."""
        return median(self.times)

    def quotients(self, workload: Sequence[float]) -> list[float]:
        """Returns the wall times, each divided by that of the workload in the same turn."""
        return [time / reference for time, reference in zip(self.times, workload, strict=True)]


def timings(document: Document) -> Iterator[tuple[TimingId, TimingSamples]]:
    """Yields all timings that are compared."""
    for row in document["rows"]:
        yield from timings_of_row(row)
    for frame in document["frames"]:
        (width, height), renderer = frame["size"], frame["renderer"]
        name = f"{frame['view']} {width}x{height} {frame['quality']}" + f" {renderer}" * (renderer != "classic")
        yield (name, frame["device"]), TimingSamples.read(frame["total"], frame.get("reference_workload"))


def timings_of_row(row: Document) -> Iterator[tuple[TimingId, TimingSamples]]:
    """Yields the timings of a point of the grid."""
    point = "".join(f" {path}={value}" for path, value in row["point"].items())
    if row["step"] is not None:
        yield (f"step{point}", ""), TimingSamples.read(row["step"], row.get("reference_workload"))
    for threads in row["threads"]:
        if threads["threads"] > 1:
            name = f"threads {threads['threads']}{point}"
            yield (name, ""), TimingSamples.read(threads["step"], threads.get("reference_workload"))


def _positive(samples: Sequence[Any]) -> list[float]:
    times = [float(sample) for sample in samples]
    if not times or not all(0 < time < math.inf for time in times):
        raise ValueError("samples must be positive")
    return times


@dataclass(frozen=True)
class TimingComparison:
    """Comparison of one timing with that of the baseline.

    Attributes:
      name: name of the timing and its point in the grid: `step`, `threads 2`, `rgb 1280x720 model`.
      base, now: medians of the wall time [s].
      ratio: ratio of the medians, relative to the reference workload if `reference_workload` is a number; above 1 is
        slower.
      low, high: interval of the ratio at 95 %; None if there are too few samples.
      fastest: ratio of the fastest samples, likewise relative to the reference workload.
      reference_workload: ratio of the medians of the workload; above 1, the machine is slower. None if wall times are
        compared directly.
      verdict: `slower` if the interval and `fastest` are above the limit; `faster` if the interval is below 1;
        `not slower` if the interval is not above the limit; else `inconclusive`.
    """

    name: str
    base: float
    now: float
    ratio: float
    low: float | None
    high: float | None
    fastest: float
    reference_workload: float | None
    verdict: str


@dataclass(frozen=True)
class MissingTiming:
    """A timing of the baseline that is missing in this benchmark.

    Attributes:
      name: name of the timing, with the device if that is not the processor.
      base: median of the wall time [s].
      failure: reason why it could not be measured, such as an instability; None if it was not requested.
    """

    name: str
    base: float
    failure: str | None


@dataclass(frozen=True)
class BaselineComparison:
    """Comparison of a benchmark with its baseline.

    Attributes:
      base: file of the baseline.
      limit: ratio above which a timing is slower.
      verdict: worst verdict of all timings; `failed` if one of the baseline could not be measured.
      ratios: changes of the timings that both contain.
      gone: timings that only the baseline contains.
      differences: differences of model, options and machine that were overridden.
    """

    base: str
    limit: float
    verdict: str
    ratios: Sequence[TimingComparison]
    gone: Sequence[MissingTiming]
    differences: Sequence[str]


def read_base(path: str | Path) -> Document:
    """Reads a saved benchmark.

    Raises:
      FileError: the file cannot be read, or is not a benchmark.
    """
    path = Path(path)
    try:
        with file_errors(path):
            document: Document = json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        hint = f"`mjrun bench` makes a benchmark with {option('save')}"
        raise FileError(path, f"is not JSON: {clean(str(error))}", hint) from None

    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise FileError(path, "is not a benchmark of this mjrun", f"`mjrun bench` makes one with {option('save')}")

    try:
        list(timings(document))
        differences(document, document)
        workload_obstacle(document, document)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise FileError(path, f"is an incomplete benchmark: {type(error).__name__} {clean(str(error))}") from None
    return document


def differences(now: Document, base: Document) -> list[str]:
    """Returns the reasons why `now` and `base` cannot be compared.

    Compiled models differ between versions of MuJoCo, so that model files are compared across versions.
    """
    same_mujoco = now["mujoco"] == base["mujoco"]
    fingerprint = "sha256" if same_mujoco else "file_sha256"
    reasons = list[str]()
    if now["model"][fingerprint] != base["model"][fingerprint]:
        reasons.append("another model" if same_mujoco else "another model file")

    for part, keys in (("engine", ENGINE), ("options", OPTIONS), ("machine", MACHINE)):
        for key in keys:
            there, here = base[part][key], now[part][key]
            if there != here:
                name = "engine" if (part, key) == ("engine", "name") else key
                reasons.append(f"{name}: {clean(_word(there))} there, {clean(_word(here))} here")

    steps = now["options"]["steps"]
    others = sorted({row["steps"] for row in base["rows"] if row["step"] is not None and row["steps"] != steps})
    if steps is not None and others:
        reasons.append(f"steps: {', '.join(map(str, others))} there, {steps} here")
    return reasons


def workload_obstacle(now: Document, base: Document) -> str | None:
    """Returns the reason why the reference workloads of `now` and `base` cannot be compared; None if they can.

    MuJoCo simulates the workload: a slower version of MuJoCo would slow down the workload, too, and stay hidden.
    """
    here, there = now.get("reference_workload"), base.get("reference_workload")
    if here is None:
        return "no reference workload is timed with this engine"
    if there is None:
        return "the baseline has no reference workload"
    if here["version"] != there["version"]:
        return "the baseline has another reference workload"
    if now["mujoco"] != base["mujoco"]:
        return f"MuJoCo {clean(_word(base['mujoco']))} simulated the reference workload of the baseline"
    return None


def steps_of(base: Document, point: Mapping[str, str]) -> int | None:
    """Returns the steps of a rollout at a point of the grid, which a comparable benchmark must take, too."""
    return next((row["steps"] for row in base["rows"] if row["point"] == point and row["step"] is not None), None)


def check_same(now: Document, base: Document, path: str, force: bool) -> list[str]:
    """Returns the differences that `force` overrides.

    Raises:
      UsageError: the documents differ, and `force` is not set.
    """
    reasons = differences(now, base)
    if reasons and not force:
        lines = "\n".join(reasons)
        advice = f"{option('force')} compares them nevertheless"
        raise UsageError(f"{clean(path)} is not a baseline for this benchmark\n{lines}\n{advice}", ("compare",))
    return reasons


def compare(
    now: Document, base: Document, path: str, threshold: float, overridden: Sequence[str] = ()
) -> BaselineComparison:
    """Compares every timing that both documents contain, and lists those that only the baseline contains.

    Args:
      threshold: accepted slowdown of a timing: 0.1 is a tenth.
      overridden: differences that are ignored, from `check_same`.

    Raises:
      UsageError: the documents have no timing in common, and nothing has failed.
    """
    before, here, limit = dict(timings(base)), dict(timings(now)), 1 + threshold
    with_workload = workload_obstacle(now, base) is None
    ratios = [
        _ratio(timing[0], samples, before[timing], limit, with_workload)
        for timing, samples in here.items()
        if timing in before
    ]

    failures = _failures(now, base)
    missing = [
        MissingTiming(_label(timing), samples.median, failures.get(timing))
        for timing, samples in before.items()
        if timing not in here
    ]

    verdicts = [ratio.verdict for ratio in ratios] + [FAILED for timing in missing if timing.failure]
    if not verdicts:
        names = listing([*map(_label, before)])
        message = f"{clean(path)} has no timing in common with this benchmark\nit has {names}"
        raise UsageError(message, ("compare",))
    return BaselineComparison(path, limit, min(verdicts, key=WORST_FIRST.index), ratios, missing, overridden)


def _failures(now: Document, base: Document) -> dict[TimingId, str]:
    """Returns the timings of the baseline that could not be measured now, with the reasons."""
    failed = [row for row in now["rows"] if row["failure"] is not None]
    return {
        timing: row["failure"]
        for row in failed
        for before in base["rows"]
        if before["point"] == row["point"]
        for timing, _ in timings_of_row(before)
    }


def _ratio(name: str, now: TimingSamples, base: TimingSamples, limit: float, with_workload: bool) -> TimingComparison:
    here, there, fastest, workload = now.times, base.times, min(now.times) / min(base.times), None
    if with_workload and now.workload and base.workload:
        here, there = now.quotients(now.workload), base.quotients(base.workload)
        fastest /= min(now.workload) / min(base.workload)
        workload = median(now.workload) / median(base.workload)

    interval = ratio_interval(here, there, CONFIDENCE)
    low, high = (None, None) if interval is None else (interval.low, interval.high)
    return TimingComparison(
        name=name,
        base=base.median,
        now=now.median,
        ratio=median(here) / median(there),
        low=low,
        high=high,
        fastest=fastest,
        reference_workload=workload,
        verdict=verdict(low, high, fastest, limit),
    )


def verdict(low: float | None, high: float | None, fastest: float, limit: float) -> str:
    """Returns the verdict on the interval of a ratio and the ratio of the fastest samples."""
    if low is None or high is None:
        return INCONCLUSIVE
    if low > limit and fastest > limit:
        return SLOWER
    if high < 1:
        return FASTER
    return NOT_SLOWER if high <= limit else INCONCLUSIVE


def _label(timing: TimingId) -> str:
    name, device = timing
    return f"{name} by {device}" if device else name


def _word(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


# --- results -----------------------------------------------------------------------------------------


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
    whole: Sequence[EndToEndTiming] = ()
    comparison: BaselineComparison | None = None
    notes: Sequence[str] = ()
    wall: float = 0.0
    schema: str = SCHEMA
