"""Theorems about the components of joints: as many as MuJoCo has numbers, in its order."""

import mujoco
import numpy as np
import pytest

from mjrun.model.joint_components import BALL, FREE, QPOS_COMPONENTS, QVEL_COMPONENTS

MODEL = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0"/><worldbody>
<body><freejoint/><geom size="1"/></body><body pos="9 0 0"><joint type="ball"/><geom size="1"/></body>
</worldbody></mujoco>""")


@pytest.mark.parametrize("joint", [0, 1])
def test_there_is_a_name_for_each_number(joint: int) -> None:
    kind = int(MODEL.jnt_type[joint])
    qpos = np.diff([*MODEL.jnt_qposadr, MODEL.nq])[joint]
    qvel = np.diff([*MODEL.jnt_dofadr, MODEL.nv])[joint]
    assert (len(QPOS_COMPONENTS[kind]), len(QVEL_COMPONENTS[kind])) == (qpos, qvel)


def test_a_component_is_what_its_name_says() -> None:
    data = mujoco.MjData(MODEL)
    data.qvel[QVEL_COMPONENTS[FREE].index("vy")] = 2
    data.qvel[6 + QVEL_COMPONENTS[BALL].index("wz")] = 3
    mujoco.mj_step(MODEL, data)
    dt = MODEL.opt.timestep
    moved = dict(zip(QPOS_COMPONENTS[FREE], data.qpos[:7], strict=True))
    turned = dict(zip(QPOS_COMPONENTS[BALL], data.qpos[7:], strict=True))
    assert moved == pytest.approx({"x": 0, "y": 2 * dt, "z": 0, "qw": 1, "qx": 0, "qy": 0, "qz": 0})
    assert turned == pytest.approx({"qw": np.cos(1.5 * dt), "qx": 0, "qy": 0, "qz": np.sin(1.5 * dt)})
