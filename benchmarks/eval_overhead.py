"""Overhead of `mjrun eval` over bare stepping and inference, for the same episodes and actions on one core.

Episodes are played as by `mjrun eval`, in worlds side by side. They are compared with the unavoidable work: the same
models under the same controls in `mujoco.batch` without any measurement, and the policy on the same observations.
MuJoCo's Python bindings time every stage of every step. A user's own loop pays for that, mjrun does not: `physics` is
the user's loop, `untimed` the same one without these timers, which is the lower bound.

All are timed alternately in one run by CPU time, and each counts with its lowest time over the repetitions, so that
other work on the machine has little effect. `overhead` is the time of mjrun over that of physics and policy, with and
without the timers. Terminations are left out, so that all worlds step to the end.

    python benchmarks/eval_overhead.py
    python benchmarks/eval_overhead.py --episodes 128 --policies random zero
"""

import argparse
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mujoco.batch import Batch

from mjrun.document.task import read_task
from mjrun.evaluation.episode import SIDE_BY_SIDE, TaskPlayer
from mjrun.model.mujoco_globals import without_timers
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace, Policy
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds

SCENES = Path(__file__).resolve().parents[1] / "scenes"
TASKS = ("car_drive", "humanoid_stand", "pendulum_swing_up")


@dataclass(frozen=True)
class Played:
    """Inputs of episodes that were played side by side.

    Attributes:
      worlds: worlds of the episodes.
      observations, controls: observations and controls of each world at each control instant.
      starts: initial states.
    """

    worlds: TaskWorlds
    observations: list[np.ndarray]
    controls: list[np.ndarray]
    starts: np.ndarray


def played(task: Task, policy: Policy, count: int) -> Played:
    """Plays the first `count` episodes."""
    worlds = TaskWorlds(task, count, threads=1)
    space = ActionSpace(worlds.action_names, worlds.actions.low, worlds.actions.high)
    actors = [policy.episode(seed, space) for seed in range(count)]
    observations, seen, controls = worlds.reset(range(count)), list[np.ndarray](), list[np.ndarray]()
    starts = np.stack([worlds.state(world) for world in range(count)])
    for _ in range(task.periods):
        actions = np.stack([actor(each) for actor, each in zip(actors, observations, strict=True)])
        seen.append(observations.copy())
        controls.append(worlds.actions.targets(actions))
        observations = worlds.step(actions).observations
    return Played(worlds, seen, controls, starts)


def stepping(found: Played, timers: AbstractContextManager[None]) -> float:
    """Returns the CPU time of the physics alone, within a context [s]."""
    worlds = found.worlds
    driven = [each.control for each in worlds.actions.driven]  # the other actuators keep what they start with
    batch = Batch(worlds.model(0), worlds.count, 1)
    batch.state[:] = found.starts
    start = time.process_time()
    with timers:
        for control in found.controls:
            batch.ctrl[:, driven] = control
            batch.step(nstep=worlds.control_steps)
    return time.process_time() - start


def inference(found: Played, policy: Policy) -> float:
    """Returns the CPU time of the policy alone [s]."""
    actions = found.worlds.actions
    space = ActionSpace(actions.names, actions.low, actions.high)
    actors = [policy.episode(seed, space) for seed in range(found.worlds.count)]
    start = time.process_time()
    for observations in found.observations:
        for actor, observation in zip(actors, observations, strict=True):
            actor(observation)
    return time.process_time() - start


def timed(run: Callable[[], object]) -> float:
    """Returns the CPU time of a function [s]."""
    start = time.process_time()
    run()
    return time.process_time() - start


def compare(name: str, text: str, episodes: int, repeats: int) -> None:
    """Prints the row of a policy."""
    task = replace(read_task(SCENES / f"{name}.yaml"), terminations={})
    policy = load_policy(text)
    player, found = TaskPlayer(task, policy), played(task, policy, min(episodes, SIDE_BY_SIDE))
    share = episodes / found.worlds.count
    player.play(range(episodes))  # warms up
    rows = [
        (
            timed(lambda: player.play(range(episodes))),
            share * stepping(found, nullcontext()),
            share * stepping(found, without_timers()),
            share * inference(found, policy),
        )
        for _ in range(repeats)
    ]
    ours, bare, untimed, acting = map(min, zip(*rows, strict=True))
    steps = episodes * task.periods
    print(
        f"{name:18} {Path(text).name:16} {steps:8} periods   eval {1e6 * ours / steps:7.1f} us   "
        f"physics {1e6 * bare / steps:7.1f} us   untimed {1e6 * untimed / steps:7.1f} us   "
        f"policy {1e6 * acting / steps:6.1f} us   "
        f"overhead {ours / (bare + acting):.3f} x, {ours / (untimed + acting):.3f} x untimed"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=TASKS)
    parser.add_argument("--policies", nargs="+", default=["zero"], help="on every task; its own ONNX is played too")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    for name in given.tasks:
        own = SCENES / "policies" / f"{name}.onnx"
        for policy in [*given.policies, *([str(own)] if own.is_file() else [])]:
            compare(name, policy, given.episodes, given.repeats)


if __name__ == "__main__":
    main()
