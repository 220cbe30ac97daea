"""Many copies of a run side by side in MuJoCo Warp, in single precision: on a GPU, or on Warp's own CPU device.

A copy is called a world there. Warp is imported when an engine is made, not before.
"""

import copy
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields
from functools import partial
from importlib.metadata import version
from math import ceil
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import MissingExtraError, SimulationError, UnknownNameError, UsageError, clean
from mjrun.sim.rollout_timing import Clock, Profile, Run, blocks_of

EXTRA, LIBRARY, PACKAGE = "warp", "mujoco_warp", "mujoco-warp"
ON_GPU, ON_CPU = 4096, 8  # worlds, if nobody says how many
LEFT_OUT = "what is left out makes a step cheaper than it is"
# What mujoco_warp marks in a world where something has not fitted: what that means, and what to do.
OVERFLOWS: Mapping[str, tuple[str, str]] = {
    "NEFC": (f"there is room for {{njmax}} constraints in a world; {LEFT_OUT}", "raise --njmax to {constraints}"),
    "NJMAX_NNZ": (f"there is no room for all of the constraints' Jacobian; {LEFT_OUT}", "raise --njmax above {njmax}"),
    "BROADPHASE": (f"there is room for {{nconmax}} contacts in a world; {LEFT_OUT}", "raise --nconmax to {contacts}"),
    "NARROWPHASE": (f"there is room for {{nconmax}} contacts in a world; {LEFT_OUT}", "raise --nconmax to {contacts}"),
    "CCD": (f"there is room for {{nconmax}} contacts of convex shapes; {LEFT_OUT}", "raise --nconmax above {nconmax}"),
    "HFIELD": ("a shape meets too many cells of a height field", "a coarser height field has fewer"),
    "CONTACT_MATCH": ("a contact sensor matches more contacts than mujoco_warp looks at", "a narrower one has fewer"),
    "TACTILE": ("a tactile sensor meets more geoms than mujoco_warp looks at", "a narrower one has fewer"),
    "EPA_HORIZON": ("a penetration is too deep to be measured well", "start without deep penetrations"),
    "ITERATIONS": ("the solver has reached its limit of {iterations} iterations", "raise --set opt.iterations"),
    "LS_ITERATIONS": ("the solver's line search has reached its limit", "raise --set opt.ls_iterations"),
}


@dataclass(frozen=True)
class Most:
    """The most that was needed at once in a rollout.

    Attributes:
      contacts: of all worlds together, or pairs that might touch, if there were more of them.
      constraints: of one world.
    """

    contacts: int = 0
    constraints: int = 0


class WarpEngine:
    """MuJoCo Warp on one device.

    Args:
      device: `cpu`, `cuda:0` and so on; the first GPU, or else `cpu`, when None.
      worlds: copies that are stepped at once; `ON_GPU` or `ON_CPU` when None.
      nconmax, njmax: contacts and constraints that there is room for in a world; mujoco_warp guesses when None.

    Attributes:
      device, device_name: its alias, and what it calls itself.
      worlds: as given, or as chosen.
      version: of mujoco_warp and of Warp.

    Raises:
      MissingExtraError: mujoco_warp is not installed.
      UnknownNameError: there is no such device.
    """

    def __init__(
        self,
        device: str | None = None,
        worlds: int | None = None,
        nconmax: int | None = None,
        njmax: int | None = None,
    ) -> None:
        self.warp, self.library = _imported()
        found = _device(self.warp, device)
        self.device, self.device_name = str(found.alias), str(found.name)
        self.worlds = worlds or (ON_GPU if found.is_cuda else ON_CPU)
        self.nconmax, self.njmax = nconmax, njmax
        self.version = f"{LIBRARY} {version(PACKAGE)}, warp {self.warp.__version__}"

    def open(self, run: Run) -> "WarpWorlds":
        """Worlds that start as `run` does.

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not so many worlds.
        """
        return WarpWorlds(self, run)

    def here(self) -> AbstractContextManager[Any]:
        """Lets Warp work on this device."""
        return self.warp.ScopedDevice(self.device)


