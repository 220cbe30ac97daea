"""Python that drives a simulation: a controller, called at regular steps."""

import inspect
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import ControllerError, UsageError, clean, listing, option
from mjrun.model import state
from mjrun.model.names import control_names
from mjrun.timeline import nearest

Controller = Callable[[mujoco.MjModel, mujoco.MjData], Any]


class PeriodicController:
    """A controller, called every `period` [s] with the model and an instant of which every field belongs together.

    It writes `data.ctrl`, or any other input (applied forces, mocap poses, active equalities), or returns
    the controls `(nu,)`. Forces and accelerations that it sees are those of the controls in force until then.

    Args:
      controller: called with (model, data); a method `reset` is called first, with (model, data) or nothing.
      period: at least a timestep; its multiples fall on the nearest steps.

    Raises:
      ControllerError: it does not take (model, data).
      UsageError: `period` is shorter than a timestep.
    """

    def __init__(self, controller: Controller, period: Fraction, timestep: Fraction) -> None:
        self._controller, self._ratio = controller, period / timestep
        self.name = getattr(controller, "__qualname__", type(controller).__qualname__)
        if self._ratio < 1:
            raise UsageError(
                f"{option('control_dt')} {float(period):g} is shorter than the timestep, {float(timestep):g} s\n"
                "a controller can be called once a step at most"
            )
        if not _takes(controller, 2):
            raise ControllerError(f"the controller {self.name} must take (model, data)")

    def next_call(self, step: int) -> int:
        """The first step after `step` at which the controller is called."""
        return nearest(math.ceil((step + Fraction(1, 2)) / self._ratio) * self._ratio)

    def is_due(self, step: int) -> bool:
        """Whether the controller is called at `step`."""
        return step == 0 or self.next_call(step - 1) == step

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Tells the controller that a simulation begins."""
        reset = getattr(self._controller, "reset", None)
        if reset is not None:
            arguments = (model, data) if _takes(reset, 2) else ()
            self._call("reset", reset, *arguments)

    def act(self, model: mujoco.MjModel, data: mujoco.MjData, step: int) -> None:
        """Lets the controller set the inputs in `data`.

        Raises:
          ControllerError: it failed, or what it gave cannot be taken.
        """
        before = state.save(model, data, spec=state.PHYSICS)
        when = f"at step {step}, time {data.time:.9g} s"
        controls = self._call(when, self._controller, model, data)
        if controls is not None:
            data.ctrl[:] = self._checked(model, controls, when)
        if not np.array_equal(before, state.save(model, data, spec=state.PHYSICS), equal_nan=True):
            raise ControllerError(
                f"the controller {self.name} changed the state {when}\n"
                "it may set ctrl, qfrc_applied, xfrc_applied, eq_active, mocap_pos, mocap_quat and userdata"
            )
        bad = np.flatnonzero(~np.isfinite(data.ctrl))
        if bad.size:
            actuator = control_names(model)[bad[0]]
            raise ControllerError(f"the controller {self.name} set {clean(actuator)} to {data.ctrl[bad[0]]} {when}")

    def _checked(self, model: mujoco.MjModel, controls: Any, when: str) -> np.ndarray:
        try:
            ctrl = np.asarray(controls, float)
        except (TypeError, ValueError):
            kind = type(controls).__name__
            raise ControllerError(f"the controller {self.name} returned a {kind} {when}, not numbers") from None
        if ctrl.shape == (model.nu,) or (ctrl.shape == () and model.nu == 1):
            return ctrl
        actuators = listing(control_names(model))
        shape = f"shape {ctrl.shape} {when}; the model takes ({model.nu},)"
        raise ControllerError(
            f"the controller {self.name} returned {shape}\n"
            + (f"actuators: {actuators}" if model.nu else "no actuators")
        )

    def _call(self, when: str, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except (Exception, SystemExit) as error:
            raise ControllerError.of(f"the controller {self.name}, {when},", error) from error


def _takes(function: Callable[..., Any], count: int) -> bool:
    """Whether `function` can be called with `count` arguments, as far as it says."""
    try:
        inspect.signature(function).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # it does not say
        return True
    return True
