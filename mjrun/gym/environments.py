"""Tasks as Gymnasium environments: one episode at a time, or many at once, stepped in C on all cores."""

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, cast

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mjrun.confinement.confinement import is_readable
from mjrun.document.task import read_task
from mjrun.errors import UnknownNameError
from mjrun.model import state
from mjrun.options.number_kinds import IntegerKind
from mjrun.options.option import converted
from mjrun.options.task import CONTROL, POSITION, TORQUE
from mjrun.rendering.single_render import render
from mjrun.task.action_map import ActionMap, DrivenActuator
from mjrun.task.episode import Ending
from mjrun.task.expressions import RUNNING
from mjrun.task.single_world import SingleWorld
from mjrun.task.task import Task
from mjrun.task.worlds import LARGEST_SEED, TaskStep, TaskWorlds, action_array

ID = "mjrun/Task-v0"
SEED = IntegerKind(most=LARGEST_SEED)
SEEDS = 2**31  # the range of drawn seeds
SQUASHED = 5.0  # tanh is ±1 to within 1e-4 beyond it, so that these bounds lose nothing
TaskLike = Task | str | PathLike[str]
MASK = "reset_mask"


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


class TaskVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """`num_envs` worlds of a task, bit for bit those of Gymnasium's SyncVectorEnv with `TaskEnv`, but faster.

    Args:
      task: a task, or the file of its document.
      num_envs: the number of worlds.
      autoreset_mode: when a finished world begins its next episode: at the next step, Gymnasium's default, ignoring the
        action; within the same step, with `final_obs` and `final_info` in the infos; or by
        `reset(options={"reset_mask": …})` alone.
      threads: one for each core when 0.

    Raises:
      UsageError: a value is invalid, or the task does not fit its model.

    `reset(seed=S)` gives world i the seed S + i; a list gives a seed to each. The infos of a step contain the weighted
    terms of the reward, `reward/NAME` `(num_envs,)`, and for worlds whose episode has ended `ending` and `is_success`.
    """

    def __init__(
        self,
        task: TaskLike,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
    ) -> None:
        num_envs = converted("num_envs", IntegerKind(least=1), num_envs)
        threads = converted("threads", IntegerKind(), threads)
        self.task = task_of(task)
        self.num_envs = num_envs
        self.worlds = TaskWorlds(self.task.with_absolute_paths(), num_envs, threads)
        self.single_observation_space = observation_space(self.worlds)
        self.single_action_space = action_space(self.worlds)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._over = np.zeros(num_envs, bool)
        self._all = np.arange(num_envs)
        self._rewards = [f"reward/{name}" for name in self.worlds.reward_names]
        self._masks = [f"_{name}" for name in self._rewards]
        self._skips_ended = self.autoreset_mode == AutoresetMode.SAME_STEP

    def reset(  # type: ignore[override]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begins an episode in every world, or in those of the option `reset_mask` `(num_envs,)` bool.

        Raises:
          BadValueError: a seed is not a whole number from 0 to 2**63 - 1.
          ValueError: the number of seeds, or the mask, does not fit the number of worlds.
        """
        seeds = self._seeds(seed)
        mask = self._mask(options or {})
        worlds = self._all if mask is None else np.flatnonzero(mask)
        for world in worlds.tolist():
            if seeds[world] is not None:
                self._generators[world] = seeding.np_random(seeds[world])[0]
        given = [self._draw(world) if seeds[world] is None else seeds[world] for world in worlds.tolist()]
        self.worlds.reset([int(each or 0) for each in given], worlds)
        self._over[worlds] = False
        return self.worlds.observations, {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Steps every world by a control period; see `VectorEnv`."""
        if self._over.any():
            if self.autoreset_mode == AutoresetMode.DISABLED:
                raise ValueError("an episode is over: reset its world with the option reset_mask")
            return self._step_after_end(action_array(actions, (self.num_envs, len(self.worlds.action_names))))
        step = self.worlds.step(actions)
        terms, over = step.reward_terms.T, step.over
        if not over.any():
            infos = self._terms(terms, None)
        elif self._skips_ended:
            infos = {} if over.all() else self._terms(terms, ~over)
            infos |= self._begin_next(step, over)  # Gymnasium reports these worlds in `final_info` alone
        else:
            self._over = over
            infos = self._terms(terms, None) | self._endings(step.codes)
        return step.observations, step.rewards, step.terminated, step.truncated, infos

    def _step_after_end(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Takes a step in which some worlds begin their next episode instead."""
        begin, running = np.flatnonzero(self._over), np.flatnonzero(~self._over)
        rewards, (terminated, truncated) = np.zeros(self.num_envs), np.zeros((2, self.num_envs), bool)
        infos: dict[str, Any] = {}
        if len(running):
            step = self.worlds.step(actions[running], running)
            rewards[running] = step.rewards
            terminated[running], truncated[running] = step.terminated, step.truncated
            terms, codes = np.zeros((len(self._rewards), self.num_envs)), np.full(self.num_envs, RUNNING)
            terms[:, running], codes[running] = step.reward_terms.T, step.codes
            infos = self._terms(terms, ~self._over) | self._endings(codes)
        # After the step, which may refuse its actions: another one must not begin the episodes after these.
        self.worlds.reset([self._draw(world) for world in begin.tolist()], begin)
        self._over = terminated | truncated
        return self.worlds.observations, rewards, terminated, truncated, infos

    def _begin_next(self, step: TaskStep, over: np.ndarray) -> dict[str, Any]:
        """Begins the next episode in the worlds of a mask, whose last one ended in this step; returns their infos."""
        ended, final = np.flatnonzero(over), np.full(self.num_envs, None, object)
        for world in ended.tolist():
            final[world] = step.observations[world].copy()
        final_info = self._terms(step.reward_terms.T, over) | self._endings(step.codes)
        step.observations[ended] = self.worlds.reset([self._draw(world) for world in ended.tolist()], ended)
        return {"final_obs": final, "_final_obs": over, "final_info": final_info, "_final_info": over.copy()}

    def _terms(self, terms: np.ndarray, worlds: np.ndarray | None) -> dict[str, Any]:
        """Returns the terms of the reward `(nterms, num_envs)` as infos of the worlds of a mask, or of all."""
        masks = np.ones(terms.shape, bool)
        if worlds is not None:
            masks[:], terms = worlds, np.where(worlds, terms, 0.0)
        infos = dict[str, Any](zip(self._rewards, terms, strict=True))
        infos |= zip(self._masks, masks, strict=True)
        return infos

    def _endings(self, codes: np.ndarray) -> dict[str, Any]:
        """Returns the infos of the worlds whose episode has ended with a code `(num_envs,)`."""
        over = codes != RUNNING
        ended = np.flatnonzero(over)
        if not len(ended):
            return {}
        names, success = np.full(self.num_envs, None, object), np.zeros(self.num_envs, bool)
        for world in ended.tolist():
            info = ending_info(self.worlds.endings[int(codes[world])])
            names[world], success[world] = info["ending"], info["is_success"]
        return {"ending": names, "_ending": over, "is_success": success, "_is_success": over.copy()}

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
            if len(seed) != self.num_envs:
                raise ValueError(f"{len(seed)} seeds for {self.num_envs} worlds")
            return [None if each is None else converted("seed", SEED, each) for each in seed]
        first: int = converted("seed", SEED, seed)
        return [first + world for world in range(self.num_envs)]

    def _mask(self, options: dict[str, Any]) -> np.ndarray | None:
        """Returns the mask of worlds to be reset; None for all."""
        if MASK not in options:
            return None
        mask = cast("np.ndarray | None", options[MASK])
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"{MASK} must be an array of bool of shape ({self.num_envs},)")
        if not mask.any():
            raise ValueError(f"{MASK} selects no world")
        return mask

    def _draw(self, world: int) -> int:
        """Draws the seed of the next episode of a world."""
        generator = self._generators[world] or seeding.np_random(None)[0]
        self._generators[world] = generator
        return draw_seed(generator)


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Returns a mode, or the one with this text; Gymnasium's own message has no list of them."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        modes = [str(each.value) for each in AutoresetMode]
        raise UnknownNameError("autoreset_mode", str(mode), modes, plural="modes") from None


def make_vec(task: TaskLike, num_envs: int = 1, **options: Any) -> TaskVectorEnv:
    """Creates `num_envs` worlds of a task as a vector environment.

    Args:
      task: a task, or the file of its document.
      options: options of `TaskVectorEnv`.

    Raises:
      UsageError: the task does not fit its model.
      DocumentError: the document is invalid; it lists every problem.
    """
    return TaskVectorEnv(task, num_envs, **options)
