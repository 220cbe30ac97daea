"""The spaces of a task: what its policies may observe and answer."""

from os import PathLike

import mujoco
import numpy as np
from gymnasium.spaces import Box

from mjrun.confinement.confinement import is_readable
from mjrun.document.task import read_task
from mjrun.options.task import CONTROL, POSITION, TORQUE
from mjrun.task.action_map import ActionMap, Driven
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds

SQUASHED = 5.0  # beyond it tanh is ±1 to within 1e-4: an algorithm that needs bounds loses nothing
TaskLike = Task | str | PathLike[str]


def task_of(task: TaskLike) -> Task:
    """A task, or the one that a document holds.

    Raises:
      DocumentError: with everything that is wrong in the document.
      FileError: it is not there, or cannot be read.
    """
    return task if isinstance(task, Task) else read_task(str(task))


def named(task: TaskLike) -> TaskLike:
    """The text that names the document of a task; the task itself where it differs from its document, or has none."""
    if not isinstance(task, Task):
        return str(task)
    has_document = task.path is not None and is_readable(task.path) and task.path.is_file()
    return task.text if has_document and read_task(task.text) == task else task


def observation_space(worlds: TaskWorlds) -> Box:
    """All observations `(nobs,)` float64, within the limits of their terms."""
    low = np.array([number.low for number in worlds.observed])
    high = np.array([number.high for number in worlds.observed])
    return Box(low, high, dtype=np.float64)


def action_space(worlds: TaskWorlds) -> Box:
    """All actions `(nact,)` float32, as the policy answers them, before squash, clip, scale and offset.

    Their bounds are those of the clip; else those beyond which tanh changes nothing more; else those of the controls,
    joints or torques that they stand for; else there are none.
    """
    actions, model = worlds.actions, worlds.model(0)
    limits = np.array([_limits(each, model) for each in actions.driven]).reshape(-1, 2)
    scale = np.where(actions.scale == 0, 1, actions.scale)
    ends = (limits - actions.offset[:, None]) / scale[:, None]
    low, high = ends.min(axis=1), ends.max(axis=1)
    low, high = _within(actions, low, high)
    return Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def _within(actions: ActionMap, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds before squash and clip, from those behind them."""
    low, high = np.where(actions.squashed, -SQUASHED, low), np.where(actions.squashed, SQUASHED, high)
    squashed = np.asarray(actions.squashed, bool)
    is_clipped = ~squashed & np.isfinite(actions.low) & np.isfinite(actions.high)
    return np.where(is_clipped, actions.low, low), np.where(is_clipped, actions.high, high)


def _limits(each: Driven, model: mujoco.MjModel) -> tuple[float, float]:
    """The lowest and the highest target that makes a difference; infinite where there is none."""
    actuator = each.actuator(model)
    if each.target in (CONTROL, TORQUE) and model.actuator_ctrllimited[each.control]:
        low, high = model.actuator_ctrlrange[each.control]
        if each.target == TORQUE:
            strength = model.actuator_gear[actuator, 0] * model.actuator_gainprm[actuator, 0]
            low, high = sorted((low * strength, high * strength))
        return float(low), float(high)
    if each.target == POSITION and model.jnt_limited[each.joint]:
        low, high = model.jnt_range[each.joint]
        return float(low), float(high)
    return -np.inf, np.inf