class WarpWorlds:
    """Rolls worlds out.

    Each plays the controls of the run a step ahead of the one before it, so that no two move alike; the first plays
    them as they are. The run has controls for that: of as many steps more as there are worlds. Without controls all
    worlds are alike. Wall times include handing controls over, from memory of the device's own.

    Attributes:
      copies: how many worlds.
      nconmax, njmax: contacts and constraints that there is room for in a world.
    """

    def __init__(self, engine: WarpEngine, run: Run) -> None:
        self.copies = engine.worlds
        self._engine, self._run = engine, run
        wp, model = engine.warp, _without_autoreset_flag(run.model)
        with _refusals(engine), engine.here():
            self._model = engine.library.put_model(model)
            self._model.opt.warn_overflow = 0  # it prints from the device, a line for each world and step
            self._data = engine.library.put_data(
                model, run.data(), nworld=self.copies, nconmax=engine.nconmax, njmax=engine.njmax
            )
            # All of it, so that a rollout leaves nothing behind, whatever mujoco_warp remembers.
            self._start = [(array, wp.clone(array)) for array in self._arrays()]
            self._controls = None if run.controls is None else wp.array(run.controls.ravel(), dtype=wp.float32)
        self.nconmax, self.njmax = self._data.naconmax // self.copies, int(self._data.njmax)
        self._step: Callable[[], None] = partial(engine.library.step, self._model, self._data)
        self._most, self._overflow = Most(), 0

    def first(self, clock: Clock) -> float:
        """Takes the first step, for which Warp compiles what it has not cached, and records another as a graph.

        A graph's kernels are launched at once, not one by one from Python; so has it mujoco_warp's own testspeed.

        Returns:
          Its wall time [s].

        Raises:
          UsageError: mujoco_warp cannot simulate this model, or not so many worlds.
        """
        wp = self._engine.warp
        before = clock()
        with _refusals(self._engine), self._engine.here():
            self._step()
            with wp.ScopedCapture() as capture:
                self._step()
            self._step = partial(wp.capture_launch, capture.graph)
            self._wait()
        return clock() - before

    def seconds(self, steps: int, block: int, clock: Clock) -> np.ndarray:
        """As `Roller` has it: wall time of each block, of all worlds together [s]."""
        found = []
        with self._engine.here():
            self._restart()
            for first, count in blocks_of(steps, block):
                before = clock()
                for step in range(first, first + count):
                    self._advance(step)
                self._wait()
                found.append(clock() - before)
        return np.array(found)

    def profile(self, steps: int) -> Profile:
        """Rolls `steps` steps out, looking at each. Not to be timed from outside.

        Raises:
          SimulationError: some worlds have become unstable.
        """
        contacts = constraints = iterations = 0.0
        most = Most()
        with self._engine.here():
            self._restart()
            for step in range(steps):
                self._advance(step)
                touching, near = int(self._data.nacon.numpy()[0]), int(self._data.ncollision.numpy()[0])
                rows = self._data.nefc.numpy()
                most = Most(max(most.contacts, touching, near), max(most.constraints, int(rows.max())))
                contacts += touching / self.copies
                constraints += float(rows.mean())
                iterations += float(self._data.solver_niter.numpy().mean())
            self._check(steps)
            self._overflow, self._most = int(np.bitwise_or.reduce(self._data.overflow.numpy())), most
        return Profile(contacts / steps, constraints / steps, iterations / steps, None, None, None, warned=False)

    def overflows(self) -> Sequence[str]:
        """What did not fit in the rollout that was profiled, and what to raise, a sentence each."""
        marks = self._engine.library.OverflowType
        single = [mark for mark in marks if mark.value and not mark.value & (mark.value - 1)]
        known = {
            "nconmax": self.nconmax,
            "njmax": self.njmax,
            "contacts": max(ceil(self._most.contacts / self.copies), self.nconmax + 1),
            "constraints": max(self._most.constraints, self.njmax + 1),
            "iterations": self._run.model.opt.iterations,
        }
        found = [told(mark.name, known) for mark in single if self._overflow & mark.value]
        return list(dict.fromkeys(found))

    def positions(self) -> np.ndarray:
        """Where the last rollout has ended: qpos of every world, `(worlds, nq)`."""
        return self._data.qpos.numpy()

    def _arrays(self) -> list[Any]:
        """The arrays of the data that live on from step to step; contacts and constraints are made anew in each."""
        values = [getattr(self._data, field.name) for field in fields(self._data)]
        return [value for value in values if isinstance(value, self._engine.warp.array) and value.size]

    def _restart(self) -> None:
        for array, kept in self._start:
            self._engine.warp.copy(array, kept)
        self._wait()

    def _advance(self, step: int) -> None:
        if self._controls is not None:
            # Rows `step` and on, one for each world, lie in a row.
            width = self._run.model.nu
            self._engine.warp.copy(self._data.ctrl, self._controls, src_offset=step * width, count=self.copies * width)
        self._step()

    def _wait(self) -> None:
        self._engine.warp.synchronize_device(self._engine.device)

    def _check(self, steps: int) -> None:
        """Raises SimulationError if a world has become unstable."""
        vectors = np.hstack((self.positions(), self._data.qvel.numpy()))
        bad = int((~(abs(vectors) < mujoco.mjMAXVAL)).any(axis=1).sum())
        if bad:
            timestep = self._run.model.opt.timestep
            raise SimulationError(
                steps,
                steps * timestep,
                f"the simulation became unstable in {bad} of {self.copies} worlds within {steps} steps, "
                f"{steps * timestep:.9g} s\na smaller --timestep than {timestep:g} s may cure it; "
                "mujoco_warp computes in single precision",
            )


