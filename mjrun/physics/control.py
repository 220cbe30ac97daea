"""The inputs of a simulation, step by step: controls from constants, tables, noise and Python; and pushes of bodies.

Controls belong to an instant: those set at step k act from step k to k + 1, and on the quantities derived at k.
"""

import inspect
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from itertools import count
from typing import Any, Protocol

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import (
    ControllerError,
    UnknownNameError,
    UsageError,
    clean,
    concerning,
    described_type,
    listing,
    option,
)
from mjrun.model import state
from mjrun.model.names import control_names, identify, names
from mjrun.options.simulation import Push
from mjrun.physics.controller_analysis import access_of
from mjrun.physics.recorded_states import RecordedInputs
from mjrun.physics.timed_rows import TimedRows
from mjrun.timeline import nearest, seconds

NEVER = 2**62  # a step beyond every simulation
NOISE_BLOCK = 1024  # steps of noise drawn in one call
NOISE_STREAM = 1  # separates the noise on controls from other noise of the same seed

Controller = Callable[[mujoco.MjModel, mujoco.MjData], Any]


class KnownControls(Protocol):
    """Controls that are known in advance."""

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Writes the known controls of the steps from `first` into `ctrl` `(n, nu)`."""
        ...


class PeriodicController:
    """A controller, called every `period` [s] with the model and an MjData in which every field belongs to one instant.

    It writes `data.ctrl`, or any other input (applied forces, mocap poses, active equalities), or returns the controls
    `(nu,)`. The forces and accelerations that it reads follow from the controls in force until then.

    Args:
      controller: called with (model, data); a method `reset` is called first, with (model, data) or nothing.
      period: the period, at least a timestep; its multiples are rounded to the nearest steps.

    Attributes:
      name: the name of the controller, for messages.
      is_always_due: whether it is called at every step.

    Raises:
      ControllerError: it does not take (model, data).
      UsageError: `period` is shorter than a timestep.
    """

    def __init__(self, controller: Controller, period: Fraction, timestep: Fraction) -> None:
        self._controller = controller
        self._reset = getattr(controller, "reset", None)
        self._ratio = period / timestep
        self._stride = self._ratio.numerator if self._ratio.denominator == 1 else 0
        self.is_always_due = self._stride == 1
        self.name = getattr(controller, "__qualname__", type(controller).__qualname__)
        if self._ratio < 1:
            raise UsageError(
                f"{option('control_dt')} {float(period):g} is shorter than the timestep, {float(timestep):g} s\n"
                "a controller can be called at most once per step"
            )
        if not _takes(controller, 2):
            raise ControllerError(f"the controller {self.name} must take (model, data)")
        self._access = access_of(controller)
        if self._reset is not None and access_of(self._reset) is None and _takes(self._reset, 2):
            self._access = None  # it may remember the data that its reset is called with

    @property
    def fields(self) -> frozenset[str] | None:
        """The fields of `data` that it uses; None if it may use others."""
        return self._access.fields if self._access and self._access.holds else None

    @property
    def may_change_fields(self) -> bool:
        """True if `fields` may change during the simulation, as the controller calls other functions."""
        return self._access is not None and bool(self._access.called)

    def next_change(self, step: int) -> int:
        """Returns the first step after `step` at which the controller is called."""
        if self._stride:
            return step - step % self._stride + self._stride
        return nearest(math.ceil((step + Fraction(1, 2)) / self._ratio) * self._ratio)

    def calls_after(self, step: int) -> Iterator[int]:
        """Returns the steps after `step` at which the controller is called."""
        first = self.next_change(step)
        return count(first, self._stride) if self._stride else self._irregular_calls(first)

    def _irregular_calls(self, step: int) -> Iterator[int]:
        while True:
            yield step
            step = self.next_change(step)

    def is_due(self, step: int) -> bool:
        """Returns whether the controller is called at `step`."""
        return self.is_always_due or step == 0 or self.next_change(step - 1) == step

    def reset(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Calls the controller's own `reset`, if it has one, at the start of a simulation."""
        if self._reset is not None:
            arguments = (model, data) if _takes(self._reset, 2) else ()
            try:
                self._reset(*arguments)
            except (Exception, SystemExit) as error:
                raise self._failed("reset", error) from error

    def caller(self, model: mujoco.MjModel, data: mujoco.MjData, guarded: Sequence[str]) -> Callable[[int], None]:
        """Returns a function that calls the controller at a step; the controller sets the inputs in `data`.

        Args:
          guarded: fields of `data` that keep their bytes.

        Raises:
          ControllerError: raised by the function; the controller failed, returned invalid controls, or changed the
            state.
        """
        ctrl, norm, is_redirected = data.ctrl, mujoco.mju_norm, hasattr(self._controller, "forwards_to")
        controller = getattr(self._controller, "forwards_to", self._controller)
        fields = [(name, getattr(data, name)) for name in guarded]
        contents = [values.tobytes for _, values in fields]

        def call(step: int) -> None:
            before = [content() for content in contents] if contents else None
            output = sys.stdout
            try:
                if is_redirected:  # here, as a call of the RedirectedFunction takes longer
                    sys.stdout = sys.stderr
                controls = controller(model, data)
            except (Exception, SystemExit) as error:
                raise self._failed(_when(data, step), error) from error
            finally:
                if is_redirected:
                    sys.stdout = output
            if controls is not None:
                ctrl[:] = self._checked(model, controls, data, step)
            if before and before != [content() for content in contents]:
                for (name, values), content in zip(fields, before, strict=True):
                    self._put_back(name, values, content, _when(data, step))

            if not norm(ctrl) < math.inf and (bad := np.flatnonzero(~np.isfinite(ctrl))).size:
                actuator = control_names(model)[int(bad[0])]
                value = f"{ctrl[bad[0]]} {_when(data, step)}"
                raise ControllerError(f"the controller {self.name} set {clean(actuator)} to {value}")

        return call

    def _put_back(self, name: str, values: np.ndarray, content: bytes, when: str) -> None:
        """Restores a field that the controller overwrote; a state that differs is an error."""
        before = np.frombuffer(content, values.dtype).reshape(values.shape)
        if name in state.MOTION and not np.array_equal(before, values, equal_nan=True):
            raise ControllerError(
                f"the controller {self.name} changed the state {when}\n"
                "it may set ctrl, qfrc_applied, xfrc_applied, eq_active, mocap_pos, mocap_quat and userdata"
            )
        values[:] = before

    def _checked(self, model: mujoco.MjModel, controls: Any, data: mujoco.MjData, step: int) -> np.ndarray:
        try:
            ctrl = np.asarray(controls, float)
        except (TypeError, ValueError):
            value = f"{described_type(controls)} {_when(data, step)}"
            raise ControllerError(f"the controller {self.name} returned {value}, not numbers") from None
        if ctrl.shape == (model.nu,) or (ctrl.shape == () and model.nu == 1):
            return ctrl
        actuators = listing(control_names(model))
        shape = f"shape {ctrl.shape} {_when(data, step)}; the model takes ({model.nu},)"
        raise ControllerError(
            f"the controller {self.name} returned {shape}\n"
            + (f"actuators: {actuators}" if model.nu else "no actuators")
        )

    def _failed(self, when: str, error: BaseException) -> ControllerError:
        return ControllerError.of(f"the controller {self.name}, {when},", error)


