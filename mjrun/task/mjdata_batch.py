"""Worlds stepped side by side in threads, for functions that read an MjData.

`mujoco.batch` steps faster, but reveals only the fields that MuJoCo computes by itself; copying an MjData out of it
takes longer than what is then read from it.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.batch import SimulationError as BatchError

from mjrun.model import state

INTEGRATION = int(mujoco.mjtState.mjSTATE_INTEGRATION)
NONE = int(mujoco.mjtStage.mjSTAGE_NONE)
Examine = Callable[[int, mujoco.MjModel, mujoco.MjData], None]


class MjDataBatch:
    """`nsim` simulations of a model, with the arrays and calls of `mujoco.batch.Batch` and the same results.

    Args:
      model: the model.
      nsim: the number of simulations.
      nthread: the number of threads.
      persistent: whether each simulation has its own MjData, instead of each thread.

    Attributes:
      state: the integration states `(nsim, nstate)`.
      warning: the last information and the number of MuJoCo's warnings of each kind `(nsim, kinds, 2)`.
      examine: called with the id, the model and the MjData of each simulation after every call, in several threads.
    """

    def __init__(self, model: mujoco.MjModel, nsim: int, nthread: int, persistent: bool) -> None:
        self.model, self.nsim = model, nsim
        self._models: Sequence[mujoco.MjModel] = [model] * nsim
        self._layout = Batch(model, 1, 1, persistent)
        self._places = state.fields(state.sizes(model))
        self._persistent, self._threads = persistent, min(nthread, nsim)
        self._datas = [mujoco.MjData(model) for _ in range(nsim if persistent else self._threads)]
        self._warned = [data.warning.number for data in self._datas]
        self._pool = _pool(self._threads - 1)
        self._bound: dict[str, np.ndarray] = {}
        # Views of the bound fields, since making them takes longer than copying: of each simulation and of each MjData.
        self._copies: list[list[np.ndarray]] = [[] for _ in range(nsim)]
        self._sources: list[list[np.ndarray]] = [[] for _ in self._datas]
        self._counts = dict[str, np.ndarray]()  # bound fields that are single numbers
        self.examine: Examine = _ignore
        self.state = np.zeros((nsim, mujoco.mj_stateSize(model, INTEGRATION)))
        self._rows = [*self.state]
        for row in self._rows:
            mujoco.mj_getState(model, self._datas[0], row, INTEGRATION)
        self.warning = np.zeros((nsim, len(self._warned[0]), 2), np.int32)
        self._no_warning = self._warned[0].tobytes()

    def bind(self, name: str) -> np.ndarray:
        """Returns the array `(nsim, …)` of a field of MjData: a view of the states, or a copy made after every call."""
        example: Any = np.asarray(getattr(self._datas[0], name))
        if name in self._places:
            return self.state[:, self._places[name]].reshape(self.nsim, *example.shape)
        if name not in self._bound:
            values = self._bound[name] = np.zeros((self.nsim, *example.shape), example.dtype)
            if example.ndim:
                rows: Sequence[Any] = [*values]
                for copies, row in zip(self._copies, rows, strict=True):
                    copies.append(row)
                for sources, data in zip(self._sources, self._datas, strict=True):
                    sources.append(getattr(data, name))
            else:
                self._counts[name] = values
        return self._bound[name]

    def set_models(self, models: Sequence[mujoco.MjModel]) -> None:
        """Runs each simulation on its own model; raises `mujoco.FatalError` if one has another layout, as `Batch`."""
        for model in set(models) - {*self._models}:
            self._layout.set_models(model)
        self._models = models

    def step(self, ids: np.ndarray | None = None, nstep: int = 1, stage: int = NONE) -> None:
        """Takes steps, and then computes everything that belongs to the new state unless `stage` is NONE.

        Raises:
          BatchError: MuJoCo raised an error in some simulations, which keep their state; the others were stepped.
        """

        def step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            mujoco.mj_step(model, data, nstep)
            if stage != NONE:
                mujoco.mj_forward(model, data)

        self._run(ids, step)

    def forward(self, ids: np.ndarray | None = None, stage: int = NONE) -> None:
        """Computes everything that belongs to the state; raises the error of `step`."""
        self._run(ids, mujoco.mj_forward)

    def _run(self, ids: np.ndarray | None, call: Callable[[mujoco.MjModel, mujoco.MjData], None]) -> None:
        worlds = range(self.nsim) if ids is None else ids.tolist()
        failures = dict[int, str]()
        left = iter(worlds)
        others = range(1, min(self._threads, len(worlds)))
        tasks = [self._pool.submit(self._work, left, thread, call, failures) for thread in others if self._pool]
        self._work(left, 0, call, failures)
        for task in tasks:
            task.result()
        if failures:
            failed = sorted(failures)
            raise BatchError(np.array(failed), failures[failed[0]])

    def _work(
        self,
        worlds: Iterator[int],
        thread: int,
        call: Callable[[mujoco.MjModel, mujoco.MjData], None],
        failures: dict[int, str],
    ) -> None:
        """Runs simulations until none is left."""
        for world in worlds:
            model, row = self._models[world], self._rows[world]
            place = world if self._persistent else thread
            data = self._datas[place]
            mujoco.mj_setState(model, data, row, INTEGRATION)
            try:
                call(model, data)
            except mujoco.FatalError as error:
                failures[world] = str(error)
                mujoco.mj_resetData(model, data)
                continue
            mujoco.mj_getState(model, data, row, INTEGRATION)
            if self._warned[place].tobytes() != self._no_warning:
                self._count_warnings(world, data)
            for copy, source in zip(self._copies[world], self._sources[place], strict=True):
                copy[...] = source
            for name, values in self._counts.items():
                values[world] = getattr(data, name)
            self.examine(world, model, data)

    def _count_warnings(self, world: int, data: mujoco.MjData) -> None:
        """Adds the warnings of a call to those of its simulation."""
        numbers, information = data.warning.number, data.warning.lastinfo
        self.warning[world, :, 1] += numbers
        np.copyto(self.warning[world, :, 0], information, where=numbers > 0)
        numbers[:] = 0


class SingleMjData:
    """The fields of one MjData, which others step, as the arrays of a batch of one simulation.

    Args:
      data: an MjData of the model.

    Attributes:
      examine: called with 0, the model and the MjData at every update.
    """

    nsim = 1

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.model, self.data = model, data
        self.examine: Examine = _ignore
        self._numbers = dict[str, np.ndarray]()

    def bind(self, name: str) -> np.ndarray:
        """Returns a view `(1, …)` of a field; an array of a single number, which is set by `update`."""
        value: Any = getattr(self.data, name)
        if isinstance(value, np.ndarray):
            return value[None]
        return self._numbers.setdefault(name, np.array([value]))

    def update(self) -> None:
        """Sets what are no views of the MjData; called before the arrays are read."""
        for name, number in self._numbers.items():
            number[0] = getattr(self.data, name)
        self.examine(0, self.model, self.data)


def _pool(threads: int) -> Any:
    if not threads:
        return None
    from concurrent.futures import ThreadPoolExecutor  # slow to import

    return ThreadPoolExecutor(threads)


def _ignore(world: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    pass
