"""How the numbers of a joint are called: the components of qpos and qvel by joint type."""

import mujoco

FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
QPOS_PARTS = {FREE: ("x", "y", "z", "qw", "qx", "qy", "qz"), BALL: ("qw", "qx", "qy", "qz")}
QVEL_PARTS = {FREE: ("vx", "vy", "vz", "wx", "wy", "wz"), BALL: ("wx", "wy", "wz")}
