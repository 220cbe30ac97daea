"""Controls that are known beforehand: a table in time, or a row for each step."""

from collections.abc import Collection, Mapping
from fractions import Fraction

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError, UsageError, clean, listing, option
from mjrun.model.names import control_names
from mjrun.physics.table_times import SLACK, require_times
from mjrun.timeline import seconds

PREFIX = "ctrl/"  # of a table's columns


class ControlTable:
    """Controls by time, read beforehand: each holds until the next, or goes there in a straight line.

    The last one holds to the end. Actuators without a column keep their constant control.

    Args:
      model: whose actuators are driven.
      columns: `time` [s], and `ctrl/ACTUATOR` for each actuator, `(n,)` each; the rest is not looked at.
      source: what the table is called in messages.
      linear: interpolate; otherwise hold.
      constant: indices of controls that need no column.

    Raises:
      UnknownNameError: a column of an actuator that is not there.
      UsageError: no time, times out of order or too late, an actuator without a column, numbers not finite.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        columns: Mapping[str, np.ndarray],
        source: str,
        linear: bool = False,
        constant: Collection[int] = (),
    ) -> None:
        actuators = control_names(model)
        driven = {name.removeprefix(PREFIX): values for name, values in columns.items() if name.startswith(PREFIX)}
        for name in driven:
            if name not in actuators:
                raise UnknownNameError("actuator", name, actuators, where=f"the columns of {source}")
        missing = [name for i, name in enumerate(actuators) if name not in driven and i not in constant]
        if not driven or missing:
            wanted = listing([f"{PREFIX}{name}" for name in missing or actuators]) or "nothing: it has no actuators"
            raise UsageError(
                f"{clean(source)} lacks columns that the model takes: {wanted}\n{option('ctrl')} can hold the others"
            )
        self._time, self._linear = _times(columns, source), linear
        self._actuators = np.array([actuators.index(name) for name in driven])
        self._values = np.column_stack(list(driven.values()))
        bad = np.argwhere(~np.isfinite(self._values))
        if len(bad):
            row, column = bad[0]
            text = f"{PREFIX}{list(driven)[column]} is {self._values[row, column]}"
            raise UsageError(f"{clean(source)}, row {row}: {clean(text)}, and must be finite")

    @property
    def end(self) -> float:
        """The time of the last row [s]."""
        return float(self._time[-1])

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Puts the controls of the steps from `first` on into their columns of `ctrl` `(n, nu)`."""
        time = np.asarray(seconds(np.arange(first, first + len(ctrl)), timestep), float)
        if self._linear:
            for actuator, values in zip(self._actuators, self._values.T, strict=True):
                ctrl[:, actuator] = np.interp(time, self._time, values)
        else:
            row = np.searchsorted(self._time, time + SLACK * float(timestep), side="right") - 1
            ctrl[:, self._actuators] = self._values[row]


def _times(columns: Mapping[str, np.ndarray], source: str) -> np.ndarray:
    if "time" not in columns:
        raise UsageError(
            f"{clean(source)} has no column 'time'\nit takes 'time' in seconds, and ctrl/ACTUATOR for each"
        )
    time = columns["time"]
    require_times(time, source)
    if time[0] > 0:
        raise UsageError(f"{clean(source)} begins at {time[0]:.9g} s, and does not say what the controls are from 0 on")
    return time


class ControlArray:
    """Controls step by step, `(steps, nu)`: the first row acts at step 0; the last one holds to the end."""

    def __init__(self, values: np.ndarray) -> None:
        self._values = values

    def apply(self, ctrl: np.ndarray, first: int, timestep: Fraction) -> None:
        """Puts the controls of the steps from `first` on into `ctrl` `(n, nu)`."""
        ctrl[:] = self._values[np.minimum(np.arange(first, first + len(ctrl)), len(self._values) - 1)]