def _when(data: mujoco.MjData, step: int) -> str:
    return f"at step {step}, time {data.time:.9g} s"


def _takes(function: Callable[..., Any], count: int) -> bool:
    """Returns whether `function` accepts `count` arguments; True if its signature is unknown."""
    try:
        inspect.signature(function).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # no signature
        return True
    return True


class ControlNoise:
    """Gaussian noise on every control: white, or an Ornstein-Uhlenbeck process.

    The noise of any step can be requested at any time, and depends on the seed and the step alone.

    Args:
      std: standard deviation, in the actuators' own units.
      smooth: correlation time of the process [s]; 0 is white noise, independent at every step.
      seed: the seed of the noise.
      timestep: the timestep of the simulation [s].
      actuators: the number of controls.
    """

    def __init__(self, std: float, smooth: float, seed: int, timestep: float, actuators: int) -> None:
        self._std, self._seed, self._actuators = std, seed, actuators
        self._keep = math.exp(-timestep / smooth) if smooth else 0.0
        self._last = [np.zeros(actuators)]  # the value before each block
        self._block, self._values = -1, np.empty(0)

    def rows(self, first: int, count: int) -> np.ndarray:
        """Returns the noise of the steps from `first`, `(count, nu)`."""
        out = np.empty((count, self._actuators))
        step = first
        while step < first + count:
            block, at = divmod(step, NOISE_BLOCK)
            part = self._noise(block)[at : at + first + count - step]
            out[step - first : step - first + len(part)] = part
            step += len(part)
        return out

    def _noise(self, block: int) -> np.ndarray:
        for wanted in range(min(block, len(self._last) - 1), block + 1):
            if wanted != self._block:
                self._block, self._values = wanted, self._draw(wanted)
                if wanted + 1 == len(self._last):
                    self._last.append(self._values[-1].copy())  # a view would keep the whole block
        return self._values

    def _draw(self, block: int) -> np.ndarray:
        generator = np.random.default_rng([self._seed, NOISE_STREAM, block])
        values = self._std * generator.standard_normal((NOISE_BLOCK, self._actuators))
        if self._keep:
            value = self._last[block]
            values[block == 0 :] *= math.sqrt(1 - self._keep**2)  # a stationary process from the start
            for row in values:
                row += self._keep * value
                value = row
        return values


