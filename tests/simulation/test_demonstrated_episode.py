"""Demonstrations as states and actions."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import h5py
import numpy as np
import pytest

import mjrun
from mjrun.errors import FileError, UsageError
from mjrun.simulation.demonstration import read_demonstration
from tests.demonstration_files import recorded_states, write_demonstrations


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write_demonstrations(tmp_path / "d.hdf5", {"demo_1": recorded_states(5, first=0.052)})


def change(path: Path, name: str, values: np.ndarray) -> None:
    with h5py.File(path, "a") as file:
        if f"data/demo_1/{name}" in file:
            del file[f"data/demo_1/{name}"]
        file[f"data/demo_1/{name}"] = values


def test_an_action_belongs_to_each_state(file: Path) -> None:
    actions = np.arange(10.0).reshape(5, 2)
    change(file, "actions", actions)
    change(file, "rewards", np.array([0, 0, 0, 0.5, 1]))
    made = read_demonstration(f"{file}:demo_1")
    np.testing.assert_array_equal(made.actions, actions)
    np.testing.assert_allclose(made.times, np.arange(5) / 20)
    assert (made.task, made.rate, made.success) == ("Lift", Fraction(20), True)
    assert made.steps(Fraction(2, 1000)) == [0, 25, 50, 75, 100]
    assert made.action_names == ["action_0", "action_1"]


def test_a_simulation_has_the_demonstration_that_it_replays(file: Path) -> None:
    simulation = mjrun.Simulation(str(file))
    assert simulation.demonstration
    assert simulation.demonstration.source == f"{file}:demo_1"
    assert (simulation.demonstration.rewards, simulation.demonstration.success) == (None, None)
    assert mjrun.Simulation(str(file), replay_rate=10).demonstration.rate == 10  # pyright: ignore[reportOptionalMemberAccess]
    assert mjrun.Simulation("scene:pendulum").demonstration is None


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("actions", np.zeros((4, 7)), r"d.hdf5:demo_1: its actions have the shape \(4, 7\), and its states \(5,\)"),
        ("actions", np.zeros((0, 7)), r"its actions have the shape \(0, 7\)"),
        ("actions", np.array(3.0), r"its actions have the shape \(\)"),
        ("actions", np.full((5, 7), np.nan), "its actions are not all finite"),
        ("rewards", np.zeros(6), r"its rewards have the shape \(6,\)"),
    ],
)
def test_numbers_that_do_not_fit_the_states_are_refused(
    file: Path, name: str, values: np.ndarray, message: str
) -> None:
    change(file, name, values)
    with pytest.raises(FileError, match=message):
        read_demonstration(f"{file}:demo_1")


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0], "has one state, and therefore no rate"),
        ([0, 0.05, 0.1, 0.25], "state 3 is 0.15 s after the one before, and others 0.05 s; a dataset has a constant"),
        ([0, 0, 0], "its times do not ascend; replay_rate replaces them"),
    ],
)
def test_states_that_are_not_evenly_spaced_have_no_rate(tmp_path: Path, times: list[float], message: str) -> None:
    states = recorded_states(len(times))
    states[:, 0] = times
    made = read_demonstration(write_demonstrations(tmp_path / "d.hdf5", {"demo": states}))
    with pytest.raises(UsageError) as caught:
        _ = made.rate
    assert message in caught.value.spelled(str)


def test_each_point_of_a_study_replays_the_demonstration_of_its_model(tmp_path: Path) -> None:
    path = write_demonstrations(tmp_path / "d.hdf5")
    simulation = mjrun.Simulation(f"{path}:demo_1")
    study = mjrun.sweep(
        simulation, vary=[("model", f"{path}:demo_1,{path}:demo_2")], metric=[("end", "last(time)")], jobs=1
    )
    np.testing.assert_allclose(study.table["end"], [0.2, 0.15])


def test_states_far_apart_have_an_exact_rate(file: Path) -> None:
    demonstration = read_demonstration(f"{file}:demo_1")
    slow = replace(demonstration, times=3000.0 * np.arange(len(demonstration.times)))
    assert slow.rate == Fraction(1, 3000)
