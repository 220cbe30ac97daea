"""A model with one of everything that tests of the comparison of models edit."""

import mujoco

from mjrun.diff.models import compare_models
from mjrun.diff.result import ModelComparison
from mjrun.diff.tolerances import Tolerance, Tolerances
from mjrun.model.sources import CompiledSource

CRATE = '<body name="crate" pos="4 0 1"><freejoint name="crate"/><geom name="lid" size=".1"/></body>'
XML = """
<mujoco model="rig">
  <option timestep="0.002"/>
  <asset>
    <material name="steel" rgba=".5 .5 .6 1"/>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 4"/>
    <camera name="front" pos="0 -3 1"/>
    <geom name="floor" type="plane" size="5 5 .1"/>
    {first}
    <body name="torso" pos="0 0 1">
      <joint name="hip" axis="0 1 0" range="-1 1"/>
      <inertial pos="0 0 0" mass="8.907" diaginertia=".2 .3 .4"/>
      <geom name="chest" size=".2" material="steel"/>
      <geom size=".05" pos="0 0 .3"/>
      <geom size=".05" pos="0 0 .4"/>
      <site name="imu" pos="0 0 .1"/>
      <body pos="0 0 -.5">
        <joint name="knee" axis="0 1 0" stiffness="1"/>
        <geom type="mesh" mesh="wedge"/>
      </body>
    </body>
    <body name="ball" pos="2 0 1"><freejoint name="root"/><geom name="ball" size=".1"/></body>
  </worldbody>
  <tendon><fixed name="cord"><joint joint="hip" coef="1"/><joint joint="knee" coef="-1"/></fixed></tendon>
  <equality><joint name="gears" joint1="hip" joint2="knee"/></equality>
  <contact><exclude body1="torso" body2="ball"/></contact>
  <actuator><motor name="motor" joint="knee"/><position joint="hip" kp="10"/></actuator>
  <sensor><gyro name="gyro" site="imu"/><jointpos joint="hip"/><jointpos joint="knee"/></sensor>
  <keyframe><key name="start" qpos=".1 .2 {first_qpos} 2 0 1 1 0 0 0"/></keyframe>
</mujoco>
"""


def xml(first: str = "") -> str:
    """The model, with a body before all others if one is given: `CRATE`."""
    text = XML.format(first=first, first_qpos="")
    crate = "4 0 1 1 0 0 0 " if first else ""
    return text.replace('qpos=".1', f'qpos="{crate}.1')


def spec(first: str = "") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(xml(first))


def compared(a: mujoco.MjModel, b: mujoco.MjModel, **tolerance: float) -> ModelComparison:
    """The comparison of two compiled models, within `atol` and `rtol`."""
    return compare_models(CompiledSource(a), CompiledSource(b), Tolerances(Tolerance(**tolerance), {}))
