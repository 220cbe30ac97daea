"""A cart that is pushed, whose pole alone is measured, and its log by a bare loop of MuJoCo."""

from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np

from mjrun.fitting.free_parameter import FreeParameter
from mjrun.fitting.measurements import LogSegment
from mjrun.fitting.prediction import Predictor
from mjrun.fitting.shooting_fit import ShootingFit
from mjrun.fitting.starting_states import StateGuesses
from tests.fitting.problems import shooting_of

SIGNALS = ["qpos/pole"]
FREE = (("joint/cart.damping", "log:0.1..10"), ("scale:actuator/push.gear[0]", "0.3..3"))
TRUTH = (2.0, 1.4)
CART = """<mujoco>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="cart" type="slide" axis="1 0 0" damping="{damping}"/>
      <geom size=".1" mass="1"/>
      <body>
        <joint name="pole" axis="0 1 0" damping=".05"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02" mass=".5"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="cart" gear="{gear}"/></actuator>
</mujoco>"""
NOMINAL = {"damping": 0.5, "gear": 5.0}


def cart_log(seconds: float = 2.0) -> tuple[LogSegment, np.ndarray]:
    """The log, a row every other step, and `qpos` and `qvel` at its rows, `(n, 4)`."""
    model = mujoco.MjModel.from_xml_string(CART.format(damping=TRUTH[0], gear=TRUTH[1] * NOMINAL["gear"]))
    data = mujoco.MjData(model)
    data.qvel[0] = 0.5  # which no log says
    times, controls, states = [], [], []
    for step in range(round(seconds / model.opt.timestep)):
        if step % 2 == 0:
            data.ctrl[0] = np.sin(6 * step * model.opt.timestep)
            times.append(step * model.opt.timestep)
            controls.append(data.ctrl.copy())
            states.append(np.concatenate([data.qpos, data.qvel]))
        mujoco.mj_step(model, data)
    rows = np.array(states)
    return LogSegment("log", np.array(times), rows[:, 1:2], np.array(controls)), rows


def cart_shooting() -> tuple[ShootingFit, Predictor, StateGuesses, list[FreeParameter]]:
    """Returns a shooting of the nominal cart, and its parts."""
    path = Path(mkdtemp()) / "cart.xml"
    path.write_text(CART.format(**NOMINAL))
    return shooting_of(path, FREE, SIGNALS, ["ctrl/push"])
