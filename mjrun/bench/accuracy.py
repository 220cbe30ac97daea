"""Accuracy of a simulation: its distance from one with finer steps, and its energy drift."""

import copy
from dataclasses import dataclass
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.physics.stepper import PhysicsStepper
from mjrun.timeline import nearest, rational


@dataclass(frozen=True)
class FinalState:
    """The end of a simulation.

    Attributes:
      time: simulated [s], exact.
      qpos, qvel: `(nq,)`, `(nv,)`.
      drift: potential and kinetic energy, less those at the start [J].
    """

    time: Fraction
    qpos: np.ndarray
    qvel: np.ndarray
    drift: float


def simulate_to(model: mujoco.MjModel, data: mujoco.MjData, horizon: Fraction) -> FinalState:
    """Simulates from the state in `data`, its controls held, for the whole number of steps nearest to `horizon` [s].

    Raises:
      SimulationError: it becomes unstable, or MuJoCo gives up.
    """
    timestep = rational(model.opt.timestep)
    return _advanced(_stepper(model, data), max(1, nearest(horizon / timestep)), timestep)


def distance_from_finer(model: mujoco.MjModel, data: mujoco.MjData, final: FinalState, timestep: Fraction) -> float:
    """How far `final` is from where `model` gets with finer steps.

    Args:
      data: the start of both.
      timestep: of the finer simulation [s].

    Returns:
      The root mean square, over all degrees of freedom, of what takes one position to the other
      (`mj_differentiatePos`) [m and rad].

    Raises:
      SimulationError: the finer simulation becomes unstable, or MuJoCo gives up.
    """
    finer = copy.copy(model)
    finer.opt.timestep = float(timestep)
    steps = nearest(final.time / timestep)
    reference = _advanced(_stepper(finer, data), steps, timestep)
    # Its steps need not meet that instant: its velocity covers the rest, half a step at most.
    qpos, rest = reference.qpos.copy(), float(final.time - reference.time)
    mujoco.mj_integratePos(model, qpos, reference.qvel, rest)
    return position_distance(model, qpos, final.qpos)


def position_distance(model: mujoco.MjModel, a: np.ndarray, b: np.ndarray) -> float:
    """Root mean square over all degrees of freedom of the difference of two positions `(nq,)` [m and rad]."""
    difference = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, difference, 1.0, a, b)
    return float(np.sqrt(np.mean(difference**2))) if model.nv else 0.0


def _stepper(model: mujoco.MjModel, data: mujoco.MjData) -> PhysicsStepper:
    measured = copy.copy(model)
    measured.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return PhysicsStepper(measured, data)


def _advanced(stepper: PhysicsStepper, steps: int, timestep: Fraction) -> FinalState:
    before = float(stepper.instant().energy.sum())
    stepper.advance(steps)
    end = stepper.instant()
    return FinalState(steps * timestep, end.qpos.copy(), end.qvel.copy(), float(end.energy.sum()) - before)
