"""A small task, and a policy for it in Python, for tests."""

from pathlib import Path

from mjrun.task.task import Action, Observation, Reset, Task, Termination
from tests.cases import mjcf

XML = mjcf("cart_on_floor")
POLICY = """
import numpy as np

def act(observation):
    return np.array([-2.0 * observation[0] - 1.2 * observation[1]])

def weak(observation):
    return np.array([-0.1 * observation[0]])

CALLS = []

def counting(observation):
    CALLS.append(0)
    return np.array([0.01 * len(CALLS)])

class Broken:
    def __init__(self):
        self.calls = 0

    def act(self, observation):
        self.calls += 1
        return np.array([np.nan if self.calls > 7 else 0.0])

class Late:
    # The episode of seed 7 is the first that fails; those of later seeds fail at earlier steps.
    def reset(self, seed):
        self.seed, self.calls = seed, 0

    def act(self, observation):
        self.calls += 1
        if self.seed >= 7 and self.calls > 40 - 3 * (self.seed - 5):
            raise KeyError(f"seed {self.seed}, call {self.calls}")
        return np.zeros(1)

class NotNumber(Late):
    def act(self, observation):
        try:
            return super().act(observation)
        except KeyError:
            return np.array([np.nan])

class LateCrash(Late):
    def act(self, observation):
        try:
            return super().act(observation)
        except KeyError:
            import os
            os.abort()

class Crashing:
    def act(self, observation):
        import os, sys
        print("out of luck", file=sys.stderr, flush=True)
        os.abort()

    def reset(self):
        pass

class Mixed(Late):
    # Three of the episodes of seeds 5, 6, 7 … fail, each in another way; that of seed 8 ends its process.
    def act(self, observation):
        import os, time
        self.calls += 1
        if self.calls > 4:
            if self.seed == 6:
                return np.array([np.nan])
            if self.seed == 8:
                os.abort()
            if self.seed == 9:
                raise KeyError("seed 9")
            if self.seed == 11:
                time.sleep(1000)
        return np.array([-2.0 * observation[0] - 1.2 * observation[1]])

def raising(observation):
    raise KeyError("nothing here")

def wide(observation):
    return np.zeros(3)
"""


def cart_task(folder: Path, *, duration: float = 1.5, rewards: bool = True) -> Task:
    """Returns a task: a cart should reach the middle and must not leave the road; a control period is two timesteps."""
    path = folder / "cart.xml"
    path.write_text(XML)
    return Task(
        path,
        control_dt="0.02",
        duration=duration,
        observations=[
            Observation(name="x", joints=["slider"]),
            Observation(name="v", joints=["slider"], of="qvel"),
        ],
        actions=[Action(actuators=["push"])],
        rewards={"near": "-abs(qpos/slider)", "effort": "-0.01 * ctrl/push^2"} if rewards else {},
        terminations={
            "home": Termination(when="abs(qpos/slider) < 0.02 and abs(qvel/slider) < 0.1", as_="success"),
            "lost": Termination(when="abs(qpos/slider) > 1", as_="failure"),
        },
        reset=Reset(set={"qpos/slider": "uniform(-0.9, 0.9)"}, noise={"qvel/slider": "normal(0, 1.5)"}),
    )


def write_policies(folder: Path) -> Path:
    """Writes a file of Python policies."""
    path = folder / "policies.py"
    path.write_text(POLICY)
    return path
