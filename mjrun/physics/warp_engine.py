"""MuJoCo Warp as an engine: many simulations at once, in single precision, on a GPU or a CPU.

Simulations are worlds that a device steps at once, all of them at the same step.
"""

import copy
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import fields
from functools import partial
from math import ceil
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import MjrunWarning, SimulationError, UsageError, option, quoted
from mjrun.model import state
from mjrun.physics.engine import SHORT_BLOCK_STEPS, Fields, RolloutBlock, block_steps, models_of
from mjrun.physics.warp_device import PerWorldFields, WarpDevice

CHEAPER = "the omitted ones make a step cheaper than a complete one"
CONSTRAINTS = f"a world holds at most {{njmax}} constraints; {CHEAPER}"
CONTACTS = f"a world holds at most {{nconmax}} contacts; {CHEAPER}"
# Overflow marks of mujoco_warp: their meaning and the remedy.
OVERFLOWS: Mapping[str, tuple[str, str]] = {
    "NEFC": (CONSTRAINTS, f"raise {option('njmax')} to {{constraints}}"),
    "NJMAX_NNZ": (
        f"the constraints' Jacobian exceeds its memory; {CHEAPER}",
        f"raise {option('njmax')} above {{njmax}}",
    ),
    "BROADPHASE": (CONTACTS, f"raise {option('nconmax')} to {{contacts}}"),
    "NARROWPHASE": (CONTACTS, f"raise {option('nconmax')} to {{contacts}}"),
    "CCD": (
        f"a world holds at most {{nconmax}} contacts of convex shapes; {CHEAPER}",
        f"raise {option('nconmax')} above {{nconmax}}",
    ),
    "HFIELD": ("a shape meets too many cells of a height field", "a coarser height field has fewer"),
    "CONTACT_MATCH": ("a contact sensor matches more contacts than mujoco_warp supports", "a narrower one has fewer"),
    "TACTILE": ("a tactile sensor meets more geoms than mujoco_warp supports", "a narrower one has fewer"),
    "EPA_HORIZON": ("a penetration is too deep to be measured accurately", "start without deep penetrations"),
    "ITERATIONS": (
        "the solver has reached its limit of {iterations} iterations",
        f"raise {option('set')} opt.iterations",
    ),
    "LS_ITERATIONS": ("the solver's line search has reached its limit", f"raise {option('set')} opt.ls_iterations"),
}
CONTACT, PASSIVE = 1, 4  # bits of a contact's type in mujoco_warp for contacts that MuJoCo has too
# Parts of an integration state that mujoco_warp stores, in their order in the state.
STATE_FIELDS = (
    ("time", mujoco.mjtState.mjSTATE_TIME),
    ("qpos", mujoco.mjtState.mjSTATE_QPOS),
    ("qvel", mujoco.mjtState.mjSTATE_QVEL),
    ("act", mujoco.mjtState.mjSTATE_ACT),
    ("history", mujoco.mjtState.mjSTATE_HISTORY),
    ("qacc_warmstart", mujoco.mjtState.mjSTATE_WARMSTART),
    ("ctrl", mujoco.mjtState.mjSTATE_CTRL),
    ("qfrc_applied", mujoco.mjtState.mjSTATE_QFRC_APPLIED),
    ("xfrc_applied", mujoco.mjtState.mjSTATE_XFRC_APPLIED),
    ("eq_active", mujoco.mjtState.mjSTATE_EQ_ACTIVE),
    ("mocap_pos", mujoco.mjtState.mjSTATE_MOCAP_POS),
    ("mocap_quat", mujoco.mjtState.mjSTATE_MOCAP_QUAT),
    ("userdata", mujoco.mjtState.mjSTATE_USERDATA),
    ("plastic", mujoco.mjtState.mjSTATE_PLASTIC),
)


