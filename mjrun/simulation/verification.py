"""The verification of a recording: its physics is stepped again and compared with its states."""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import FailedStepError, UsageError, clean, concerning, listing, option, shortened
from mjrun.formats.recording import RecordingReader, is_recording
from mjrun.model import state
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.model.source import physics_fingerprint
from mjrun.physics.recorded_states import RecordedStates
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.probe.fields import state_columns
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.origin import origin
from mjrun.simulation.simulation import Simulation, require_whole

SCHEMA = "mjrun-verify-1"
VERSIONS = {"mjrun": "mjrun", "mujoco": "MuJoCo", "machine": "machine"}  # which determine the bits
OVERRIDES = ("set", "timestep", "integrator")
THINNED = (
    "the recording does not contain every step: inputs that changed between two of its states are missing, and would "
    "make them differ"
)
UNEXPLAINED = (
    "versions, machine, model and overrides are those of the recording: this state, or the inputs of the one before, "
    "were changed later"
)

PROGRESS = 1000  # states between two reports of progress


@dataclass(frozen=True)
class FirstDifference:
    """The first recorded state that physics does not reproduce.

    Attributes:
      index, step: index and step of the state.
      recorded, stepped: recorded and stepped integration states `(nstate,)`; both contain the recorded inputs.
    """

    index: int
    step: int
    recorded: np.ndarray
    stepped: np.ndarray


@dataclass(frozen=True)
class StateDifference:
    """A field of the state that differs, represented by the number that differs most.

    Attributes:
      field: field of MjData, such as `qpos`.
      name: column of the number: `qpos/left_knee`, `qvel/root/wz`.
      recorded, stepped: recorded and stepped values; None if stepping gives a value that is not finite.
      count: number of values of the field that differ.
    """

    field: str
    name: str
    recorded: float
    stepped: float | None
    count: int


@dataclass(frozen=True)
class VerificationResult:
    """The result of a verification.

    Attributes:
      path: path of the recording.
      agrees: whether all compared states are identical, bit for bit.
      states: number of compared states, from the first to the last or to the first that differs.
      steps: step of the last compared state.
      time: simulated time of that state [s].
      differences: differences of that state, in the order of its fields.
      origins: sentences on what has changed since the recording was made; unknown origins are left out.
      schema: name of this schema.
    """

    path: str
    agrees: bool
    states: int
    steps: int
    time: float
    differences: Sequence[StateDifference]
    origins: Sequence[str]
    schema: str = SCHEMA


def verify(simulation: Simulation, reporter: Reporter | None = None) -> VerificationResult:
    """Steps from the first state of a recording with its inputs, and compares all of its states.

    Args:
      simulation: simulation with the recording as `replay`; its duration or number of steps limits the comparison.

    Raises:
      UsageError: the simulation replays no recording, or one of another model, or one that is too short.
      FileError: the recording cannot be read.
      FailedStepError: MuJoCo could not complete a step.
    """
    reporter = reporter or PythonApiReporter()
    require_whole(simulation, f"a verification, {option('verify')}")
    if simulation.replay is None:
        raise UsageError(f"{option('verify')} requires a recording: name it with {option('replay')}")
    if not is_recording(Path(simulation.replay)):
        raise UsageError(
            f"{option('verify')} requires a recording, and {clean(simulation.replay)} is not one\n"
            f"{option('recording')} FILE.npz makes one"
        )
    with collected_warnings(), without_timers(), RecordingReader(simulation.replay) as recording:
        model = simulation.load()
        timeline = simulation.timeline(model)
        with concerning("replay"):
            ReplayStepper(model, recording, recording.facts).require([timeline.steps])
        last = int(np.searchsorted(recording.steps, timeline.steps))

        def report(done: int) -> None:
            reporter.progress("verifying", done, last)

        difference = first_difference(model, recording, last, report)
        index = last if difference is None else difference.index
        step = int(recording.steps[index])
        now = origin(simulation, simulation, model, timeline)
        origins = [*_changes(recording.facts, {**now}, model)]
        if difference is not None and index < step:
            origins.append(THINNED)
        elif difference is not None and not origins:
            origins.append(UNEXPLAINED)
        return VerificationResult(
            path=simulation.replay,
            agrees=difference is None,
            states=index + 1,
            steps=step,
            time=float(timeline.time(step)),
            differences=[] if difference is None else _field_differences(model, difference),
            origins=origins,
        )


