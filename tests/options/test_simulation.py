"""Options of simulations: what excludes what, and their values."""

from fractions import Fraction

import numpy as np
import pytest

from mjrun.errors import BadValueError, UsageError
from mjrun.options.option import options_of
from mjrun.options.simulation import DRIVERS, PHYSICS, START, SimulationOptions

VALUES = {
    "key": "home",
    "qpos": {"hip": 1},
    "qvel": {"hip": 1},
    "ctrl": {"motor": 1},
    "ctrl_from": "a.csv",
    "ctrl_noise": 0.1,
    "controller": print,
    "push": "torso=1/0/0@0+1",
    "perturb": 0.1,
}


def test_what_a_replay_excludes_is_known() -> None:
    assert {*DRIVERS, *PHYSICS, *START} == set(VALUES) <= {each.name for each in options_of(SimulationOptions)}


@pytest.mark.parametrize("name", [*DRIVERS, *PHYSICS])
def test_a_replay_of_states_has_no_physics(name: str) -> None:
    with pytest.raises(UsageError, match=f"^replay and {name} exclude each other") as error:
        SimulationOptions(replay="a.npz", **{name: VALUES[name]})  # type: ignore[arg-type]
    assert error.value.path == (name,)
    assert SimulationOptions(**{name: VALUES[name]}).replay is None  # type: ignore[arg-type]


@pytest.mark.parametrize("name", VALUES)
def test_a_replay_of_controls_has_physics_and_no_other_driver(name: str) -> None:
    given = {"replay": "a.npz", "replay_mode": "controls", name: VALUES[name]}
    if name not in DRIVERS:
        SimulationOptions(**given)  # type: ignore[arg-type]
        return
    with pytest.raises(UsageError, match=f"^replay and {name} exclude each other: the replayed file drives"):
        SimulationOptions(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", START)
def test_a_table_may_lack_what_the_start_says(name: str) -> None:
    SimulationOptions(replay="a.csv", **{name: VALUES[name]})  # type: ignore[arg-type]


def test_values_are_exact_and_immutable() -> None:
    options = SimulationOptions(duration=0.1, qpos={"hip": 0.3, "root": np.arange(7.0)}, key=2)  # type: ignore[dict-item]
    assert options.duration == Fraction(1, 10)
    assert options.qpos == {"hip": (0.3,), "root": (0, 1, 2, 3, 4, 5, 6)}
    assert options.key == "2"


@pytest.mark.parametrize("value", [0, -1, float("nan"), float("inf"), "long"])
def test_a_duration_is_positive(value: object) -> None:
    with pytest.raises(BadValueError, match=r"^duration: .* is not a positive number"):
        SimulationOptions(duration=value)  # type: ignore[arg-type]
