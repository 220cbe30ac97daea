"""Arrays of a compiled model by name, and models of which each simulation has different numbers.

Names are those of MjModel; options and statistics are `opt.NAME` and `stat.NAME`, arrays of one row.
"""

import copy
from collections.abc import Mapping

import mujoco
import numpy as np

from mjrun.dataclass import dataclass


@dataclass(frozen=True)
class VariedModel:
    """A model of which each simulation has different numbers in some arrays.

    Attributes:
      model: the model.
      arrays: these arrays, `(simulations, rows, size)`, by name.
    """

    model: mujoco.MjModel
    arrays: Mapping[str, np.ndarray]

    def at(self, simulation: int) -> mujoco.MjModel:
        """Returns a copy of the model with the numbers of one simulation."""
        model = copy.copy(self.model)
        for name, values in self.arrays.items():
            write_array(model, name, values[simulation])
        return model


def read_array(model: mujoco.MjModel, array: str) -> np.ndarray:
    """Returns a copy of an array, `(rows, size)`; of `opt.NAME` or `stat.NAME` as one row."""
    group, dot, field = array.rpartition(".")
    if dot:
        return np.array(getattr(getattr(model, group), field), float).reshape(1, -1)
    return getattr(model, field).copy()


def write_array(model: mujoco.MjModel, array: str, values: np.ndarray) -> None:
    """Writes an array, the reverse of `read_array`."""
    group, dot, field = array.rpartition(".")
    if dot:
        setattr(getattr(model, group), field, values[0] if values.shape[1] > 1 else float(values[0, 0]))
    else:
        getattr(model, field)[...] = values


def restore_array(model: mujoco.MjModel, array: str, source: mujoco.MjModel) -> None:
    """Writes an array of another model."""
    if "." in array:
        write_array(model, array, read_array(source, array))
    else:
        getattr(model, array)[...] = getattr(source, array)