def first_difference(
    model: mujoco.MjModel, states: RecordedStates, last: int, progress: Callable[[int], None] = lambda done: None
) -> FirstDifference | None:
    """Steps from the first of `states` up to number `last`, and compares every recorded state, bit for bit.

    Inputs are the recorded ones: controls, applied forces, mocap poses, active equalities and user data. Between states
    that are several steps apart, they hold the values of the first of the two.

    Args:
      progress: function that is called with the number of identical states from time to time.

    Returns:
      The first difference; None if all states are identical.

    Raises:
      FailedStepError: MuJoCo could not complete a step.
    """
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    inputs = state.part(model, state.INPUTS)
    data = mujoco.MjData(model)
    steps = states.steps

    recorded = states.state(0)
    state.restore(model, data, recorded)
    for index in range(1, last + 1):
        try:
            mujoco.mj_step(model, data, nstep=int(steps[index] - steps[index - 1]))
        except mujoco.FatalError as error:
            raise FailedStepError(int(steps[index - 1]), data.time, str(error)) from None
        recorded = states.state(index)
        state.restore(model, data, recorded[inputs], state.INPUTS)
        stepped = state.save(model, data)
        if stepped.tobytes() != recorded.tobytes():
            return FirstDifference(index, int(steps[index]), recorded, stepped)
        if index % PROGRESS == 0:
            progress(index)
    return None


def _field_differences(model: mujoco.MjModel, difference: FirstDifference) -> list[StateDifference]:
    names = state_columns(model)
    differences = list[StateDifference]()
    for field, part in state.fields(state.sizes(model)).items():
        recorded, stepped = difference.recorded[part], difference.stepped[part]
        differing = recorded.view(np.int64) != stepped.view(np.int64)
        if not differing.any():
            continue
        apart: np.ndarray = np.where(differing, np.nan_to_num(abs(recorded - stepped), nan=np.inf), -1)
        most = int(apart.argmax())
        again = float(stepped[most]) if np.isfinite(stepped[most]) else None
        name, count = names[int(part.start) + most], int(differing.sum())
        differences.append(StateDifference(field, name, float(recorded[most]), again, count))
    return differences


def _changes(recorded: Mapping[str, object], now: Mapping[str, object], model: mujoco.MjModel) -> Iterator[str]:
    """Yields the differences between the origin of the recording and this one. Facts of a recording are untrusted."""
    if recorded.get("physics", physics := physics_fingerprint(model)) != physics:
        yield f"the physics of the model is not that of the recording, which was made from {_model(recorded)}"
    for key, name in VERSIONS.items():
        there, here = recorded.get(key, now[key]), now[key]
        if there != here:
            yield f"{name}: recorded with {clean(shortened(str(there)))}, verified with {clean(str(here))}"
    there, here = _overrides(recorded.get("options")), _overrides({"simulation": now["options"]})
    if there is not None and here is not None and there != here:
        yield f"overrides: recorded with {listing(there) or 'none'}, verified with {listing(here) or 'none'}"


def _model(recorded: Mapping[str, object]) -> str:
    model = recorded.get("model")
    path = cast("Mapping[str, object]", model).get("path") if isinstance(model, Mapping) else None
    return clean(str(path)) if path else "a compiled model"


def _overrides(options: object) -> list[str] | None:
    """Returns the overrides in the `options` of a manifest; None if they are malformed."""
    try:
        simulation = cast("Any", options)["simulation"]
        texts = [f"{path}={value}" for path, value in simulation["set"]]
        others = [f"{name}={simulation[name]}" for name in OVERRIDES[1:] if simulation[name] is not None]
        return [*texts, *others]
    except (KeyError, TypeError, ValueError):
        return None
