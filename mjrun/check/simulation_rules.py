"""What goes wrong when a model moves: it becomes unstable, gains energy out of nothing, or MuJoCo warns."""

import copy
from collections.abc import Iterator

import mujoco
import numpy as np

from mjrun.check.context import LintContext
from mjrun.check.finding import Sighting
from mjrun.check.rule_table import GAINING, GAVE_UP, KNOWN_FAULT, UNSTABLE, WARNED_STEPPING
from mjrun.errors import FailedStepError, SimulationError
from mjrun.model import mujoco_bugs
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.sim.stepper import PhysicsStepper

CODES = (UNSTABLE, GAINING, WARNED_STEPPING, GAVE_UP, KNOWN_FAULT)
LOOKS = 50  # instants at which energy is looked at
GAIN = 0.1  # of the largest kinetic energy, and of the energy of falling by the mean size of a geom
ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


def sightings(subject: LintContext, steps: int) -> Iterator[tuple[str, Sighting]]:
    """What `steps` steps from the model's own start show, without controls: codes and sightings."""
    for fault in mujoco_bugs.of_model(subject.model):
        message, _, remedy = fault.partition("; ")
        yield KNOWN_FAULT, Sighting(message, remedy)
    if steps and subject.model.nv + subject.model.na:
        yield from _moved(subject.model, steps)


def _moved(model: mujoco.MjModel, steps: int) -> Iterator[tuple[str, Sighting]]:
    measured = copy.copy(model)
    measured.opt.enableflags |= ENERGY  # which is only looked at
    energies: list[tuple[float, float]] = []
    passive, failure = True, None
    with collected_warnings() as heard:
        stepper = PhysicsStepper(measured, mujoco.MjData(measured))
        try:
            for step in _instants(steps):
                stepper.advance(step)
                data = stepper.instant()
                energies.append((float(data.energy[0]), float(data.energy[1])))
                passive = passive and not data.actuator_force.any()
        except SimulationError as error:
            failure = error
    if failure:
        yield _failed(failure)
        return
    for text in heard:
        first = "; ".join(text.split("\n"))
        yield WARNED_STEPPING, Sighting(f"within {steps} steps MuJoCo warns: {first}", "")
    if passive and _conserves(model):
        yield from _gained(model, np.array(energies))


def _instants(steps: int) -> list[int]:
    """The steps at which to look, the first and the last among them."""
    return sorted({round(k * steps / LOOKS) for k in range(LOOKS + 1)})


def _failed(error: SimulationError) -> tuple[str, Sighting]:
    message, _, remedy = str(error).partition("\n")
    code = GAVE_UP if isinstance(error, FailedStepError) else UNSTABLE
    return code, Sighting(message, remedy.replace("--timestep", "timestep").replace("--integrator", "integrator"))


def _conserves(model: mujoco.MjModel) -> bool:
    """Whether nothing in `model` can do work that MuJoCo's energy leaves out."""
    return not (
        model.nplugin
        or model.nflex
        or model.nmocap
        or model.body_gravcomp.any()
        or model.geom_surfacevel.any()
        or model.geom_adhesion.any()
        or model.opt.wind.any()
    )


def _gained(model: mujoco.MjModel, energies: np.ndarray) -> Iterator[tuple[str, Sighting]]:
    """Whether potential and kinetic energy `(n, 2)` [J] ever exceed what the model starts with."""
    total, kinetic = energies.sum(axis=1), energies[:, 1]
    fall = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity) * model.stat.meansize)
    gain, scale = float(total.max() - total[0]), float(kinetic.max()) + fall
    if gain <= GAIN * scale or not np.isfinite(gain):
        return
    message = (
        f"nothing drives it, and its energy grows by {gain:.3g} J, {100 * gain / scale:.0f} % of what moves: "
        f"from {total[0]:.4g} to {total.max():.4g} J"
    )
    remedy = (
        "take a smaller timestep or integrator rk4 or implicitfast; look for negative damping, overlaps at the start"
    )
    yield GAINING, Sighting(message, remedy)
