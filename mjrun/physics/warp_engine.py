"""MuJoCo Warp as an engine: many simulations at once, in single precision, on a GPU or a CPU."""

import warnings
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from mjrun.errors import MjrunWarning, SimulationError, option
from mjrun.physics.engine import Fields, RolloutBlock, block_steps, models_of
from mjrun.physics.warp_device import WarpDevice
from mjrun.physics.warp_worlds import WarpWorlds


class WarpEngine:
    """An `Engine` of models that differ in nothing but what `WarpFields` lets worlds differ in.

    Args:
      nconmax, njmax: contacts and constraints to make room for in a simulation; mujoco_warp guesses when None.
    """

    def __init__(self, device: WarpDevice, nconmax: int | None = None, njmax: int | None = None) -> None:
        self._device, self._nconmax, self._njmax = device, nconmax, njmax

    def rollout(
        self,
        models: mujoco.MjModel | Sequence[mujoco.MjModel],
        starts: np.ndarray,
        controls: np.ndarray | None,
        steps: int,
        record: Sequence[str],
        every: int = 1,
    ) -> Iterator[RolloutBlock]:
        """As `Engine` has it, but that instability is noticed at rows only, and models are of one `WarpFields.group`.

        What does not fit is a warning.

        Raises:
          UsageError: mujoco_warp cannot simulate such models, or record a field.
        """
        model = models_of(models, len(starts))[0]
        worlds = WarpWorlds(self._device, models, starts, self._nconmax, self._njmax)
        worlds.require(record)
        walk = _Walk(worlds, model, controls, record)
        rows = [*range(0, steps, every), steps]
        size = max(1, block_steps(model, record, len(starts)) // every)
        for first in range(0, len(rows), size):
            yield walk.block(rows[first : first + size])
        for text in worlds.overflows():
            warnings.warn(text, MjrunWarning, stacklevel=2)


class _Walk:
    """Worlds on their way from row to row."""

    def __init__(
        self, worlds: WarpWorlds, model: mujoco.MjModel, controls: np.ndarray | None, record: Sequence[str]
    ) -> None:
        self._worlds, self._controls, self._record = worlds, controls, record
        self._timestep, self._width = float(model.opt.timestep), worlds.count * model.nu
        self._step, self._stable = 0, np.ones(worlds.count, bool)
        self._initial: Fields = {}

    def block(self, rows: Sequence[int]) -> RolloutBlock:
        """The rows at the steps `rows`, which follow those of the block before."""
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
                counts += self._stable
                self._worlds.forward()
                for name in self._record:
                    values[name].append(self._worlds.read(name))
        fields = {name: np.stack(parts, axis=1) for name, parts in values.items()}
        self._initial = self._initial or {name: part[:, :1].copy() for name, part in fields.items()}
        return RolloutBlock(np.array(rows), fields, self._initial, counts, failures)

    def _upload(self, last: int) -> object:
        """The controls from here to step `last`, `(steps, n, nu)` on the device; the last ones hold."""
        if self._controls is None:
            return None
        index = np.minimum(np.arange(self._step, last + 1), self._controls.shape[1] - 1)
        return self._worlds.upload(self._controls[:, index].swapaxes(0, 1))

    def _unstable(self, before: int, row: int) -> dict[int, SimulationError]:
        """The worlds that have become unstable between two rows."""
        bad = self._stable & self._worlds.unstable()
        self._stable &= ~bad
        place = f"after step {before}, time {before * self._timestep:.9g} s, and not later than step {row}"
        advice = f"a smaller {option('timestep')} may cure it; mujoco_warp computes in single precision"
        message = f"the simulation became unstable {place}\n{advice}"
        return {int(index): SimulationError(before, before * self._timestep, message) for index in np.flatnonzero(bad)}