class ControlTable:
    """Controls by time. Actuators without a column keep their constant control.

    Args:
      rows: the controls of the driven actuators.
      actuators: the indices of these actuators.
    """

    def __init__(self, rows: TimedRows, actuators: Sequence[int]) -> None:
        self._rows, self._actuators = rows, np.array(actuators)

    @property
    def end(self) -> float:
        """The time of the last row [s]."""
        return self._rows.end

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Writes the controls of the steps from `first` into their columns of `ctrl` `(n, nu)`."""
        times = np.asarray(seconds(np.arange(first, first + len(ctrl)), timestep), float)
        ctrl[:, self._actuators] = self._rows.at(times, float(timestep))


class ControlArray:
    """Controls step by step, `(steps, nu)`: the first row acts at step 0; the last one holds to the end."""

    def __init__(self, values: np.ndarray) -> None:
        self._values = values

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Writes the controls of the steps from `first` into `ctrl` `(n, nu)`."""
        ctrl[:] = self._values[np.minimum(np.arange(first, first + len(ctrl)), len(self._values) - 1)]


@dataclass
class ControlSources:
    """All inputs of a simulation: a table of controls, noise on them, a controller, and constants for the rest.

    Attributes:
      timestep: the exact timestep of the simulation [s].
      constant: controls `(nu,)` of actuators without another source; the stepper stores those of the controller here.
      table, noise, controller: sources of controls, or None.
      inputs: inputs other than controls, if they are known in advance.
    """

    timestep: Fraction
    constant: np.ndarray
    table: KnownControls | None = None
    noise: ControlNoise | None = None
    controller: PeriodicController | None = None
    inputs: RecordedInputs | None = None

    @property
    def varies(self) -> bool:
        """True where the controls change from step to step without a controller."""
        return self.table is not None or self.noise is not None

    def rows(self, first: int, count: int) -> np.ndarray:
        """Returns the controls of the steps from `first`, `(count, nu)`, until the next call of the controller."""
        ctrl = np.tile(self.constant, (count, 1))
        if self.table:
            self.table.apply(ctrl, first, self.timestep)
        if self.noise:
            ctrl += self.noise.rows(first, count)
        return ctrl


WORLD = 0  # the body that cannot be pushed


@dataclass(frozen=True)
class _TimedPush:
    """A push of a body on some steps, at its centre of mass or at a site on it."""

    text: str
    body: int
    site: int | None
    force: np.ndarray
    steps: range


