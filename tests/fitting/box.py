"""A box that is thrown on a floor, in a log by a bare loop of MuJoCo, and what fits its friction."""

from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np

from mjrun.fitting.free_parameter import FreeParameter
from mjrun.fitting.measurements import LogSegment, first_noise
from mjrun.fitting.shooting_fit import ShootingFit
from tests.fitting.problems import shooting_of

FRICTION, NOISE = 0.33, 1e-3  # [m, rad]
SIGNALS = [f"qpos/box/{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")]
RATES = [f"qvel/box/{part}" for part in ("vx", "vy", "vz", "wx", "wy", "wz")]
BOX = """<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="5 5 .1" friction=".1"/>
    <body pos="0 0 .06">
      <freejoint name="box"/>
      <geom name="box" type="box" size=".1 .08 .05" mass="1" friction="{}"/>
    </body>
  </worldbody>
</mujoco>"""


def box_log(seconds: float = 0.2, speed: float = 2.2, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions `(n, 7)` every other step, with noise."""
    model = mujoco.MjModel.from_xml_string(BOX.format(FRICTION))
    data, generator = mujoco.MjData(model), np.random.default_rng(seed)
    data.qvel[:2] = speed, 0.1 * speed
    times, rows = [], []
    for step in range(round(seconds / model.opt.timestep)):
        if step % 2 == 0:
            measured = data.qpos.copy()
            mujoco.mj_integratePos(model, measured, generator.normal(0, NOISE, 6), 1.0)
            times.append(data.time)
            rows.append(measured)
        mujoco.mj_step(model, data)
    return np.array(times), np.array(rows)


def exact_box_log() -> tuple[np.ndarray, np.ndarray]:
    """Times and states at every step, `(n, nq + nv)`, of a box that is thrown, bounces on its edges and slides."""
    model = mujoco.MjModel.from_xml_string(BOX.format(FRICTION))
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[:] = 0.12, (2.2, 0.3, 0, 3, 1, 0)
    times, rows = [], []
    for _ in range(400):
        times.append(data.time)
        rows.append(np.concatenate([data.qpos, data.qvel]))
        mujoco.mj_step(model, data)
    return np.array(times), np.array(rows)


def write_box(folder: Path, friction: float = FRICTION) -> Path:
    """The model."""
    (folder / "box.xml").write_text(BOX.format(friction))
    return folder / "box.xml"


def box_shooting() -> tuple[ShootingFit, LogSegment, np.ndarray, list[FreeParameter]]:
    """Returns a shooting of the box, the log, its noise, and the friction."""
    times, rows = box_log()
    log = LogSegment("log", times, rows, np.zeros((len(times), 0)))
    free = (("geom/box.friction[0]", "0.1..1"),)
    shoot, predictor, _, parameters = shooting_of(write_box(Path(mkdtemp())), free, SIGNALS, [], log)
    return shoot, log, first_noise([log.values], predictor.rotations), parameters
