"""Theorems about what is seen in episodes of a task."""

from pathlib import Path

import numpy as np

from mjrun.check.task_episodes import COUNT, NotFinite, watch
from mjrun.document.task import read_task
from mjrun.policy.load import load_policy
from mjrun.task.worlds import TaskWorlds
from tests.check.tasks import HEAD, SLIDER


def worlds(text: str = "", head: str = HEAD) -> TaskWorlds:
    Path("slider.xml").write_text(SLIDER)
    Path("t.yaml").write_text(head + text)
    return TaskWorlds(read_task("t.yaml"), COUNT, threads=1)


def test_episodes_are_played_to_their_ends() -> None:
    assert watch(worlds(), load_policy("random")).periods == COUNT * 50
    ended = watch(worlds("terminations: {late: {when: time > 0.19, as: success}}"), load_policy("random"))
    assert ended.periods == COUNT * 10


def test_what_stays_the_same_depends_on_what_acts() -> None:
    text = HEAD.replace("duration: 1", "duration: 1\nset: {opt.gravity: [0, 0, 0]}")
    assert watch(worlds(head=text), load_policy("random")).constant == []
    still = watch(worlds(head=text), load_policy("zero"))
    assert still.constant == [("place", "place"), ("speed", "speed")]
    assert still.acting == "zero"


def test_the_first_value_that_is_not_finite_is_kept_with_its_instant() -> None:
    """The logarithm fails where the position, which a bare simulation gives as well, is no longer positive."""
    made = worlds("rewards: {bad: log(qpos/rail + 0.01), good: 1}")
    made.reset(range(COUNT))
    period = 0
    while (made.step(np.zeros((COUNT, 1))).observations[:, 0] > -0.01).all():
        period += 1
    (fault,) = watch(made, load_policy("zero")).not_finite
    assert (fault.kind, fault.name, fault.time, fault.seed) == ("rewards", "bad", (period + 1) * 0.02, 0)
    assert np.isnan(fault.value)
    assert isinstance(fault, NotFinite)


def test_terminations_at_the_start_are_by_their_names_and_seeds() -> None:
    text = "reset: {set: {qpos/rail: 'uniform(-1, 1)'}}\nterminations: {far: {when: qpos/rail > 0, as: failure}}"
    made = worlds(text)
    positive = np.flatnonzero(made.reset(range(COUNT))[:, 0] > 0).tolist()
    assert watch(made, load_policy("zero")).ended_at_start == {"far": positive}
