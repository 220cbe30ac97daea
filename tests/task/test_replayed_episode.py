"""An episode gone through once more has what held at every step."""

from contextlib import closing

import mujoco
import numpy as np

from mjrun.physics.observe import Tap, observe
from mjrun.physics.replay import ReplayStepper
from mjrun.physics.state_buffer import StateBuffer
from mjrun.physics.stepper import PhysicsStepper
from mjrun.task.replayed_episode import ControlInstants, ReplayedEpisode
from mjrun.task.task_stepper import TaskStepper
from mjrun.task.worlds import TaskWorlds
from tests.task.test_task_stepper import MODEL, Wave, arm


def test_what_held_at_control_instants_holds_again() -> None:
    stepper, instants, seen = TaskStepper(TaskWorlds(arm(), 1), Wave(), 3), ControlInstants(), []
    with closing(StateBuffer(MODEL)) as states:
        taps = [
            Tap(range(31), lambda stepper: stepper.state(), states.append),
            Tap(range(31), instants.take, lambda _: None),
            Tap(range(31), lambda _: stepper.now(), seen.append),
        ]
        observe(stepper, taps, 30)
        replay = instants.replay(MODEL, states)
        assert isinstance(replay, ReplayedEpisode)
        assert (replay.periods, replay.names) == (7, stepper.names)
        for step in (0, 3, 4, 17, 30):
            replay.advance(step)
            assert replay.now() is seen[step]
            np.testing.assert_array_equal(replay.state(), states.state(step))


def test_other_simulations_are_replayed_as_ever() -> None:
    stepper, instants = PhysicsStepper(MODEL, mujoco.MjData(MODEL)), ControlInstants()
    with closing(StateBuffer(MODEL)) as states:
        observe(stepper, [Tap(range(3), lambda s: s.state(), states.append), Tap(range(3), instants.take, id)], 2)
        assert type(instants.replay(MODEL, states)) is ReplayStepper
