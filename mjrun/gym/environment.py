"""One episode of a task at a time, as an environment of Gymnasium."""

from dataclasses import replace
from os import PathLike
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box

from mjrun.confinement.confinement import is_readable
from mjrun.document.task import read_task
from mjrun.model import state
from mjrun.options.task import CONTROL, POSITION, TORQUE
from mjrun.rendering.render import render
from mjrun.task.action_map import ActionMap, Driven
from mjrun.task.episode import Ending
from mjrun.task.expressions import RUNNING
from mjrun.task.single_world import SingleWorld
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds

ID = "mjrun/Task-v0"
SEEDS = 2**31  # of episodes whose seed nobody gives
SQUASHED = 5.0  # beyond it tanh is ±1 to within 1e-4: an algorithm that needs bounds loses nothing
TaskLike = Task | str | PathLike[str]


class TaskEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A task as an environment.

    Args:
      task: it, or the file of its document.
      render_mode: `rgb_array`, or None.
      camera: what `render` shows, as on the command line.
      width, height: of its images [pixels].

    `reset(seed=S)` begins the episode of seed S; without a seed, one that Gymnasium's generator draws. The info of a
    step holds the weighted terms of the reward, `reward/NAME`; that of the last one also how the episode ended,
    `ending`, and whether it was a success, `is_success`.

    It can be pickled and copied, also within an episode, and goes on with the same numbers. The model is read once; a
    copy reads it again, and is refused where its file has changed since.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        task: TaskLike,
        render_mode: str | None = None,
        camera: str = "free",
        width: int = 640,
        height: int = 480,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode is rgb_array or None, not {render_mode!r}")
        self._spec: EnvSpec | None = None
        self.task = task_of(task)
        self.worlds = SingleWorld(self.task)
        self.observation_space, self.action_space = observation_space(self.worlds), action_space(self.worlds)
        self._reward_names = [f"reward/{name}" for name in self.worlds.reward_names]
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self.task.control_dt)}
        self._camera, self._size = camera, (width, height)

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """What `gymnasium.make` made it from; `to_json` takes it where the task is a document."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:  # type: ignore[override]
        self._spec = spec and replace(spec, kwargs=spec.kwargs | {"task": named(spec.kwargs["task"])})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        episode = draw_seed(self.np_random) if seed is None else seed
        return self.worlds.start(episode), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        observation, reward, terms, code, endings = self.worlds.act(action)
        info: dict[str, Any] = dict(zip(self._reward_names, terms, strict=False))
        if code == RUNNING:
            return observation, reward, False, False, info
        info |= ending_info(endings[code])
        return observation, reward, bool(endings.terminated[code]), bool(endings.truncated[code]), info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The state as an image `(height, width, 3)` uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        model = self.worlds.model(0)
        data = mujoco.MjData(model)
        state.restore(model, data, self.worlds.state(0))
        return render(model, data, self._camera, self._size)


def make(task: TaskLike, **options: Any) -> gymnasium.Env[np.ndarray, np.ndarray]:
    """`gymnasium.make("mjrun/Task-v0", task=task, …)`: with Gymnasium's checks of order and types.

    Args:
      task: it, or the file of its document.
      options: those of `TaskEnv` and of `gymnasium.make`.

    Returns:
      The environment; its `spec.to_json()` needs a task that is a document.

    Raises:
      UsageError: the task does not fit its model.
      DocumentError: with everything that is wrong in the document.
    """
    return gymnasium.make(ID, task=task, **options)


def draw_seed(generator: np.random.Generator) -> int:
    """The seed of an episode that was not given one."""
    return int(generator.integers(SEEDS))


def ending_info(ending: Ending) -> dict[str, Any]:
    """What the info of the last step of an episode holds besides the terms of the reward."""
    return {"ending": ending.name, "is_success": ending.kind == "success"}


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
