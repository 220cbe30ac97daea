"""What tests of model descriptions share: a model of many kinds of objects, and our scenes."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from mjrun.model.info import ModelDescription

Describe = Callable[[str], ModelDescription]

SCENES = sorted((Path(__file__).parents[3] / "scenes").glob("*.xml"))

MIXED = """<mujoco model="mixed"><compiler angle="radian"/>
<worldbody><site name="ref"/><geom type="plane" size="1 1 1"/>
  <body name="ball"><joint name="ball" type="ball" range="0 1" limited="true"/><geom size=".1"/><site name="s"/>
    <body name="tip"><geom name="tip" type="capsule" size=".1 .2" mass="2"/></body></body>
  <body name="car" pos="1 0 0"><joint name="slide" type="slide" axis="0 1 0" damping="2" stiffness="3"/>
    <joint name="hinge" range="-1 2" limited="true" armature=".5" frictionloss=".25" pos="0 0 .5"/><geom name="car"
    size=".1"/></body>
  <body pos="2 0 0"><freejoint/><geom type="box" size=".1 .2 .3"/></body><body name="goal" mocap="true"/></worldbody>
<tendon><fixed name="sum" range="0 1" limited="true"><joint joint="hinge" coef="2"/></fixed>
  <fixed name="both"><joint joint="hinge" coef="1"/><joint joint="slide" coef="-.5"/></fixed>
  <spatial name="rope" stiffness="5"><site site="s"/><geom geom="car" sidesite="ref"/><site site="ref"/>
    <pulley divisor="2"/><site site="s"/><site site="ref"/></spatial></tendon>
<contact><pair geom1="tip" geom2="car" friction="1 2 3 4 5"/><exclude body1="car" body2="goal"/></contact>
<equality><connect body1="car" anchor="1 2 3"/><weld site1="s" site2="ref" active="false"/>
  <joint joint1="hinge" joint2="slide"/><tendon tendon1="rope"/></equality>
<actuator><motor name="m" joint="hinge" gear="3" forcerange="-4 5" ctrlrange="-1 1"/><muscle tendon="rope"
  lengthrange="0 1"/><orientation name="o" joint="ball" kp="3"/><intvelocity joint="hinge" actrange="-1 1" kp="2"/>
  <motor site="s" gear="0 0 0 1 0 0"/></actuator>
<keyframe><key name="fine"/><key name="far" time="2" qpos="0 1 0 0 9 3 0 0 0 1 0 0 0" act="0 -2" ctrl="5"/></keyframe>
</mujoco>"""


@pytest.fixture
def described() -> Describe:
    """Describes the model in a text."""
    return lambda text: ModelDescription(mujoco.MjModel.from_xml_string(text))


@pytest.fixture(scope="session")
def mixed_xml() -> str:
    """MJCF with objects of most kinds; its last part is its keyframes."""
    return MIXED


@pytest.fixture(scope="session")
def mixed() -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_string(MIXED.replace('ctrl="5"', 'ctrl="5 0 0 0 0 0 0"')))


@pytest.fixture(params=SCENES, ids=lambda path: path.stem)
def scene(request: pytest.FixtureRequest) -> ModelDescription:
    return ModelDescription(mujoco.MjModel.from_xml_path(str(request.param)), request.param)
