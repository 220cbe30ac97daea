"""MuJoCo Warp as an engine: many simulations at once, in single precision, on a GPU or a CPU.

Simulations are worlds that a device steps at once, all of them at the same step.
"""

import copy
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import partial
from math import ceil
from typing import Any

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import SimulationError, UnstableWorldError, UsageError, option, quoted
from mjrun.model import state
from mjrun.physics.engine import SHORT_BLOCK_STEPS, Fields, Models, RolloutBlock, block_steps, models_of
from mjrun.physics.stepper import RK4
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
# The marks that higher limits prevent, and those of approximations, which MuJoCo makes without a report.
CONTACT_LIMITS, CONSTRAINT_LIMITS = ("BROADPHASE", "NARROWPHASE", "CCD"), ("NEFC", "NJMAX_NNZ")
APPROXIMATIONS = ("ITERATIONS", "LS_ITERATIONS", "EPA_HORIZON")
CONTACT, PASSIVE = 1, 4  # bits of a contact's type in mujoco_warp for contacts that MuJoCo has too


@dataclass(frozen=True)
class RequiredSizes:
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
        with self.active():
            if self._model.opt.integrator == RK4 and any(model.actuator_delay.any() for model in every):
                raise NotImplementedError("its RK4 reads delayed controls once per step, not in every stage")
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

    @contextmanager
    def active(self) -> Generator[None]:
        """Makes Warp use the device of these worlds within the context, and converts its errors."""
        with self._device.refusals(self.count), self._device.active():
            yield

    def compile(self) -> None:
        """Takes the first step, for which Warp compiles all uncached kernels, and records graphs of a step.

        A graph launches all kernels at once instead of one by one from Python, as in mujoco_warp's testspeed.

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or this number of worlds.
        """
        with self.active():
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
        """Returns the worlds with positions, velocities or accelerations that are not finite or too large, `(n,)`."""
        vectors = np.hstack([getattr(self._data, name).numpy() for name in ("qpos", "qvel", "qacc")])
        return ~(abs(vectors) <= mujoco.mjMAXVAL).all(axis=1)

    def states(self) -> np.ndarray:
        """Returns the integration states of all worlds, `(n, nstate)`."""
        parts = [array.numpy().reshape(self.count, -1) for array, _ in self._state_arrays()]
        return np.hstack(parts).astype(float)

    def demand(self) -> RequiredSizes:
        """Returns the sizes that the last step needed."""
        return RequiredSizes(
            contacts=int(self._data.nacon.numpy()[0]),
            candidates=int(self._data.ncollision.numpy()[0]),
            constraints=self._data.nefc.numpy(),
            iterations=self._data.solver_niter.numpy(),
        )

    def required_limits(self, running: np.ndarray) -> tuple[int, int]:
        """Returns nconmax and njmax, each doubled if the `running` worlds, `(n,)` bool, have exceeded it."""
        demand, marks = self.demand(), self._data.overflow.numpy()[running]
        contacts = max(demand.contacts, demand.candidates) > self._data.naconmax  # of all worlds together
        contacts |= bool((marks & self._bits(CONTACT_LIMITS)).any())
        constraints = bool((demand.constraints > self.njmax)[running].any())
        constraints |= bool((marks & self._bits(CONSTRAINT_LIMITS)).any())
        return self.nconmax << contacts, self.njmax << constraints

    def omissions(self) -> Mapping[int, str]:
        """Returns a sentence for each world in which mujoco_warp omitted what no limit in `required_limits` allows."""
        marks = self._data.overflow.numpy() & ~self._bits((*CONTACT_LIMITS, *CONSTRAINT_LIMITS, *APPROXIMATIONS))
        return {int(index): self._messages(int(marks[index]), {})[0] for index in np.flatnonzero(marks)}

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
        return self._messages(marks, limits)

    def _bits(self, names: Sequence[str]) -> int:
        return sum(self._device.library.OverflowType[name].value for name in names)

    def _messages(self, marks: int, limits: Mapping[str, object]) -> list[str]:
        known = self._device.library.OverflowType  # iterates over single bits
        texts = [overflow_message(mark.name, limits) for mark in known if marks & mark.value]
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
        for array, columns in self._state_arrays():
            array.assign(starts[:, columns].reshape(array.numpy().shape))

    def _state_arrays(self) -> Iterator[tuple[Any, slice]]:
        """Yields the arrays that form an integration state, and their columns there, in order."""
        for name, columns in state.fields(state.sizes(self._model)).items():
            yield getattr(self._data, name), columns

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
        self._limits = dict[tuple[int, ...], tuple[int, int]]()  # nconmax and njmax that models needed, by their sizes

    def rollout(
        self,
        models: Models,
        starts: np.ndarray,
        controls: np.ndarray | None,
        steps: int,
        record: Sequence[str],
        every: int = 1,
        running: np.ndarray | None = None,
    ) -> Iterator[RolloutBlock]:
        """Implements `Engine.rollout` for models of one `PerWorldFields.group`; instability is detected at rows only.

        Rows whose contacts or constraints exceed their memory are simulated again with twice as much.

        Raises:
          UsageError: mujoco_warp cannot simulate such models, or record a field.
          DeviceMemoryError: these simulations do not fit in the memory of the device together.
        """
        models = models_of(models, len(starts))
        model = models[0]
        size = (model.nbody, model.nv, model.ngeom, model.nflex)

        def opened(starts: np.ndarray, nconmax: int | None, njmax: int | None) -> WarpWorlds:
            worlds = WarpWorlds(self._device, models, starts, nconmax, njmax)
            worlds.require(record)
            if steps:
                worlds.compile()
                worlds.restart()
            self._limits[size] = worlds.nconmax, worlds.njmax
            return worlds

        worlds = opened(starts, *self._limits.get(size, (None, None)))
        walk = _Walk(worlds, opened, model, controls, record, running)
        del worlds  # the walk may replace them
        rows = [*range(0, steps, every), steps]
        longest = block_steps(model, record, len(starts))
        size_of_block = max(1, (longest if running is None else min(longest, SHORT_BLOCK_STEPS)) // every)
        for first in range(0, len(rows), size_of_block):
            yield walk.block(rows[first : first + size_of_block])
            if not walk.running.any():
                break


class _Walk:
    """The worlds of a rollout, from row to row.

    Args:
      opened: returns worlds with other starts and limits.
    """

    def __init__(
        self,
        worlds: WarpWorlds,
        opened: Callable[[np.ndarray, int, int], WarpWorlds],
        model: mujoco.MjModel,
        controls: np.ndarray | None,
        record: Sequence[str],
        running: np.ndarray | None,
    ) -> None:
        self._worlds, self._opened, self._controls, self._record = worlds, opened, controls, record
        self._timestep, self._width = float(model.opt.timestep), worlds.count * model.nu
        self._step, self.running = 0, np.ones(worlds.count, bool) if running is None else running
        self._initial: Fields = {}

    def block(self, rows: Sequence[int]) -> RolloutBlock:
        """Returns the rows at the steps `rows`, which follow those of the block before."""
        step, running, start = self._step, self.running.copy(), self._worlds.states()
        while True:
            block = self._simulated(rows)
            limits = self._worlds.nconmax, self._worlds.njmax
            required = self._worlds.required_limits(self.running)
            if required == limits:
                break
            del self._worlds  # whose memory larger ones need
            self._worlds = self._opened(start, *required)
            self._step, self.running[:] = step, running
        self._initial = self._initial or {name: part[:, :1].copy() for name, part in block.fields.items()}
        return replace(block, initial=self._initial)

    def _simulated(self, rows: Sequence[int]) -> RolloutBlock:
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
                failures |= self._failures(before, row)
                counts += self.running
                self._worlds.forward()
                for name in self._record:
                    values[name].append(self._worlds.read(name))
        fields = {name: np.stack(parts, axis=1) for name, parts in values.items()}
        return RolloutBlock(np.array(rows), fields, {}, counts, failures)

    def _upload(self, last: int) -> object:
        """Uploads the controls from the current step to step `last`, `(steps, n, nu)`; the last ones hold."""
        if self._controls is None:
            return None
        index = np.minimum(np.arange(self._step, last + 1), self._controls.shape[1] - 1)
        return self._worlds.upload(self._controls[:, index].swapaxes(0, 1))

    def _failures(self, before: int, row: int) -> dict[int, SimulationError]:
        """Returns the errors of the worlds that failed between two rows, and ends them."""
        errors: dict[int, SimulationError] = {
            index: SimulationError(before, before * self._timestep, text)
            for index, text in self._worlds.omissions().items()
        }
        errors |= {
            int(index): UnstableWorldError(before, row, self._timestep)
            for index in np.flatnonzero(self._worlds.unstable())
        }
        errors = {index: error for index, error in errors.items() if self.running[index]}
        self.running[[*errors]] = False
        return errors
