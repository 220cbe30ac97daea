"""How far a simulation is from where a finer one goes, and how much energy it makes."""

import copy
from dataclasses import dataclass
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.sim.stepper import PhysicsStepper
from mjrun.timeline import nearest, rational


@dataclass(frozen=True)
class Arrival:
    """Where a simulation got to.

    Attributes:
      time: simulated [s], exact.
      qpos, qvel: `(nq,)`, `(nv,)`.
      drift: its potential and kinetic energy, less those at the start [J].
    """

    time: Fraction
    qpos: np.ndarray
    qvel: np.ndarray
    drift: float


def arrive(model: mujoco.MjModel, data: mujoco.MjData, horizon: Fraction) -> Arrival:
    """Simulates from the state in `data`, its controls held, for the whole number of steps nearest to `horizon` [s].

    Raises:
      SimulationError: it becomes unstable, or MuJoCo gives up.
    """
    timestep = rational(model.opt.timestep)
    return _advanced(_stepper(model, data), max(1, nearest(horizon / timestep)), timestep)


def distance(model: mujoco.MjModel, data: mujoco.MjData, arrival: Arrival, timestep: Fraction) -> float:
    """How far `arrival` is from where `model` itself goes when it takes finer steps.

    Args:
      data: where both start.
      timestep: of the finer simulation [s].

    Returns:
      The root mean square, over all degrees of freedom, of what takes one position to the other
      (`mj_differentiatePos`) [m and rad].

    Raises:
      SimulationError: the finer simulation becomes unstable, or MuJoCo gives up.
    """
    finer = copy.copy(model)
    finer.opt.timestep = float(timestep)
    steps = nearest(arrival.time / timestep)
    reference = _advanced(_stepper(finer, data), steps, timestep)
    # Its steps need not meet that instant: what is left, half a step at most, goes by its velocity.
    qpos, left = reference.qpos.copy(), float(arrival.time - reference.time)
    mujoco.mj_integratePos(model, qpos, reference.qvel, left)
    return apart(model, qpos, arrival.qpos)


def apart(model: mujoco.MjModel, a: np.ndarray, b: np.ndarray) -> float:
    """Root mean square over all degrees of freedom of the difference of two positions `(nq,)` [m and rad]."""
    difference = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, difference, 1.0, a, b)
    return float(np.sqrt(np.mean(difference**2))) if model.nv else 0.0


def _stepper(model: mujoco.MjModel, data: mujoco.MjData) -> PhysicsStepper:
    measured = copy.copy(model)
    measured.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return PhysicsStepper(measured, data)


def _advanced(stepper: PhysicsStepper, steps: int, timestep: Fraction) -> Arrival:
    before = float(stepper.instant().energy.sum())
    stepper.advance(steps)
    there = stepper.instant()
    return Arrival(steps * timestep, there.qpos.copy(), there.qvel.copy(), float(there.energy.sum()) - before)
