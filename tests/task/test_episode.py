"""Endings have codes; what held at control instants holds again in a replay."""

import tracemalloc
from contextlib import closing

import mujoco
import numpy as np
import pytest

from mjrun.physics.recorded_states import SPILL
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.simulation_loop import StateBuffer, Tap, run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from mjrun.task.episode import Actor, ControlInstants, Ending, EpisodeOver, EpisodeReplayStepper, recorded
from mjrun.task.single_world import SingleWorld, TaskStepper
from tests.task.test_single_world import MODEL, Wave, arm


@pytest.mark.parametrize(("kind", "terminated"), [("success", True), ("failure", True), ("timeout", False)])
def test_a_timeout_truncates_and_anything_else_terminates(kind, terminated: bool) -> None:
    assert Ending("end", kind).terminated is terminated


def test_the_end_of_an_episode_says_where_and_how() -> None:
    over = EpisodeOver(40, Ending("fallen", "failure"))
    assert (over.step, over.ending.name, str(over)) == (40, "fallen", "the episode ended at step 40: fallen")


def test_recorded_answers_and_failures_repeat_and_the_actor_continues() -> None:
    answers = iter([np.ones(1), ArithmeticError("once"), np.zeros(1)])

    def act(observation: np.ndarray) -> np.ndarray:
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def failing(actor: Actor) -> list[float]:
        first = actor(np.zeros(1))[0]
        with pytest.raises(ArithmeticError, match="once"):
            actor(np.zeros(1))
        return [first]

    record, repeat = recorded(act)
    assert failing(record) == failing(repeat) == [1]
    assert repeat(np.zeros(1)) == 0


def test_recorded_answers_repeat_bit_for_bit_in_little_memory() -> None:
    size, count = 512, 1000
    generators = [np.random.default_rng(3) for _ in range(2)]
    record, repeat = recorded(lambda _: generators[0].standard_normal(size))
    tracemalloc.start()
    try:
        for _ in range(count):
            record(np.zeros(1))
        for _ in range(count):
            assert repeat(np.zeros(1)).tobytes() == generators[1].standard_normal(size).tobytes()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8 * size * count / 2 + SPILL


def test_what_held_at_control_instants_holds_again() -> None:
    stepper, instants, seen = TaskStepper(SingleWorld(arm()), Wave(), 3), ControlInstants(), []
    with closing(StateBuffer(MODEL)) as states:
        taps = [
            Tap(range(31), states.record),
            Tap(range(31), instants.record),
            Tap(range(31), lambda _: seen.append(stepper.now())),
        ]
        run_with_taps(stepper, taps, 30)
        replay = instants.replay(MODEL, states)
        assert isinstance(replay, EpisodeReplayStepper)
        assert (replay.periods, replay.names) == (7, stepper.names)
        for step in (0, 3, 4, 17, 30):
            replay.advance(step)
            assert replay.now() is seen[step]
            np.testing.assert_array_equal(replay.state(), states.state(step))


def test_other_simulations_are_replayed_as_ever() -> None:
    stepper, instants = PhysicsStepper(MODEL, mujoco.MjData(MODEL)), ControlInstants()
    with closing(StateBuffer(MODEL)) as states:
        run_with_taps(stepper, [Tap(range(3), states.record), Tap(range(3), instants.record)], 2)
        assert type(instants.replay(MODEL, states)) is ReplayStepper