class PushForces:
    """The forces of all pushes of a simulation; those that overlap add up.

    Step k is pushed when round(at / timestep) ≤ k < round((at + duration) / timestep).

    Args:
      timestep: [s], exact.

    Attributes:
      model: model of the bodies.

    Raises:
      UsageError: an object does not exist or cannot be pushed, or a push is too short for any step.
    """

    def __init__(self, model: mujoco.MjModel, pushes: Sequence[Push], timestep: Fraction) -> None:
        self.model = model
        self._pushes: list[_TimedPush] = []
        for index, push in enumerate(pushes):
            with concerning("push", index):
                body, site = _find(model, push.target)
                self._pushes.append(
                    _TimedPush(clean(str(push)), body, site, np.array(push.force), _steps(push, timestep))
                )

    @cached_property
    def _scratch(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    def __bool__(self) -> bool:
        return bool(self._pushes)

    def next_change(self, step: int) -> int:
        """Returns the first step after `step` at which `on_bodies` may change."""
        if any(push.site is not None and step in push.steps for push in self._pushes):
            return step + 1  # the lever of a force at a site turns with the body
        edges = [edge for push in self._pushes for edge in (push.steps.start, push.steps.stop)]
        return min((edge for edge in edges if edge > step), default=NEVER)

    def on_bodies(self, data: mujoco.MjData, step: int) -> np.ndarray:
        """Returns the forces and torques `(nbody, 6)` [N, N·m] at `step`, in the order of `xfrc_applied`.

        A force F at a site s acts on a body with its centre of mass at c as F with the torque (s - c) × F.

        Args:
          data: an MjData in the state at `step`; its derived fields are not used.
        """
        wrenches = np.zeros((self.model.nbody, 6))
        active = [push for push in self._pushes if step in push.steps]
        if any(push.site is not None for push in active):
            self._place(data)
        for push in active:
            wrenches[push.body, :3] += push.force
            if push.site is not None:
                lever = self._scratch.site_xpos[push.site] - self._scratch.xipos[push.body]
                wrenches[push.body, 3:] += np.cross(lever, push.force)
        return wrenches

    def remarks(self, steps: int) -> list[str]:
        """Returns a warning for each push that has no effect in a simulation of `steps` steps."""
        texts: list[str] = []
        for push in self._pushes:
            if push.steps.start >= steps:
                begin = f"begins at step {push.steps.start}, and the simulation has {steps} step{'s' * (steps != 1)}"
                texts.append(f"{option('push')} {push.text} does nothing: it {begin}")
            elif self.model.body_treeid[push.body] < 0:
                texts.append(f"{option('push')} {push.text} does nothing: no joint lets the body move")
        return texts

    def _place(self, data: mujoco.MjData) -> None:
        """Computes the positions of bodies and sites in the state of `data`."""
        scratch = self._scratch
        scratch.qpos[:], scratch.mocap_pos[:], scratch.mocap_quat[:] = data.qpos, data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(self.model, scratch)


def _find(model: mujoco.MjModel, target: str) -> tuple[int, int | None]:
    """Returns the body that `target` names, and the site on it if `target` is one."""
    kind, colon, name = target.partition(":")
    if colon and kind in ("body", "site"):
        index = identify(model, kind, name)
    elif target in (bodies := names(model, "body")):
        kind, index = "body", bodies.index(target)
    elif target in (sites := names(model, "site")):
        kind, index = "site", sites.index(target)
    else:
        movable = [site for site, body in zip(sites, model.site_bodyid, strict=True) if body != WORLD]
        named = [*bodies[1:], *movable]
        valid = list(dict.fromkeys(named))
        raise UnknownNameError("body or site", target, valid, option("push"), plural="bodies and sites")
    body = int(model.site_bodyid[index]) if kind == "site" else index
    if body == WORLD:
        what = f"the site {clean(target)} is fixed to the world" if kind == "site" else "the target is the world"
        raise UsageError(f"{option('push')}: {what}, which a force cannot move")
    return body, index if kind == "site" else None


def _steps(push: Push, timestep: Fraction) -> range:
    steps = range(nearest(push.at / timestep), nearest((push.at + push.duration) / timestep))
    if not steps:
        raise UsageError(
            f"{option('push')} {clean(str(push))} is too short: it contains no step of {float(timestep):g} s\n"
            f"set its duration to {float(timestep):g} s or longer"
        )
    return steps
