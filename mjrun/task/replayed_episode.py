"""An episode gone through once more, from the states of its steps and what held at its control instants."""

from collections.abc import Sequence

import mujoco

from mjrun.physics.replay import RecordedStates, ReplayStepper
from mjrun.physics.stepper import Stepper
from mjrun.task.episode import ControlInstant, EpisodeNames, EpisodeStepper


class ReplayedEpisode(ReplayStepper):
    """Recorded states, with what held at each of the control instants among them."""

    def __init__(
        self, model: mujoco.MjModel, states: RecordedStates, instants: Sequence[ControlInstant], of: EpisodeStepper
    ) -> None:
        super().__init__(model, states)
        self.names: EpisodeNames = of.names
        self.control_steps, self.periods = of.control_steps, of.periods
        self._instants = instants

    def now(self) -> ControlInstant:
        """What held at the last control instant."""
        return self._instants[self.step // self.control_steps]


class ControlInstants:
    """What held at the control instants of an episode, while it is stepped through; of other simulations, nothing."""

    def __init__(self) -> None:
        self._instants: list[ControlInstant] = []
        self._stepper: EpisodeStepper | None = None

    def take(self, stepper: Stepper) -> None:
        """Takes note of where `stepper` stands; to be called at every step."""
        if isinstance(stepper, EpisodeStepper) and stepper.step == len(self._instants) * stepper.control_steps:
            self._stepper = stepper
            self._instants.append(stepper.now())

    def replay(self, model: mujoco.MjModel, states: RecordedStates) -> ReplayStepper:
        """Goes through the recorded `states` of all steps once more."""
        if self._stepper is None:
            return ReplayStepper(model, states)
        return ReplayedEpisode(model, states, self._instants, self._stepper)
