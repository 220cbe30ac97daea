"""Sensors of bodies that cannot move, by what they measure in a simulation."""

import mujoco
import pytest

from tests.check.models import lint, mjcf

SENSORS = [
    *(f'<{kind} site="s"/>' for kind in ("gyro", "accelerometer", "velocimeter")),
    *(f'<frame{kind} objtype="site" objname="s"/>' for kind in ("linvel", "angvel", "linacc", "angacc")),
    *('<gyro site="leg"/>', '<jointvel joint="j"/>', '<framelinvel objtype="body" objname="leg"/>'),
]


@pytest.mark.parametrize("joint", ["", '<joint axis="1 1 1"/>', "<freejoint/>"])
@pytest.mark.parametrize("sensor", SENSORS)
def test_sensors_of_motion_are_reported_where_they_never_change(sensor: str, joint: str) -> None:
    leg = '<joint name="j" axis="0 1 0"/><geom size=".1" pos=".1 0 0"/><site name="leg"/>'
    base = f'{joint}<geom size=".1" pos=".2 .1 0"/><site name="s"/><body name="leg" pos=".3 0 0">{leg}</body>'
    text = mjcf(f'<geom type="plane" size="1 1 1"/><body pos="0 0 9">{base}</body>', f"<sensor>{sensor}</sensor>")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    values = set()
    for _ in range(20):
        mujoco.mj_step(model, data)
        values.add(tuple(data.sensordata))
    assert bool([f for f in lint(text) if f.code == "MJ311"]) == (len(values) == 1)
