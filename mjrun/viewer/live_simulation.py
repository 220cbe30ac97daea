"""A simulation that users perturb, edit and reset while it runs."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np

from mjrun.errors import SimulationError
from mjrun.formats.recording import RecordingWriter
from mjrun.interruption import uninterrupted
from mjrun.model import state
from mjrun.physics.recorded_states import ReplayStepper
from mjrun.physics.stepper import EditableStepper, Stepper
from mjrun.reporter import Reporter
from mjrun.simulation.episode import EpisodeResult
from mjrun.simulation.simulation import Simulation
from mjrun.task.episode import Ending, EpisodeStepper
from mjrun.viewer.window import Edit, Pull, UnsupportedAction


class SessionRecording:
    """A recording that can be restarted; only the last one is published.

    Args:
      path: a .npz file, whose location is checked to be writable at once.
      size: numbers in a state.
      facts: facts about its origin; `steps`, of the simulation, is added at the end.

    Raises:
      UsageError: the path has another suffix.
      FileError: the file cannot be written.
    """

    def __init__(self, path: str, size: int, facts: Mapping[str, object]) -> None:
        self.path = path
        self._size, self._facts = size, dict(facts)
        self._writer = RecordingWriter(path, size, self._facts)

    @property
    def count(self) -> int:
        """The number of recorded states."""
        return self._writer.count

    def write(self, step: int, state: np.ndarray) -> None:
        """Adds the state `(size,)` at `step`, unless already recorded: 0 at first, then increasing."""
        if step > self._writer.last:
            self._writer.write(step, state)

    def restart(self) -> None:
        """Discards all states."""
        if self.count:
            with uninterrupted():
                self._writer.close()
                self._writer = RecordingWriter(self.path, self._size, self._facts)

    def publish(self) -> list[Path]:
        """Publishes the recording if it holds any state."""
        if not self.count:
            return []
        self._facts["steps"] = self._writer.last
        return self._writer.publish()

    def __enter__(self) -> "SessionRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()


class LiveSimulation:
    """An interactive simulation: users can perturb bodies, set controls and positions, and reset it.

    Without interaction it is bit for bit the simulation of every other command. A recording always holds true physics:
    the state of each step from time 0, with the inputs that act from then on. Forces of the mouse and controls are such
    inputs; positions set by hand are not, and are refused during a recording.

    Args:
      recording: receives the states of all steps, if set.

    Attributes:
      last: the last step; None if there is no end.
      ends_by_itself: whether the user set its duration.
      failure: the error that prevents further steps, if any.

    Raises:
      UsageError: the replayed recording lacks steps.
    """

    def __init__(
        self,
        simulation: Simulation,
        model: mujoco.MjModel,
        reporter: Reporter,
        recording: SessionRecording | None = None,
    ) -> None:
        self._simulation, self._model, self._reporter, self._recording = simulation, model, reporter, recording
        self._layout = state.fields(state.sizes(model))
        self._is_state = np.ones(state.size(model), bool)  # rather than an input
        for field in self._layout.keys() & INPUTS:
            self._is_state[self._layout[field]] = False
        self._reported: set[str] = set()
        self.ends_by_itself = simulation.duration is not None or simulation.steps is not None
        has_end = self.ends_by_itself or simulation.replay is not None  # an episode ends when it does
        self.last = simulation.timeline(model).steps if has_end else None
        self.reset()

    def reset(self, key: int | None = None) -> None:
        """Restarts from time 0, at the simulation's start or at the keyframe with this index."""
        simulation = self._simulation
        if key is not None and simulation.policy is not None:
            self.refuse(EPISODE)
        elif key is not None and simulation.replay is None:
            simulation = replace(simulation, key=self._model.key(key).name or str(key))
        self._stepper: Stepper = simulation.stepper(self._model)
        if isinstance(self._stepper, ReplayStepper) and self.last is not None:
            self._stepper.require(range(self.last + 1))
        self._pull: np.ndarray | None = None
        self.failure: SimulationError | None = None
        if self._recording:
            self._recording.restart()

    @property
    def model(self) -> mujoco.MjModel:
        """The model that is stepped."""
        return self._stepper.model

    @property
    def step(self) -> int:
        """The current step."""
        return self._stepper.step

    @property
    def is_over(self) -> bool:
        """True if there is no next step."""
        return self.failure is not None or self.step == self.last or (self.ending is not None and self.last is None)

    @property
    def ending(self) -> Ending | None:
        """The ending of the policy's episode, if it has ended."""
        return self._stepper.now().ending if isinstance(self._stepper, EpisodeStepper) else None

    @property
    def episode(self) -> EpisodeResult | None:
        """The result of the policy's episode so far; None if there is no policy."""
        episode, stepper = self._simulation.episode, self._stepper
        return episode.result(stepper) if episode and isinstance(stepper, EpisodeStepper) else None

    def instant(self) -> mujoco.MjData:
        """Returns an MjData in which every field belongs to the step; not to be stored or modified."""
        return self._stepper.instant()

    def take_step(self) -> None:
        """Takes a step unless the simulation is over; an error that prevents it becomes the `failure`."""
        if self.is_over:
            return
        try:
            if isinstance(self._stepper, EditableStepper) and self._pull is not None:
                self._take_step_under(self._stepper, self._pull)
            else:
                self.record_state()
                self._stepper.advance(self.step + 1)
        except SimulationError as error:
            self.failure = error

    def pull(self, action: Pull) -> None:
        """Applies the forces of the mouse to bodies from this step on."""
        if action.forces.any() and not isinstance(self._stepper, EditableStepper):
            self._refuse_hands()
            return
        self._pull = action.forces if action.forces.any() else None

    def edit(self, action: Edit) -> None:
        """Applies an edit, if allowed."""
        if not isinstance(self._stepper, EditableStepper):
            self._refuse_hands()
        elif self._recording and (action.changed & self._is_state).any():
            self.refuse(RECORDED)
        else:
            values = self._stepper.state()
            values[action.changed] = action.state[action.changed]
            self._stepper.edit(values, state.STATE)

    def refuse(self, action: UnsupportedAction) -> None:
        """Reports an unsupported action, once."""
        if action.what not in self._reported:
            self._reported.add(action.what)
            self._reporter.note(action.what)

    def _refuse_hands(self) -> None:
        self.refuse(REPLAY if isinstance(self._stepper, ReplayStepper) else ENVIRONMENT)

    def record_state(self) -> None:
        """Adds the current state to the recording, if any."""
        if self._recording:
            self._recording.write(self.step, self._stepper.state())

    def _take_step_under(self, stepper: EditableStepper, pull: np.ndarray) -> None:
        """Takes a step with the forces of the mouse added to the others, and removes them afterwards."""
        spec, where = state.APPLIED_FORCES, self._layout["xfrc_applied"]
        own = stepper.state()[where]
        applied = own + pull.ravel()
        stepper.edit(applied, spec)
        self.record_state()
        try:
            stepper.advance(self.step + 1)
        finally:
            now = stepper.state()[where]  # a controller or a push may have changed some of them on arrival
            stepper.edit(np.where(now == applied, own, now), spec)


# Fields of MjData that are set from outside and affect the state.
INPUTS = {"ctrl", "qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat", "userdata"}
REPLAY = UnsupportedAction("a replay shows recorded states: bodies cannot be pulled or edited")
ENVIRONMENT = UnsupportedAction("an environment steps itself: bodies cannot be pulled or edited")
EPISODE = UnsupportedAction("an episode of a policy starts as its task defines, not at a keyframe")
RECORDED = UnsupportedAction(
    "positions and velocities cannot be edited during a recording, which holds only physics: "
    "pull bodies or set controls instead"
)
