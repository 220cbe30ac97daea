"""Theorems about compilation: a model that MuJoCo refuses is refused with its line, its reason and the overrides."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import BadValueError, BrokenModelError, MjrunError, clean
from mjrun.model.override import Override
from mjrun.model.source import non_finite_number
from mjrun.model.sources import load, parse_source
from tests.cases import cases
from tests.model.model_files import MODEL, refusal, write


@cases("text, line, words")
def test_a_broken_model_is_refused_with_the_line_and_mujocos_reason(
    tmp_path: Path, text: str, line: int | None, words: str
) -> None:
    path = write(tmp_path / "a.xml", text)
    error = refusal(path)
    assert isinstance(error, BrokenModelError)
    assert (error.path, error.line) == (path, line)
    first = str(error).splitlines()[0]
    assert first.startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert words in first
    assert "Error: " not in first


@pytest.mark.parametrize("overrides", [{}, {"opt.cone": "elliptic"}, {"geom/skin.size": "1"}])
def test_a_name_in_latin_1_is_refused_with_the_cure_whatever_is_overridden(
    tmp_path: Path, overrides: dict[str, str]
) -> None:
    path = write(tmp_path / "a.xml", MODEL.replace("skin", "pé").encode("latin-1"))
    with pytest.raises(BrokenModelError, match="not UTF-8; save the file as UTF-8"):
        load(path, overrides=overrides)


@pytest.mark.parametrize("timestep", ["0", "-1", "nan", "inf"])
def test_a_timestep_that_cannot_be_is_refused_unless_it_is_overridden(tmp_path: Path, timestep: str) -> None:
    path = write(tmp_path / "a.xml", f'<mujoco><option timestep="{timestep}"/></mujoco>')
    first, second = str(refusal(path)).splitlines()
    assert first == f"{path}: the timestep must be positive and finite, not {timestep}"
    assert second == "timestep overrides it"
    assert load(path, timestep=0.01).opt.timestep == 0.01
    assert load(path, overrides={"opt.timestep": "0.01"}).opt.timestep == 0.01


def test_a_timestep_after_which_no_time_can_be_told_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", '<mujoco><option timestep="1e308"/></mujoco>')
    assert "the timestep must be at most 1e+12 s, not 1e+308" in str(refusal(path))


@pytest.mark.parametrize("timestep", [0.0, -0.01, float("nan"), float("inf"), 1e308])
def test_asking_for_a_timestep_that_cannot_be_is_wrong_usage(tmp_path: Path, timestep: float) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    with pytest.raises(BadValueError) as caught:
        load(path, timestep=timestep)
    assert caught.value.exit_code == 2


def test_an_override_that_breaks_the_model_is_named_in_the_refusal(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    with pytest.raises(BrokenModelError) as caught:
        load(path, overrides={"geom/skin.material": "gold"})
    assert str(caught.value).endswith("with set geom/skin.material=gold")


def test_foreign_text_in_an_override_cannot_steer_the_terminal(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    with pytest.raises(MjrunError) as caught:
        load(path, overrides={"geom/skin.material": "\x1b[31m"})
    assert all(line == clean(line) for line in str(caught.value).splitlines())


BODY = (
    '<worldbody><body name="arm"><joint name="hip" {}/><geom name="bob" size=".1" pos="0 0 1" {}/></body></worldbody>'
)


def model(option: str = "", joint: str = "", geom: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><option {option}/>{BODY.format(joint, geom)}</mujoco>")


@cases("parts, says")
def test_what_is_not_finite_is_named(parts: dict[str, str], says: str) -> None:
    assert non_finite_number(model(**parts)) == says


def test_bounds_may_be_infinite_and_keyframes_are_not_looked_at() -> None:
    assert non_finite_number(model(joint='range="-inf inf"', option='tolerance="inf"')) is None
    key = '<keyframe><key qpos="nan"/></keyframe>'
    assert non_finite_number(mujoco.MjModel.from_xml_string(f"<mujoco>{BODY.format('', '')}{key}</mujoco>")) is None


DELAYED = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body><joint name="j" type="slide"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor name="m" joint="j" nsample="SAMPLES"/></actuator>
<sensor><jointvel name="v" joint="j" nsample="1"/></sensor></mujoco>"""


def first_steps(path: Path, overrides: dict[str, str]) -> tuple[int, int]:
    """The first steps at which a constant control acts, and at which the sensor shows that the joint moves."""
    model = parse_source(str(path), [Override(*pair) for pair in overrides.items()]).load()
    data = mujoco.MjData(model)
    data.ctrl[:] = 1
    acting, moving = [], []
    for step in range(40):
        mujoco.mj_step(model, data)
        acting += [step] if data.actuator_force[0] else []
        moving += [step] if data.sensordata[0] else []
    return acting[0], moving[0]


@pytest.mark.parametrize("samples", [0, 3, 30])
@pytest.mark.parametrize("delay", ["0", "0.002", "0.01", "0.011", "0.04"])
def test_a_control_arrives_later_by_the_delay(tmp_path: Path, samples: int, delay: str) -> None:
    path = tmp_path / "model.xml"
    path.write_text(DELAYED.replace("SAMPLES", str(samples)))
    steps = math.ceil(round(float(delay) / 0.002, 6))
    assert first_steps(path, {"actuator/m.delay": delay}) == (steps, steps + 1)
    assert first_steps(path, {"actuator/*.delay": delay, "sensor/v.delay": "0.006"}) == (steps, steps + 1 + 3)


def test_a_shorter_timestep_needs_more_samples(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(DELAYED.replace("SAMPLES", "0"))
    assert first_steps(path, {"actuator/m.delay": "0.01", "opt.timestep": "0.001"})[0] == 10


@pytest.mark.parametrize("interp", ["linear", "cubic"])
@pytest.mark.parametrize("delay", ["0.003", "0.006"])
def test_an_interpolated_delay_has_all_samples_that_it_reads(tmp_path: Path, interp: str, delay: str) -> None:
    path = tmp_path / "model.xml"
    path.write_text(DELAYED.replace('nsample="SAMPLES"', f'interp="{interp}"'))
    forces = []
    for overrides in [Override("actuator/m.delay", delay)], [Override("actuator/m.nsample", "40")]:
        model = parse_source(str(path), overrides).load()
        model.actuator_delay[:] = float(delay)
        data, forces_here = mujoco.MjData(model), list[float]()
        for step in range(20):
            data.ctrl[:] = np.sin(step)
            mujoco.mj_step(model, data)
            forces_here.append(data.actuator_force[0])
        forces.append(forces_here)
    np.testing.assert_array_equal(*forces)
