"""Files of demonstrations as robosuite, robomimic and LIBERO write them, written here with h5py alone."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np

RECORDED = "/home/someone/robosuite-dev/robosuite/models/assets/arenas/../robots/arm/link.obj"
TETRAHEDRON = "v 0 0 0\nv .3 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
# As robosuite's models are: geoms that collide are in group 0, visual ones in group 1.
MODEL = f"""<mujoco model="base">
  <compiler angle="radian" meshdir="meshes/"/>
  <visual><global offwidth="64" offheight="64"/><quality shadowsize="256"/></visual>
  <asset><mesh name="link" file="{RECORDED}"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <camera name="agentview" pos="0 -2 .8" xyaxes="1 0 0 0 .3 1"/>
    <geom name="floor" type="plane" group="1" size="2 2 .1" rgba=".4 .5 .6 1"/>
    <body name="arm" pos="0 0 .5">
      <joint name="turn" axis="0 0 1"/>
      <geom name="arm_collision" type="box" size=".4 .2 .2" rgba="0 1 0 1"/>
      <geom name="arm_visual" type="mesh" mesh="link" group="1" contype="0" conaffinity="0" rgba="1 0 0 1"/>
      <site name="gripper0_grip_site" pos=".3 0 0"/>
    </body>
    <body name="cube_main" pos=".5 0 .1">
      <freejoint name="cube"/>
      <geom name="cube" type="box" size=".1 .1 .1"/>
    </body>
  </worldbody>
  <actuator><motor name="turn" joint="turn"/></actuator>
</mujoco>"""
PLAIN = MODEL.replace(RECORDED, "link.obj")  # its mesh is in the folder `meshes` beside the file
ENV_ARGS = json.dumps({"env_name": "Lift", "env_version": "1.4.1", "type": 1, "env_kwargs": {"control_freq": 20}})


def write_assets(folder: Path) -> Path:
    """Writes the mesh below a folder, as an installed robosuite has it; returns the folder."""
    mesh = folder / "robosuite/models/assets/robots/arm/link.obj"
    mesh.parent.mkdir(parents=True)
    mesh.write_text(TETRAHEDRON)
    return folder


def recorded_states(count: int = 5, first: float = 0.0, seed: int = 0) -> np.ndarray:
    """Returns states `(count, 16)` at 20 Hz: time, an angle, the pose of the cube, velocities."""
    random = np.random.default_rng(seed)
    states = random.standard_normal((count, 1 + 8 + 7))
    states[:, 0] = first + np.arange(count) / 20
    states[:, 5] = 3  # so that quaternions keep their sign
    states[:, 5:9] /= np.linalg.norm(states[:, 5:9], axis=1, keepdims=True)
    return states


def write_demonstrations(
    path: Path,
    demos: Mapping[str, np.ndarray] | None = None,
    model: str | None = PLAIN,
    attributes: Mapping[str, Any] | None = None,
    observations: Mapping[str, np.ndarray] | None = None,
    **settings: Any,
) -> Path:
    """Writes a file with these states by name, by default with two demonstrations, and with the mesh of `PLAIN`.

    Args:
      model: the attribute `model_file` of each; None for none.
      attributes: those of all; by default, those of robomimic.
      observations: those of each demonstration.
      settings: settings of h5py.File.
    """
    (path.parent / "meshes").mkdir(exist_ok=True)
    (path.parent / "meshes/link.obj").write_text(TETRAHEDRON)
    demos = {"demo_1": recorded_states(), "demo_2": recorded_states(4, 0.25, 1)} if demos is None else demos
    with h5py.File(path, "w", **settings) as file:
        data = file.create_group("data")
        data.attrs.update({"env_args": ENV_ARGS} if attributes is None else attributes)
        for name, states in demos.items():
            group = data.create_group(name)
            if model is not None:
                group.attrs["model_file"] = model
            group["states"] = states
            group["actions"] = np.zeros((len(states), 7))
            for key, values in (observations or {}).items():
                group[f"obs/{key}"] = values
    return path


def positions_at(model: mujoco.MjModel, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the positions of bodies `(n, nbody, 3)` and sites `(n, nsite, 3)` in each state, by MuJoCo alone."""
    data = mujoco.MjData(model)
    bodies, sites = [], []
    for state in states:
        data.qpos[:], data.qvel[:] = state[1 : 1 + model.nq], state[1 + model.nq :]
        mujoco.mj_forward(model, data)
        bodies.append(data.xpos.copy())
        sites.append(data.site_xpos.copy())
    return np.array(bodies), np.array(sites)
