"""Environments of Gymnasium written as tasks, by hand from their sources."""

from pathlib import Path

import gymnasium

from mjrun.task.task import Task
from mjrun.task.terms import Action, Observation, Reset, Reward

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
MOTORS = [Action(actuators="*")]
POSITIONS = {"noise": {"qpos/*": "uniform(-0.005, 0.005)", "qvel/*": "uniform(-0.005, 0.005)"}}


def _task(file: str, control_dt: float, **values: object) -> Task:
    given = {"control_dt": control_dt, "duration": control_dt * 1000, "actions": MOTORS, "derived": "lagged", **values}
    return Task(ASSETS / file, **given)  # type: ignore[arg-type]


def half_cheetah() -> Task:
    return _task(
        "half_cheetah.xml",
        0.05,
        observations=[
            Observation(name="position", probe=["qpos/rootz", "qpos/rooty", "qpos[b*]", "qpos[f*]"]),
            Observation(name="velocity", probe="qvel"),
        ],
        rewards={"forward": "rate(qpos/rootx)", "control": Reward(value='sum("action/*"^2)', weight=-0.1)},
        reset=Reset(noise={"qpos/*": "uniform(-0.1, 0.1)", "qvel/*": "normal(0, 0.1)"}),
    )


TASKS = {"HalfCheetah-v5": half_cheetah}
