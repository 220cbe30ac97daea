"""Faults in a simulation: instability, unexplained energy, warnings of MuJoCo."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from mjrun.check.context import CheckContext
from mjrun.check.rule import Finding, Rule
from mjrun.check.rules.limits import joints_beyond_range
from mjrun.check.rules.start_forces import deep_penetrations
from mjrun.errors import SimulationError, UnstableError
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.model.source import bugs_of_model
from mjrun.physics.stepper import PhysicsStepper

UNSTABLE = Rule("MJ701", "error", "unstable simulation")
ENERGY_GAIN = Rule("MJ702", "warning", "passive model gains energy")
WARNING = Rule("MJ703", "warning", "MuJoCo warns while stepping")
FAILED_STEP = Rule("MJ704", "error", "MuJoCo fails while stepping")
KNOWN_BUG = Rule("MJ705", "note", "known bug of the installed MuJoCo")
CODES = frozenset(rule.code for rule in (UNSTABLE, ENERGY_GAIN, WARNING, FAILED_STEP, KNOWN_BUG))

SAMPLES = 25  # of the energy
ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)


def simulate(context: CheckContext, steps: int) -> Iterator[Finding]:
    """Yields the faults within `steps` steps from the model's initial state, without controls."""
    for bug in bugs_of_model(context.model):
        message, _, remedy = bug.partition("; ")
        yield KNOWN_BUG.in_model(context.path, message, remedy)
    if steps and context.model.nv + context.model.na:
        yield from _step(context, steps)


def _step(context: CheckContext, steps: int) -> Iterator[Finding]:
    energies: list[tuple[float, float]] = []
    passive = True
    with collected_warnings() as warnings, _energy_flags(context.model):
        try:
            stepper = PhysicsStepper(context.model, mujoco.MjData(context.model), in_place=True)
            for step in sorted({round(k * steps / SAMPLES) for k in range(SAMPLES + 1)}):
                stepper.advance(step)
                data = stepper.instant()
                energies.append((float(data.energy[0]), float(data.energy[1])))
                passive = passive and not data.actuator_force.any()
        except SimulationError as error:
            message, _, remedy = str(error).partition("\n")
            rule = UNSTABLE if isinstance(error, UnstableError) else FAILED_STEP
            yield rule.in_model(context.path, message, remedy)
            return

    for text in warnings:
        line = "; ".join(text.split("\n"))
        yield WARNING.in_model(context.path, f"within {steps} steps MuJoCo warns: {line}")
    # A joint beyond its range and geoms that penetrate each other store energy; other rules report them.
    strained = joints_beyond_range(context, None) or deep_penetrations(context, None)
    if passive and not strained and _conserves_energy(context.model):
        yield from _energy_gain(context, np.array(energies))


@contextmanager
def _energy_flags(model: mujoco.MjModel) -> Generator[None]:
    """Lets MuJoCo compute the energy, which does not affect the motion, and restores all flags of `model`."""
    enabled, disabled = model.opt.enableflags, model.opt.disableflags
    model.opt.enableflags |= ENERGY
    try:
        yield
    finally:
        model.opt.enableflags, model.opt.disableflags = enabled, disabled


def _conserves_energy(model: mujoco.MjModel) -> bool:
    """Returns whether nothing in `model` can do work that MuJoCo's energy does not include."""
    return not (
        model.nplugin
        or model.nflex
        or model.nmocap
        or model.body_gravcomp.any()
        or model.geom_surfacevel.any()
        or model.geom_adhesion.any()
        or model.opt.wind.any()
    )


def _energy_gain(context: CheckContext, energies: np.ndarray) -> Iterator[Finding]:
    """Yields a finding if potential plus kinetic energy, `(n, 2)` [J], ever exceeds its initial value."""
    model, total, kinetic = context.model, energies.sum(axis=1), energies[:, 1]
    fall = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity) * model.stat.meansize)
    gain, scale = float(total.max() - total[0]), float(kinetic.max()) + fall
    if gain <= context.thresholds.energy_gain * scale or not np.isfinite(gain):
        return
    message = (
        f"nothing drives it, but its energy grows by {gain:.3g} J, {100 * gain / scale:.0f} % of its energy scale: "
        f"from {total[0]:.4g} to {total.max():.4g} J"
    )
    remedy = "use a smaller timestep, or integrator rk4 or implicitfast; look for negative damping and initial overlaps"
    yield ENERGY_GAIN.in_model(context.path, message, remedy)