@dataclass(frozen=True)
class Demand:
    """The sizes that a step of all worlds needed.

    Attributes:
      contacts: the number of contacts of all worlds together.
      candidates: pairs from broad-phase collision detection, of all worlds together.
      constraints, iterations: the numbers of constraints and of solver iterations of each world, `(n,)`.
    """

    contacts: int
    candidates: int
    constraints: np.ndarray
    iterations: np.ndarray


class WarpWorlds:
    """Worlds on a device, all at the same step; used within `active`.

    Args:
      models: one for all worlds, or one for each, of one `PerWorldFields.group`.
      starts: integration states, `(n, nstate)`.
      nconmax, njmax: maximum numbers of contacts and constraints per world; mujoco_warp estimates them when None.

    Attributes:
      count: the number of worlds.
      nconmax, njmax: maximum numbers of contacts and constraints per world.

    Raises:
      UsageError: mujoco_warp cannot simulate this model, or this number of worlds.
    """

    def __init__(
        self,
        device: WarpDevice,
        models: mujoco.MjModel | Sequence[mujoco.MjModel],
        starts: np.ndarray,
        nconmax: int | None = None,
        njmax: int | None = None,
    ) -> None:
        self.count = len(starts)
        every = models_of(models, self.count)
        self._device, self._model = device, _with_autoreset(every[0])
        self._sample = mujoco.MjData(self._model)  # the shapes of fields
        state.restore(self._model, self._sample, starts[0])
        with self._device.refusals(self.count), self.active():
            self._device_model = PerWorldFields(device).put_models(self._model, every)
            self._device_model.opt.warn_overflow = 0  # it prints from the device, a line for each world and step
            self._data = device.library.put_data(
                self._model, self._sample, nworld=self.count, nconmax=nconmax, njmax=njmax
            )
            self._assign(starts)
            # All arrays, so that a rollout leaves no traces in the next, whatever mujoco_warp stores between steps.
            self._start = [(array, device.warp.clone(array)) for array in self._arrays()]
        self.nconmax, self.njmax = self._data.naconmax // self.count, int(self._data.njmax)
        self._step: Callable[[], None] = partial(device.library.step, self._device_model, self._data)
        self._forward: Callable[[], None] = partial(device.library.forward, self._device_model, self._data)

    def active(self) -> AbstractContextManager[Any]:
        """Makes Warp use the device of these worlds within the context."""
        return self._device.active()

    def compile(self) -> None:
        """Takes the first step, for which Warp compiles all uncached kernels, and records graphs of a step.

        A graph launches all kernels at once instead of one by one from Python, as in mujoco_warp's testspeed.

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or this number of worlds.
        """
        with self._device.refusals(self.count), self.active():
            self._step()
            self._step, self._forward = self._graph(self._step), self._graph(self._forward)
            self.wait()

    def restart(self) -> None:
        """Returns all worlds to their starts."""
        for array, start in self._start:
            self._device.warp.copy(array, start)
        self.wait()

    def step(self) -> None:
        """Begins a step, and may return before it is complete."""
        self._step()

    def forward(self) -> None:
        """Computes the derived fields of the current state."""
        self._forward()

    def wait(self) -> None:
        """Waits until the device is idle."""
        self._device.warp.synchronize_device(self._device.alias)

    def upload(self, values: np.ndarray) -> Any:
        """Returns `values` as a flat array on the device."""
        return self._device.warp.array(values.ravel(), dtype=self._device.warp.float32)

    def set_controls(self, array: Any, offset: int) -> None:
        """Sets the controls of all worlds to n·nu numbers of an uploaded `array` from `offset`."""
        self._device.warp.copy(self._data.ctrl, array, src_offset=offset, count=self.count * self._model.nu)

    def require(self, names: Sequence[str]) -> None:
        """Checks that mujoco_warp has the MjData fields `names`.

        Raises:
          UsageError: it lacks one.
        """
        for name in names:
            if name != "ncon" and not isinstance(getattr(self._data, name, None), self._device.warp.array):
                raise UsageError(f"mujoco_warp does not compute {quoted(name)}\n{option('engine')} c does")

    def read(self, name: str) -> np.ndarray:
        """Returns the MjData field `name` of every world, `(n, …)`, with MuJoCo's shape and type."""
        sample = np.asarray(getattr(self._sample, name))
        if name == "ncon":
            return self._contacts()
        values = getattr(self._data, name).numpy()
        if name == "solver_niter":  # mujoco_warp counts all islands together
            values = np.pad(values[:, None], ((0, 0), (0, sample.size - 1)))
        return values.reshape(self.count, *sample.shape).astype(sample.dtype)

    def unstable(self) -> np.ndarray:
        """Returns the worlds whose positions or velocities are not finite or too large, as a mask `(n,)`."""
        vectors = np.hstack([self._data.qpos.numpy(), self._data.qvel.numpy()])
        return ~(abs(vectors) <= mujoco.mjMAXVAL).all(axis=1)

    def demand(self) -> Demand:
        """Returns the sizes that the last step needed."""
        return Demand(
            contacts=int(self._data.nacon.numpy()[0]),
            candidates=int(self._data.ncollision.numpy()[0]),
            constraints=self._data.nefc.numpy(),
            iterations=self._data.solver_niter.numpy(),
        )

    def overflows(self, contacts: int = 0, constraints: int = 0) -> list[str]:
        """Returns a sentence for each overflow since the start, with the remedy.

        Args:
          contacts: maximum number of contacts in all worlds together, if known.
          constraints: maximum number of constraints in one world, if known.
        """
        marks = int(np.bitwise_or.reduce(self._data.overflow.numpy()))
        limits = {
            "nconmax": self.nconmax,
            "njmax": self.njmax,
            "contacts": max(ceil(contacts / self.count), self.nconmax + 1),
            "constraints": max(constraints, self.njmax + 1),
            "iterations": self._model.opt.iterations,
        }
        known = self._device.library.OverflowType
        single = [mark for mark in known if mark.value and not mark.value & (mark.value - 1)]
        texts = [overflow_message(mark.name, limits) for mark in single if marks & mark.value]
        return list(dict.fromkeys(texts))

    def _graph(self, launch: Callable[[], None]) -> Callable[[], None]:
        """Records the kernels that a function launches, without running them; returns a function that launches all."""
        warp = self._device.warp
        with warp.ScopedCapture() as capture:
            launch()
        return partial(warp.capture_launch, capture.graph)

    def _contacts(self) -> np.ndarray:
        """Returns the number of contacts in each world, `(n,)`."""
        contact, count = self._data.contact, min(int(self._data.nacon.numpy()[0]), self._data.naconmax)
        counted = contact.type.numpy()[:count] & (CONTACT | PASSIVE) != 0
        return np.bincount(contact.worldid.numpy()[:count][counted], minlength=self.count).astype(np.int32)

    def _assign(self, starts: np.ndarray) -> None:
        """Puts each world into its start."""
        for name, part in STATE_FIELDS:
            array = getattr(self._data, name)
            if array.size:
                values = np.empty((self.count, state.size(self._model, int(part))))
                for start, row in zip(starts, values, strict=True):
                    mujoco.mj_extractState(self._model, start, state.STATE, row, int(part))
                array.assign(values.reshape(array.numpy().shape))

    def _arrays(self) -> list[Any]:
        """Returns the arrays that a step uses from the one before; contacts and constraints are recomputed."""
        values = [getattr(self._data, field.name) for field in fields(self._data)]
        return [value for value in values if isinstance(value, self._device.warp.array) and value.size]


