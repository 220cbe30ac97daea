"""Environments as others register them, for tests: a cart that misbehaves as asked."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.mujoco import MujocoEnv

from mjrun.model.sources.gym import environment_model

CART = """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="5 5 1"/>
<body pos="0 0 .2"><joint name="x" type="slide" axis="1 0 0" damping=".1"/><geom name="cart" size=".1"/></body>
</worldbody><actuator><motor name="motor" joint="x" ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""

RENDER_MODES = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}  # which older Gymnasiums ask for


class Cart(MujocoEnv):
    """A cart on a rail; `fault` says what is wrong with it."""

    metadata = RENDER_MODES

    def __init__(self, path: str, fault: str = "", **kwargs: Any) -> None:
        self.fault = fault
        number = spaces.Box(-np.inf, np.inf, (1,), np.float64)
        space = spaces.Dict(position=number, velocity=number) if fault == "dict" else spaces.Box(-np.inf, np.inf, (2,))
        super().__init__(path, 4, space, **kwargs)
        if fault == "discrete":
            self.action_space = spaces.Discrete(2)

    def step(self, action: np.ndarray) -> Any:
        self.do_simulation(action, self.frame_skip)
        if self.fault == "kicked":
            self.data.qvel[0] += 0.5
        if self.fault == "raises" and self.data.time > 0.1:
            raise ZeroDivisionError("the cart is gone")
        arrived = self.fault == "arrives" and self.data.time > 0.1
        info: dict[str, Any] = {"reward_alive": 1.0, "reward_speed": 0.5, "success": arrived}
        if self.fault == "talks":
            info |= {"reward_terms": {"alive": 1.0}, "reward_unit": "1/s", "reward_of_legs": np.ones(4)}
        return self._seen(), 1.5, arrived, False, info

    def reset_model(self) -> Any:
        self.set_state(self.init_qpos + self.np_random.uniform(-0.1, 0.1, 1), self.init_qvel)
        return self._seen()

    def _seen(self) -> Any:
        seen = self.state_vector()
        return {"position": seen[:1], "velocity": seen[1:]} if self.fault == "dict" else seen


class Held(gymnasium.Env):
    """An environment that holds the one which simulates."""

    def __init__(self, **kwargs: Any) -> None:
        self.cart = Cart(**kwargs)
        self.observation_space, self.action_space = self.cart.observation_space, self.cart.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        print("this must not get into the payload")  # noqa: T201
        return self.cart.reset(seed=seed, options=options)

    def step(self, action: np.ndarray) -> Any:
        return self.cart.step(action)


@contextmanager
def registered(folder: Path, fault: str = "", **kwargs: Any) -> Iterator[str]:
    """Registers a cart that has a fault, and gives its name."""
    (folder / "cart.xml").write_text(CART)
    name = "acme/Cart-v0"
    gymnasium.register(
        name, Held if fault == "held" else Cart, kwargs={"path": str(folder / "cart.xml"), "fault": fault}, **kwargs
    )
    try:
        yield name
    finally:
        gymnasium.registry.pop(name)
        environment_model.cache_clear()
