"""The simulation of a point is that of a command line with its values; versions and code determine its result."""

import errno
import pickle
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from importlib.metadata import version
from pathlib import Path

import mujoco
import pytest

from mjrun.errors import BadValueError, FileError, SystemLimitError, UnknownNameError, file_errors
from mjrun.experiment.design import Design
from mjrun.model.sources import source_of
from mjrun.simulation.simulation import Simulation
from mjrun.study.spec import PointResult, StudySpec, WorkerVersions, require_values, simulation_at, versions
from tests.study.models import PENDULUM


def test_other_versions_are_named() -> None:
    here = WorkerVersions.here([source_of("scene:dominos")])
    assert here.versions["mujoco"] == mujoco.mj_versionString()
    assert here.difference(here) == ""
    other = replace(here, versions={**versions(), "mujoco": "3.9.9"}, host="elsewhere")
    assert other.difference(here) == f"mujoco 3.9.9 instead of {mujoco.mj_versionString()}"
    acting = WorkerVersions.here([], ["pyyaml", "no-such-package"])
    other = replace(acting, versions={**acting.versions, "pyyaml": "1.0"})
    assert other.difference(acting) == f"pyyaml 1.0 instead of {version('pyyaml')}"


def test_other_packages_of_an_environment_are_named() -> None:
    here = WorkerVersions.here([source_of("gym:Hopper-v5")])
    (name, code) = next(iter(here.environments.items()))
    other = replace(here, environments={name: f"{code}.dev1"})
    assert other.difference(here) == f"gym:Hopper-v5 {code}.dev1 instead of {code}"
    assert here.difference(WorkerVersions.here([])) == ""  # of a model that this study does not ask about


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


def test_an_option_whose_partner_does_not_exist_at_a_point_is_left_out_there(base: Simulation) -> None:
    timed = replace(base, ctrl_noise_time=0.5, ctrl_interpolation="linear")
    names = ("ctrl_noise", "ctrl_from", "seed")
    points = [simulation_at(timed, names, values) for values in (("0.1", "a.csv", "1"), ("", "", "1"))]
    assert [(each.ctrl_noise, each.ctrl_noise_time) for each in points] == [(0.1, 0.5), (None, None)]
    assert [(each.ctrl_from, each.ctrl_interpolation) for each in points] == [("a.csv", "linear"), (None, "hold")]
    assert simulation_at(timed, ("seed",), ("1",)) == replace(timed, seed=1)  # which is refused when it starts


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


def test_words_vary_in_upper_and_lower_case_and_a_wrong_one_is_refused_before_any_point(base: Simulation) -> None:
    assert simulation_at(base, ("integrator",), ("RK4",)).integrator == "rk4"
    with pytest.raises(BadValueError, match=r"integrator: 'rk5' is not one of .*'rk4'"):
        require_values(Design(("integrator",), [("euler",), ("rk5",)]), {}, None)


def test_a_specification_can_be_sent_to_another_machine(base: Simulation) -> None:
    spec = StudySpec(base, ("seed",), (("swing", "max(qpos/hinge)"),))
    assert pickle.loads(pickle.dumps(spec)) == spec


def no_more_files() -> None:
    raise OSError(errno.EMFILE, "Too many open files")


def no_more_files_to_read() -> None:
    with file_errors("a.csv"):
        no_more_files()


@pytest.mark.parametrize("fail", [no_more_files, no_more_files_to_read])
def test_a_limit_of_the_system_is_no_result_of_a_point(fail: Callable[[], None]) -> None:
    with pytest.raises((OSError, FileError)) as caught:
        fail()
    with pytest.raises(SystemLimitError, match="Too many open files"):
        PointResult.failed(0, caught.value, 1, None)
