"""One episode of a task at a time, as a Gymnasium environment."""

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
from mjrun.rendering.single_render import render
from mjrun.task.action_map import ActionMap, DrivenActuator
from mjrun.task.episode import Ending
from mjrun.task.expressions import RUNNING
from mjrun.task.single_world import SingleWorld
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds

ID = "mjrun/Task-v0"
SEEDS = 2**31  # the range of drawn seeds
SQUASHED = 5.0  # tanh is ±1 to within 1e-4 beyond it, so that these bounds lose nothing
TaskLike = Task | str | PathLike[str]


class TaskEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A task as a Gymnasium environment.

    Args:
      task: a task, or the file of its document.
      render_mode: `rgb_array`, or None.
      camera: the camera of `render`, in the syntax of the command line.
      width, height: the size of rendered images [pixels].

    `reset(seed=S)` begins the episode of seed S; without a seed, that of a seed drawn from Gymnasium's generator. The
    info of a step contains the weighted terms of the reward, `reward/NAME`; that of the last step also the ending of
    the episode, `ending`, and whether it is a success, `is_success`.

    It can be pickled and copied, even within an episode; a copy continues with the same numbers. The model is read
    once; a copy and some variations of the model read it again, and raise ModelError if a file has changed since.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - a plain dictionary as in Gymnasium

    def __init__(
        self,
        task: TaskLike,
        render_mode: str | None = None,
        camera: str = "free",
        width: int = 640,
        height: int = 480,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be rgb_array or None, not {render_mode!r}")
        self._spec: EnvSpec | None = None
        self.task = task_of(task)
        self.worlds = SingleWorld(self.task.with_absolute_paths())
        self.observation_space, self.action_space = observation_space(self.worlds), action_space(self.worlds)
        self._reward_names = [f"reward/{name}" for name in self.worlds.reward_names]
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self.task.control_dt)}
        self._camera, self._size = camera, (width, height)

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """The specification by which `gymnasium.make` created it; `to_json` requires a task from a document."""
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
        info |= ending_info(endings[int(code)])
        return observation, reward, bool(endings.terminated[code]), bool(endings.truncated[code]), info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """Renders the state as an image `(height, width, 3)` uint8; returns None without a render mode."""
        if self.render_mode is None:
            return None
        model = self.worlds.model(0)
        data = mujoco.MjData(model)
        state.restore(model, data, self.worlds.state(0))
        return render(model, data, self._camera, self._size)


def make(task: TaskLike, **options: Any) -> gymnasium.Env[np.ndarray, np.ndarray]:
    """Creates an environment with Gymnasium's checks, by `gymnasium.make("mjrun/Task-v0", task=task, …)`.

    Args:
      task: a task, or the file of its document.
      options: options of `TaskEnv` and of `gymnasium.make`.

    Returns:
      The environment; its `spec.to_json()` requires a task from a document.

    Raises:
      UsageError: the task does not fit its model.
      DocumentError: the document is invalid; it lists every problem.
    """
    return gymnasium.make(ID, task=task, **options)


def draw_seed(generator: np.random.Generator) -> int:
    """Draws the seed of an episode for which none was given."""
    return int(generator.integers(SEEDS))


def ending_info(ending: Ending) -> dict[str, Any]:
    """Returns the info of the last step of an episode, without the terms of the reward."""
    return {"ending": ending.name, "is_success": ending.kind == "success"}


def task_of(task: TaskLike) -> Task:
    """Returns a task, or reads it from its document.

    Raises:
      DocumentError: the document is invalid; it lists every problem.
      FileError: it does not exist, or cannot be read.
    """
    return task if isinstance(task, Task) else read_task(str(task))


def named(task: TaskLike) -> TaskLike:
    """Returns the text that names the document of a task; the task itself if it has none, or differs from it."""
    if not isinstance(task, Task):
        return str(task)
    has_document = task.path is not None and is_readable(task.path) and task.path.is_file()
    return task.text if has_document and read_task(task.text) == task else task


def observation_space(worlds: TaskWorlds) -> Box:
    """Returns the space of observations `(nobs,)` float64, within the limits of their terms."""
    low = np.array([number.low for number in worlds.observed])
    high = np.array([number.high for number in worlds.observed])
    return Box(low, high, dtype=np.float64)


def action_space(worlds: TaskWorlds) -> Box:
    """Returns the space of actions `(nact,)` float32 of the policy, before squash, clip, scale and offset.

    Its bounds are those of the clip; else those beyond which tanh is constant; else those of the controls, joints or
    torques that the actions set, before the variations of episodes; else infinite.
    """
    actions, model = worlds.actions, worlds.nominal_model
    limits = np.array([_limits(each, model) for each in actions.driven]).reshape(-1, 2)
    scale = np.where(actions.scale == 0, 1, actions.scale)
    ends = (limits - actions.offset[:, None]) / scale[:, None]
    low, high = ends.min(axis=1), ends.max(axis=1)
    low, high = _within(actions, low, high)
    return Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)


def _within(actions: ActionMap, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns bounds before squash and clip from those after them."""
    low, high = np.where(actions.squashed, -SQUASHED, low), np.where(actions.squashed, SQUASHED, high)
    squashed = np.asarray(actions.squashed, bool)
    is_clipped = ~squashed & np.isfinite(actions.low) & np.isfinite(actions.high)
    return np.where(is_clipped, actions.low, low), np.where(is_clipped, actions.high, high)


def _limits(each: DrivenActuator, model: mujoco.MjModel) -> tuple[float, float]:
    """Returns the lowest and the highest effective target; infinite without limits."""
    if each.target in (CONTROL, TORQUE) and model.actuator_ctrllimited[each.control]:
        low, high = model.actuator_ctrlrange[each.control]
        if each.target == TORQUE:
            strength = each.strength(model)
            low, high = sorted((low * strength, high * strength))
        return float(low), float(high)
    if each.target == POSITION and model.jnt_limited[each.joint]:
        low, high = model.jnt_range[each.joint]
        return float(low), float(high)
    return -np.inf, np.inf
