"""Commands at control instants, from each of their sources."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.task.random_streams import COMMANDS, CommandSignals, stream
from mjrun.task.task import Command

DT = Fraction(1, 10)


def signals(count: int = 1, **commands: Command) -> CommandSignals:
    return CommandSignals(commands, DT, 10, count)


def values(made: CommandSignals) -> np.ndarray:
    """At all instants of the first world."""
    instants = np.arange(11)
    return made.at(np.zeros(11, int), instants)


def test_constants_and_schedules_hold() -> None:
    made = signals(goal=Command(constant=[-1, 4]), speed=Command(schedule=[[0, 1], [0.3, 2], [0.75, 3]]))
    assert made.names == ["goal/0", "goal/1", "speed"]
    assert made.slices == {"goal": slice(0, 2), "speed": slice(2, 3)}
    assert values(made)[:, :2].tolist() == [[-1, 4]] * 11
    assert values(made)[:, 2].tolist() == [1] * 3 + [2] * 5 + [3] * 3


@pytest.mark.parametrize("interpolation", ["hold", "linear"])
def test_tables_are_as_numpy_interpolates_them(tmp_path: Path, interpolation: str) -> None:
    file = tmp_path / "goals.csv"
    file.write_text("time,x,y\n0,1,5\n0.25,2,6\n0.5,4,7\n")
    made = values(signals(goal=Command(table=file, interpolation=interpolation)))
    times = np.arange(11) / 10
    if interpolation == "linear":
        np.testing.assert_allclose(made[:, 0], np.interp(times, [0, 0.25, 0.5], [1, 2, 4]))
    else:
        assert made[:, 1].tolist() == [5] * 3 + [6] * 2 + [7] * 6


def test_random_commands_are_of_the_seed_and_drawn_anew_when_they_should() -> None:
    made = signals(3, goal=Command(random="uniform(-1, 1)", size=2, every=0.3), side=Command(random="choice(-1, 1)"))
    for world, seed in enumerate((4, 5, 6)):
        made.begin(world, seed)
    worlds, instants = np.array([1, 0, 1, 1]), np.array([0, 2, 3, 10])
    generator = stream(5, COMMANDS)
    goal = np.stack([generator.uniform(-1, 1, 4) for _ in range(2)], axis=1)
    at = made.at(worlds, instants)
    np.testing.assert_array_equal(at[[0, 2, 3], :2], goal[[0, 1, 3]])
    assert set(at[:, 2]) <= {-1, 1}
    assert at[0, 2] == at[3, 2]


@pytest.mark.parametrize(
    ("content", "message"),
    [("t,x\n0,1\n", "a column time"), ("time,x\n1,1\n", "begins at 1 s"), ("time,x\n0,nan\n", "x is nan")],
)
def test_tables_that_cannot_be_used_are_refused(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "goals.csv").write_text(content)
    with pytest.raises(UsageError, match=message) as caught:
        signals(goal=Command(table=tmp_path / "goals.csv"))
    assert caught.value.path == ("commands", "goal", "table")


def test_new_values_come_at_control_instants() -> None:
    with pytest.raises(UsageError, match="is not a whole number of control periods") as caught:
        signals(goal=Command(random="uniform(0, 1)", every=0.25))
    assert caught.value.path == ("commands", "goal", "every")
