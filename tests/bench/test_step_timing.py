"""Numbers of steps, rollouts and blocks."""

from pathlib import Path
from typing import Any

import mujoco
import pytest
from mujoco.batch import Batch

from mjrun.bench.block_timing import RolloutInputs
from mjrun.bench.step_timing import StepTimer, TimingBudget, rounded_down
from tests.bench.bench_clocks import MODEL, FakeClock, bench


def test_figures_are_exactly_those_of_the_clock(path: Path) -> None:
    result = bench(path).run(clock=FakeClock())
    (row,) = result.rows
    assert row.step is not None
    # A look at the clock costs a second, so every block is a single step of a second.
    assert (row.block, row.steps) == (1, 20)
    assert row.step.samples == [1.0] * 8
    assert (row.step.median, row.step.low, row.step.high, row.step.min) == (1.0, 1.0, 1.0, 1.0)
    assert (row.step.p5, row.step.p95, row.step.confidence) == (1.0, 1.0, 1 - 2 / 2**8)
    assert (row.steps_per_second, row.realtime_factor) == (1.0, 0.01)
    one, two = row.threads
    assert (one.threads, one.step, one.scaling) == (1, row.step, 1.0)
    # On two threads ten steps of both are timed by two looks: 20 steps a second.
    assert (two.threads, two.steps_per_second, two.scaling) == (2, pytest.approx(20), pytest.approx(20))
    assert two.realtime_factor == pytest.approx(0.2)
    assert result.load is not None
    assert result.load.first == 1.0
    assert result.load.parse is not None
    assert result.load.parse.samples == [1.0] * 3
    assert result.wall > 8 * 20


class WorkClock:
    """Advances by `cost` [s] for every step since the last reading."""

    def __init__(self, cost: float) -> None:
        self._cost, self.steps, self.now = cost, 0, 0.0

    def __call__(self) -> float:
        self.now, self.steps = self.now + self._cost * self.steps, 0
        return self.now


@pytest.mark.parametrize(
    # A budget of 3 s leaves 1.2 s for rollouts, of which there are 7 to 50.
    ("cost", "steps", "block", "repeats"),
    [(2**-20, 10_000, 2000, 50), (2**-15, 5000, 50, 7), (2**-10, 100, 2, 12), (1.0, 1, 1, 7)],
)
def test_the_budget_decides_how_many_steps_are_taken_how_often(
    cost: float, steps: int, block: int, repeats: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = WorkClock(cost)
    rollout = Batch.rollout

    def counted(self: Any, nstep: int, *arguments: Any, **settings: Any) -> Any:
        clock.steps += nstep
        return rollout(self, nstep, *arguments, **settings)

    monkeypatch.setattr(Batch, "rollout", counted)
    model = mujoco.MjModel.from_xml_string(MODEL)
    stepping = StepTimer(lambda count: RolloutInputs.of(model, mujoco.MjData(model)), TimingBudget(3.0), clock)
    stepping.warm_up()
    stepping.begin(stepping.steps)
    assert (stepping.steps, stepping.block, stepping.repeats) == (steps, block, repeats)
    for _ in range(6):
        stepping.rollout()
    assert stepping.step.samples == pytest.approx([cost] * 6)


@pytest.mark.parametrize(
    ("value", "most", "expected"),
    [(0.3, 10, 1), (1, 10, 1), (4.9, 100, 2), (5, 100, 5), (99, 100, 50), (100, 100, 100), (1e9, 33, 33), (40, 33, 33)],
)
def test_numbers_of_steps_are_round_and_do_not_follow_every_change_of_the_clock(
    value: float, most: int, expected: int
) -> None:
    assert rounded_down(value, most) == expected
