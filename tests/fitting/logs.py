"""Logs that a bare loop of MuJoCo makes of a pendulum, for tests of fits."""

from pathlib import Path

import mujoco
import numpy as np
from scipy import signal

TRUTH = {"damping": 0.05, "armature": 0.01, "frictionloss": 0.02}
NOMINAL = {"damping": 0.3, "armature": 0.05, "frictionloss": 0.1}
NOISE = 2e-3  # [rad]
PENDULUM = """<mujoco>
  <!-- a rod that hangs -->
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="rod">
      <joint name="hinge" axis="0 1 0" damping="{damping}" armature="{armature}" frictionloss="{frictionloss}"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
</mujoco>
"""


def write_model(folder: Path, **values: float) -> Path:
    """The pendulum, nominal but for `values`."""
    path = folder / "pendulum.xml"
    path.write_text(PENDULUM.format(**{**NOMINAL, **values}))
    return path


def simulate(
    seconds: float = 3.0,
    start: float = 2.5,
    every: int = 5,
    controls: np.ndarray | None = None,
    **values: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Times and angles of the true pendulum, or of one with `values`, by mj_step: `(n,)` each.

    Args:
      controls: of every step; none when None.
    """
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(**{**TRUTH, **values}))
    data = mujoco.MjData(model)
    data.qpos[0] = start
    rows: list[tuple[float, float]] = []
    for step in range(round(seconds / model.opt.timestep)):
        if step % every == 0:
            rows.append((step * model.opt.timestep, float(data.qpos[0])))
        data.ctrl[0] = 0.0 if controls is None else controls[step]
        mujoco.mj_step(model, data)
    times, angles = np.array(rows).T
    return times, angles


def write_log(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """A CSV."""
    lines = [",".join(columns), *(",".join(f"{v:.17g}" for v in row) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return path


def noisy(angles: np.ndarray, seed: int = 0) -> np.ndarray:
    """Angles with white noise."""
    return angles + np.random.default_rng(seed).normal(0, NOISE, len(angles))


def correlated(share: float, shape: tuple[int, ...], seed: int) -> np.ndarray:
    """Autoregressive noise with a standard deviation of 1, along the first axis."""
    innovations = np.sqrt(1 - share**2) * np.random.default_rng(seed).normal(size=(100 + shape[0], *shape[1:]))
    return signal.lfilter([1], [1, -share], innovations, axis=0)[100:]
