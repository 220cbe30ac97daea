"""What a benchmark found. As JSON (`mjrun bench --json`), its dataclasses are objects with these keys.

All wall times are in seconds, simulated times too; a `Stat` says how often something was measured, its median with an
interval, and its spread. A file with the same `schema` has the same keys; new ones may come.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mjrun.bench.baseline import SCHEMA, Comparison
from mjrun.bench.frame_timing import Frame
from mjrun.bench.load_timing import Load
from mjrun.bench.machine import Machine
from mjrun.bench.output_timing import Whole
from mjrun.bench.statistics import Stat
from mjrun.bench.step_phases import Phase
from mjrun.bench.step_timing import Threads


@dataclass(frozen=True)
class ModelFacts:
    """Which model.

    Attributes:
      path: of its file; empty for one that was compiled elsewhere.
      sha256: of its compiled form, with all assets and overrides, but for the scan.
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


@dataclass(frozen=True)
class Options:
    """What was asked.

    Attributes:
      key: keyframe that it starts from.
      noise_std, noise_rate: of the stimulus, as `Bench` says it.
      steps, repeats: as asked; None when the budget decided.
      budget: wall time [s].
      settings: overrides, as they were given.
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
class Engine:
    """What takes the steps.

    Attributes:
      name: `c`, MuJoCo itself, or `warp`, MuJoCo Warp in single precision.
      version: of mujoco_warp and Warp; None of MuJoCo, whose version is that of the benchmark.
      device: `cpu`, or Warp's alias, such as `cuda:0`.
      device_name: what that calls itself.
      worlds: copies of the model that are stepped at once.
      nconmax, njmax: contacts and constraints of a world that there is room for; None where nobody said.
    """

    name: str
    version: str | None
    device: str
    device_name: str
    worlds: int
    nconmax: int | None
    njmax: int | None


@dataclass(frozen=True)
class Counts:
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
    """How good the motion is that was timed, without noise.

    Attributes:
      horizon: simulated time after which this is measured [s].
      energy_drift: potential and kinetic energy less those at the start [J]; the integrator's error only where
        nothing drives or brakes the model.
      reference: timestep of the run that it is compared with [s]; all else is as in the row.
      distance: root mean square of the difference of the positions, over all degrees of freedom [m and rad].
      failure: why there are no numbers; else None.
    """

    horizon: float
    energy_drift: float | None
    reference: float
    distance: float | None
    failure: str | None = None


@dataclass(frozen=True)
class Row:
    """A simulation: one point of the grid, or the only one.

    Attributes:
      point: settings of the grid.
      integrator, timestep: in force.
      steps, block: of one rollout, and those that are timed at once.
      step: wall time per step of one world, a sample for each rollout; `p5` and `p95` are of blocks of steps.
      steps_per_second, realtime_factor: of the median, of all worlds together.
      first_step: wall time of the first step of all worlds [s], in which `warp` compiles what it has not cached; None
        with `c`.
      counts: what a step consists of.
      phases: MuJoCo's own, timed in a rollout of their own, in which the timers themselves cost time; None where
        there are none.
      threads: independent copies.
      overflows: what `warp` had no room for, and what to raise, a sentence each.
      accuracy: if it was asked for.
      failure: why it could not be measured, such as an instability; else None.
    """

    point: Mapping[str, str]
    integrator: str
    timestep: float
    steps: int
    block: int
    step: Stat | None
    steps_per_second: float | None
    realtime_factor: float | None
    first_step: float | None
    counts: Counts | None
    phases: Phase | None
    threads: Sequence[Threads]
    overflows: Sequence[str]
    accuracy: Accuracy | None
    failure: str | None


@dataclass(frozen=True)
class BenchResult:
    """A benchmark.

    Attributes:
      schema: the form of this.
      mjrun, mujoco, numpy, python: versions.
      command: the command line.
      machine, load_after: what it ran on before it began, and the load average after it.
      engine: what took the steps.
      model, options: what was measured.
      load: getting the model; None for one that was compiled elsewhere.
      rows: simulations.
      frames: drawing, if it was asked for.
      whole: films and traces as a whole, if they were asked for.
      comparison: with a base, if there was one.
      notes: what is to be known of these figures.
      wall: wall time of it all.
    """

    mjrun: str
    mujoco: str
    numpy: str
    python: str
    command: str
    machine: Machine
    load_after: float | None
    engine: Engine
    model: ModelFacts
    options: Options
    load: Load | None
    rows: Sequence[Row]
    frames: Sequence[Frame]
    whole: Sequence[Whole]
    comparison: Comparison | None
    notes: Sequence[str]
    wall: float
    schema: str = SCHEMA
