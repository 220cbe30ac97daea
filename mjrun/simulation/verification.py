"""Verification of a recording: its physics stepped again, and what differs."""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

from mjrun.errors import FailedStepError, UsageError, clean, concerning, listing, option
from mjrun.formats.input_file import cut
from mjrun.formats.recording import RecordingReader, is_recording
from mjrun.model import state
from mjrun.model.fingerprint import physics_fingerprint
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.physics.replay import RecordedStates, ReplayStepper
from mjrun.probe.fields import state_columns
from mjrun.reporter import Reporter, WarningReporter
from mjrun.simulation.manifest import origin
from mjrun.simulation.simulation import Simulation

SCHEMA = "mjrun-verify-1"
VERSIONS = {"mjrun": "mjrun", "mujoco": "MuJoCo", "machine": "machine"}  # what decides the bits
OVERRIDES = ("set", "timestep", "integrator")
THINNED = (
    "the recording does not have every step: inputs that changed between two of its states are not in it, "
    "and would make them differ"
)
UNEXPLAINED = (
    "versions, machine, model and overrides are those of the recording: this state, or the inputs of the one before, "
    "were changed later"
)

PROGRESS = 1000  # states from one report to the next


@dataclass(frozen=True)
class FirstDifference:
    """Where physics leaves the recorded states.

    Attributes:
      index, step: of the first recorded state that differs.
      recorded, stepped: the integration states `(nstate,)` there; inputs are the recorded ones in both.
    """

    index: int
    step: int
    recorded: np.ndarray
    stepped: np.ndarray


@dataclass(frozen=True)
class FieldDifference:
    """A field that differs, by that of its numbers which differs most.

    Attributes:
      field: of MjData, such as `qpos`.
      name: of the number, as columns are named: `qpos/left_knee`, `qvel/root/wz`.
      recorded, stepped: its values in the recording, and stepped again; None if that is not finite.
      count: how many numbers of the field differ.
    """

    field: str
    name: str
    recorded: float
    stepped: float | None
    count: int


@dataclass(frozen=True)
class VerificationResult:
    """Whether a recording is what its physics makes.

    Attributes:
      path: of the recording.
      agrees: whether every compared state is the same, bit for bit.
      states: how many were compared, the first included, up to the first that differs.
      steps: the step of the last of them.
      time: simulated time [s] there.
      differences: of that state, where it differs, in the order of the state.
      origins: what is not as it was when the recording was made, in sentences; what is not known is left out.
      schema: of this document.
    """

    path: str
    agrees: bool
    states: int
    steps: int
    time: float
    differences: Sequence[FieldDifference]
    origins: Sequence[str]
    schema: str = SCHEMA


def verify(simulation: Simulation, reporter: Reporter | None = None) -> VerificationResult:
    """Steps from the first state of a recording with its inputs, and compares every state that it holds.

    Args:
      simulation: with the recording as `replay`; a duration or a number of steps ends the comparison earlier.

    Raises:
      UsageError: there is no recording, it is of another model, or not as long.
      FileError: it cannot be read.
      FailedStepError: MuJoCo gave up.
    """
    reporter = reporter or WarningReporter()
    if simulation.replay is None:
        raise UsageError(f"{option('verify')} compares a recording with its physics: name it by {option('replay')}")
    if not is_recording(Path(simulation.replay)):
        raise UsageError(
            f"{option('verify')} steps a recording again, and {clean(simulation.replay)} is none\n"
            f"{option('recording')} FILE.npz makes one"
        )
    with collected_warnings(), without_timers(), RecordingReader(simulation.replay) as recording:
        model = simulation.load()
        timeline = simulation.timeline(model)
        with concerning("replay"):
            ReplayStepper(model, recording, recording.facts.get("sizes")).require([timeline.steps])
        last = int(np.searchsorted(recording.steps, timeline.steps))

        def report(done: int) -> None:
            reporter.progress("verifying", done, last)

        difference = first_difference(model, recording, last, report)
        index = last if difference is None else difference.index
        step = int(recording.steps[index])
        now = origin(simulation, simulation, model, timeline)
        origins = [*_origins(recording.facts, {**now}, model)]
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

    Inputs are those recorded: controls, applied forces, mocap poses, active equalities and user data. Between recorded
    states that are further apart than a step they stay what they are at the first of the two.

    Args:
      progress: told from time to time how many states agree.

    Returns:
      Where they differ first; None if they do not.

    Raises:
      FailedStepError: MuJoCo gave up.
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


def _field_differences(model: mujoco.MjModel, difference: FirstDifference) -> list[FieldDifference]:
    names = state_columns(model)
    differences: list[FieldDifference] = []
    for field, part in state.fields(state.sizes(model)).items():
        recorded, stepped = difference.recorded[part], difference.stepped[part]
        differing = recorded.view(np.int64) != stepped.view(np.int64)
        if not differing.any():
            continue
        apart: np.ndarray = np.where(differing, np.nan_to_num(abs(recorded - stepped), nan=np.inf), -1)
        most = int(apart.argmax())
        again = float(stepped[most]) if np.isfinite(stepped[most]) else None
        name, count = names[int(part.start) + most], int(differing.sum())
        differences.append(FieldDifference(field, name, float(recorded[most]), again, count))
    return differences


def _origins(recorded: Mapping[str, object], now: Mapping[str, object], model: mujoco.MjModel) -> Iterator[str]:
    """What differs between what made the recording and what is here. A recording may say anything."""
    if recorded.get("physics", physics := physics_fingerprint(model)) != physics:
        yield f"the physics of the model is not that of the recording, which was made from {_model(recorded)}"
    for key, name in VERSIONS.items():
        there, here = recorded.get(key, now[key]), now[key]
        if there != here:
            yield f"{name}: recorded with {clean(cut(str(there)))}, verified with {clean(str(here))}"
    there, here = _overrides(recorded.get("options")), _overrides({"simulation": now["options"]})
    if there is not None and here is not None and there != here:
        yield f"overrides: recorded with {listing(there) or 'none'}, verified with {listing(here) or 'none'}"


def _model(recorded: Mapping[str, object]) -> str:
    model = recorded.get("model")
    path = cast("Mapping[str, object]", model).get("path") if isinstance(model, Mapping) else None
    return clean(str(path)) if path else "a compiled model"


def _overrides(options: object) -> list[str] | None:
    """The overrides in the `options` of a manifest; None if they are not what a manifest has."""
    try:
        simulation = cast("Any", options)["simulation"]
        texts = [f"{path}={value}" for path, value in simulation["set"]]
        others = [f"{name}={simulation[name]}" for name in OVERRIDES[1:] if simulation[name] is not None]
        return [*texts, *others]
    except (KeyError, TypeError, ValueError):
        return None