def told(mark: str, known: Mapping[str, object]) -> str:
    """What an overflow of mujoco_warp's means, and what to raise."""
    if mark not in OVERFLOWS:
        return f"mujoco_warp has no room: {mark.lower()} overflow"
    meaning, remedy = OVERFLOWS[mark]
    return f"{meaning.format_map(known)}: {remedy.format_map(known)}"


def _imported() -> tuple[Any, Any]:
    """Warp, keeping quiet about what it compiles, and mujoco_warp."""
    if importlib.util.find_spec(LIBRARY) is None:
        raise MissingExtraError("--engine warp", PACKAGE, EXTRA)
    import warp  # pyright: ignore[reportMissingImports]

    warp.config.log_level = max(warp.config.log_level, warp.LOG_WARNING)
    import mujoco_warp  # pyright: ignore[reportMissingImports]

    return warp, mujoco_warp


def _device(warp: Any, asked: str | None) -> Any:
    if asked is None:
        return warp.get_preferred_device()
    try:
        return warp.get_device(asked)
    except (ValueError, RuntimeError):
        valid = [str(device.alias) for device in warp.get_devices()]
        raise UnknownNameError("device", asked, valid, "Warp") from None


def _without_autoreset_flag(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of `model`: mujoco_warp never resets by itself, and refuses the flag that says so."""
    kept = copy.copy(model)
    kept.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return kept


@contextmanager
def _refusals(engine: WarpEngine) -> Iterator[None]:
    """Makes sentences of how mujoco_warp refuses a model, fails on one, or has no memory."""
    try:
        yield
    except NotImplementedError as error:
        raise UsageError(f"mujoco_warp cannot simulate this model: {clean(str(error))}\n--engine c can") from None
    except Exception as error:
        said = clean(" ".join(str(error).split()))
        if "allocate" in said:
            raise UsageError(
                f"{engine.worlds} worlds do not fit in the memory of {clean(engine.device_name)} ({engine.device}): "
                f"{said}\ngive fewer --worlds, or less room with --nconmax and --njmax"
            ) from error
        if "nconmax" in said or "njmax" in said:
            raise UsageError(f"--engine warp: {said}\nraise --nconmax or --njmax") from error
        raise UsageError(
            f"mujoco_warp fails on this model: {type(error).__name__}: {said}\n--engine c may not"
        ) from error
