"""A delay that is overridden delays by that much, whatever the length of the buffer in the source."""

import math
from pathlib import Path

import mujoco
import pytest

from mjrun.model.override import Override
from mjrun.model.sources import parse_source

MODEL = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body><joint name="j" type="slide"/>
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
    path.write_text(MODEL.replace("SAMPLES", str(samples)))
    steps = math.ceil(round(float(delay) / 0.002, 6))
    assert first_steps(path, {"actuator/m.delay": delay}) == (steps, steps + 1)
    assert first_steps(path, {"actuator/*.delay": delay, "sensor/v.delay": "0.006"}) == (steps, steps + 1 + 3)


def test_a_shorter_timestep_needs_more_samples(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(MODEL.replace("SAMPLES", "0"))
    assert first_steps(path, {"actuator/m.delay": "0.01", "opt.timestep": "0.001"})[0] == 10
