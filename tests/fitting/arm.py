"""Logs that a bare loop of MuJoCo makes of a small arm with a payload, for tests of fits of inertias."""

import mujoco
import numpy as np

from tests.fitting.logs import NOISE

TRUTH = {"mass": 1.4, "pos": "0.03 -0.02 0.13", "inertia": 'diaginertia="0.0056 0.0056 0.0028"'}
NOMINAL = {"mass": 0.7, "pos": "0 0 0.1", "inertia": 'diaginertia="0.0028 0.0028 0.0014"'}
ARM = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping="0.2"/></default>
  <worldbody>
    <body name="shoulder" pos="0 0 1">
      <joint name="pan" axis="0 0 1"/>
      <joint name="lift" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="1"/>
      <body name="wrist" pos=".3 0 0">
        <joint name="roll" axis="1 0 0"/>
        <joint name="tilt" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".4"/>
        <body name="payload" pos=".2 0 0"><inertial mass="{mass}" pos="{pos}" {inertia}/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="pan" joint="pan" kp="40" kv="2"/>
    <position name="lift" joint="lift" kp="40" kv="2"/>
    <position name="roll" joint="roll" kp="10" kv=".5"/>
    <position name="tilt" joint="tilt" kp="10" kv=".5"/>
  </actuator>
</mujoco>
"""
JOINTS = ("pan", "lift", "roll", "tilt")


def log(seconds: float = 3.0, every: int = 5, **values: object) -> dict[str, np.ndarray]:
    """Columns of the true arm, or one with `values`, swung by four sines: angles have noise."""
    model = mujoco.MjModel.from_xml_string(ARM.format(**{**TRUTH, **values}))
    data = mujoco.MjData(model)
    generator = np.random.default_rng(0)
    rows: list[list[float]] = []
    for step in range(round(seconds / model.opt.timestep)):
        time = step // every * every * model.opt.timestep
        data.ctrl[:] = 0.8 * np.sin(np.array([5.0, 7.1, 8.3, 6.4]) * time + np.array([0, 1, 2, 3]))
        if step % every == 0:
            rows.append([time, *(data.qpos + generator.normal(0, NOISE, 4)), *data.ctrl])
        mujoco.mj_step(model, data)
    names = ["time", *(f"qpos/{name}" for name in JOINTS), *(f"ctrl/{name}" for name in JOINTS)]
    return dict(zip(names, np.array(rows).T, strict=True))
