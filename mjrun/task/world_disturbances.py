"""Disturbances of the worlds of a task: noise on their controls, and pushes of their bodies, step by step."""

import mujoco
import numpy as np

from mjrun.model import state
from mjrun.physics.control import NEVER, ControlNoise
from mjrun.physics.push_forces import PushForces
from mjrun.task.task import Task
from mjrun.timeline import rational


class WorldDisturbances:
    """Noise on the controls of n worlds, and forces on their bodies.

    Args:
      model: model of which those of the worlds are variants.
      states: integration states of the worlds `(n, nstate)`.
      ctrl: controls in them `(n, nu)`.
      forces: forces in them `(n, nbody, 6)`, as `xfrc_applied`.

    Attributes:
      controls: controls without noise `(n, nu)`; `ctrl` itself if there is no noise.

    Raises:
      UsageError: a push does not fit the model.
    """

    def __init__(
        self, task: Task, model: mujoco.MjModel, states: np.ndarray, ctrl: np.ndarray, forces: np.ndarray
    ) -> None:
        self._task, self._states, self._ctrl, self._forces = task, states, ctrl, forces
        self._timestep = rational(model.opt.timestep)
        PushForces(model, task.push, self._timestep)  # which finds its bodies
        self._is_noisy = bool(task.ctrl_noise)
        self.controls = ctrl.copy() if self._is_noisy else ctrl
        self._noises = dict[int, ControlNoise]()
        self._pushes = dict[int, tuple[PushForces, mujoco.MjData]]()
        self._until = np.zeros(len(states), int)  # step up to which the forces are known

    def __bool__(self) -> bool:
        return self._is_noisy or bool(self._task.push)

    @property
    def memory(self) -> list[np.ndarray]:
        """The controls without noise, if they are separate."""
        return [self.controls] if self._is_noisy else []

    def noise(self, world: int) -> ControlNoise | None:
        """Returns the noise in the episode of a world."""
        return self._noises.get(world)

    def pushes(self, world: int) -> PushForces | None:
        """Returns the pushes in the episode of a world."""
        return self._pushes[world][0] if world in self._pushes else None

    def begin(self, world: int, seed: int, model: mujoco.MjModel) -> None:
        """Begins the episode of `seed` in a world with this model, which is in its initial state."""
        if self._is_noisy:
            self.controls[world] = self._ctrl[world]
        self.resume(world, seed, model)

    def resume(self, world: int, seed: int, model: mujoco.MjModel) -> None:
        """Continues the episode of `seed` in a world with this model."""
        task = self._task
        if self._is_noisy:
            std, correlation = task.ctrl_noise or 0.0, task.ctrl_noise_time or 0.0
            self._noises[world] = ControlNoise(std, correlation, seed, model.opt.timestep, model.nu)
        if task.push:
            self._pushes[world] = PushForces(model, task.push, self._timestep), mujoco.MjData(model)
        self._until[world] = 0

    def apply(self, worlds: np.ndarray, steps: np.ndarray) -> int:
        """Sets controls and forces of `worlds` `(k,)` at `steps` `(k,)`; returns for how many steps they hold."""
        holds = NEVER
        for world, step in zip(worlds.tolist(), steps.tolist(), strict=True):
            if self._is_noisy:
                self._ctrl[world] = self.controls[world] + self._noises[world].rows(step, 1)[0]
                holds = 1
            if self._task.push:
                if step >= self._until[world]:
                    self._push(world, step)
                holds = min(holds, int(self._until[world]) - step)
        return holds

    def _push(self, world: int, step: int) -> None:
        pushes, data = self._pushes[world]
        state.restore(pushes.model, data, self._states[world])
        self._forces[world] = pushes.on_bodies(data, step)
        self._until[world] = pushes.next_change(step)