def overflow_message(mark: str, limits: Mapping[str, object]) -> str:
    """Returns the meaning of an overflow mark of mujoco_warp, and the remedy."""
    if mark not in OVERFLOWS:
        return f"mujoco_warp reports an overflow: {mark.lower()}"
    meaning, remedy = OVERFLOWS[mark]
    return f"{meaning.format_map(limits)}: {remedy.format_map(limits)}"


def _with_autoreset(model: mujoco.MjModel) -> mujoco.MjModel:
    """Returns a copy of `model` without the flag that turns automatic resets off, which mujoco_warp refuses."""
    changed = copy.copy(model)
    changed.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return changed


class WarpEngine:
    """An `Engine` of models that differ only in the fields of `PerWorldFields`."""

    def __init__(self, device: WarpDevice) -> None:
        self._device = device

    def rollout(
        self,
        models: mujoco.MjModel | Sequence[mujoco.MjModel],
        starts: np.ndarray,
        controls: np.ndarray | None,
        steps: int,
        record: Sequence[str],
        every: int = 1,
        running: np.ndarray | None = None,
    ) -> Iterator[RolloutBlock]:
        """Implements `Engine.rollout` for models of one `PerWorldFields.group`; instability is detected at rows only.

        An overflow is a warning.

        Raises:
          UsageError: mujoco_warp cannot simulate such models, or record a field.
        """
        model = models_of(models, len(starts))[0]
        worlds = WarpWorlds(self._device, models, starts)
        worlds.require(record)
        if steps:
            worlds.compile()
            worlds.restart()
        walk = _Walk(worlds, model, controls, record, running)
        rows = [*range(0, steps, every), steps]
        longest = block_steps(model, record, len(starts))
        size = max(1, (longest if running is None else min(longest, SHORT_BLOCK_STEPS)) // every)
        for first in range(0, len(rows), size):
            yield walk.block(rows[first : first + size])
            if not walk.running.any():
                break
        for text in worlds.overflows():
            warnings.warn(text, MjrunWarning, stacklevel=2)


class _Walk:
    """The worlds of a rollout, from row to row."""

    def __init__(
        self,
        worlds: WarpWorlds,
        model: mujoco.MjModel,
        controls: np.ndarray | None,
        record: Sequence[str],
        running: np.ndarray | None,
    ) -> None:
        self._worlds, self._controls, self._record = worlds, controls, record
        self._timestep, self._width = float(model.opt.timestep), worlds.count * model.nu
        self._step, self.running = 0, np.ones(worlds.count, bool) if running is None else running
        self._initial: Fields = {}

    def block(self, rows: Sequence[int]) -> RolloutBlock:
        """Returns the rows at the steps `rows`, which follow those of the block before."""
        values: dict[str, list[np.ndarray]] = {name: [] for name in self._record}
        counts, failures = np.zeros(self._worlds.count, int), dict[int, SimulationError]()
        with self._worlds.active():
            first, uploaded = self._step, self._upload(rows[-1])
            for row in rows:
                before = self._step
                for step in range(before, row + 1):
                    if uploaded is not None:
                        self._worlds.set_controls(uploaded, (step - first) * self._width)
                    if step < row:
                        self._worlds.step()
                self._step = row
                failures |= self._unstable(before, row)
                counts += self.running
                self._worlds.forward()
                for name in self._record:
                    values[name].append(self._worlds.read(name))
        fields = {name: np.stack(parts, axis=1) for name, parts in values.items()}
        self._initial = self._initial or {name: part[:, :1].copy() for name, part in fields.items()}
        return RolloutBlock(np.array(rows), fields, self._initial, counts, failures)

    def _upload(self, last: int) -> object:
        """Uploads the controls from the current step to step `last`, `(steps, n, nu)`; the last ones hold."""
        if self._controls is None:
            return None
        index = np.minimum(np.arange(self._step, last + 1), self._controls.shape[1] - 1)
        return self._worlds.upload(self._controls[:, index].swapaxes(0, 1))

    def _unstable(self, before: int, row: int) -> dict[int, SimulationError]:
        """Returns the errors of the worlds that became unstable between two rows."""
        bad = self.running & self._worlds.unstable()
        self.running &= ~bad
        place = f"after step {before}, time {before * self._timestep:.9g} s, and not later than step {row}"
        advice = f"a smaller {option('timestep')} may prevent it; mujoco_warp computes in single precision"
        message = f"the simulation became unstable {place}\n{advice}"
        return {int(index): SimulationError(before, before * self._timestep, message) for index in np.flatnonzero(bad)}
