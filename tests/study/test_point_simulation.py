"""The simulation of a point is the one that a command line with its values describes."""

from fractions import Fraction
from pathlib import Path

import pytest

from mjrun.errors import BadValueError, UnknownNameError
from mjrun.simulation.simulation import Simulation
from mjrun.study.point_simulation import simulation_at
from tests.study.models import PENDULUM


@pytest.fixture
def base(tmp_path: Path) -> Simulation:
    path = tmp_path / "pendulum.xml"
    path.write_text(PENDULUM)
    return Simulation(str(path), qpos={"hinge": 0.1}, set={"opt.gravity": "0,0,-5"})


def test_values_replace_options_and_join_names_and_overrides(base: Simulation) -> None:
    names = ("timestep", "seed", "qpos/hinge", "ctrl/motor", "geom/bob.size[0]", "integrator", "steps")
    point = simulation_at(base, names, ("0.005", "3", "0.7", "2", "0.2", "rk4", "7"))
    expected = Simulation(
        base.model, timestep=Fraction("0.005"), seed=3, qpos={"hinge": 0.7}, ctrl={"motor": 2},
        integrator="rk4", steps=7,
        set={"opt.gravity": "0,0,-5", "geom/bob.size[0]": "0.2"},
    )  # fmt: skip
    assert point == expected


def test_the_model_itself_may_vary(base: Simulation) -> None:
    assert simulation_at(base, ("model",), ("other.xml",)).source.text == "other.xml"


@pytest.mark.parametrize(("name", "near"), [("timestp", "timestep"), ("qpos", "qpos/NAME"), ("x", "KIND/NAME.FIELD")])
def test_what_nothing_has_is_refused(base: Simulation, name: str, near: str) -> None:
    with pytest.raises(UnknownNameError, match=near):
        simulation_at(base, (name,), ("1",))


@pytest.mark.parametrize(
    ("name", "text"), [("timestep", "x"), ("qpos/hinge", "y"), ("seed", "-1"), ("integrator", "z")]
)
def test_a_value_that_cannot_be_is_told(base: Simulation, name: str, text: str) -> None:
    with pytest.raises(BadValueError, match=text):
        simulation_at(base, (name,), (text,))
