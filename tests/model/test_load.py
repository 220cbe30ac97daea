"""Theorems about `mjrun.load`: its arguments reach the model."""

from pathlib import Path

import mujoco
import pytest

from mjrun.errors import (
    UnknownNameError,
)
from mjrun.model.load import load
from mjrun.model.override import Override
from tests.model.model_files import MODEL, write


@pytest.mark.parametrize("name", ["euler", "rk4", "implicit", "implicitfast", "discrete"])
def test_an_integrator_is_mujocos_of_that_name(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    expected = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
    assert load(path, integrator=name).opt.integrator == expected


def test_an_unknown_integrator_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'rk4'") as caught:
        load(write(tmp_path / "a.xml", MODEL), integrator="rk45")
    assert caught.value.valid == ("euler", "rk4", "implicit", "implicitfast", "discrete")


def test_the_arguments_for_timestep_and_integrator_win_over_overrides(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    overrides = [Override("opt.timestep", "0.1"), Override("opt.integrator", "euler")]
    option = load(path, timestep=0.2, integrator="rk4", overrides=overrides).opt
    assert (option.timestep, option.integrator) == (0.2, mujoco.mjtIntegrator.mjINT_RK4)


@pytest.mark.parametrize("timestep", [0.1, 1 / 3, 1e-7, 0.0020000000000000005])
def test_the_timestep_in_the_model_is_the_asked_one_to_the_last_bit(tmp_path: Path, timestep: float) -> None:
    assert load(write(tmp_path / "a.xml", MODEL), timestep=timestep).opt.timestep == timestep


def test_a_scene_and_a_compiled_model_load_too() -> None:
    assert load("scene:pendulum").joint("hinge").id == 0
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert load(model) is model
