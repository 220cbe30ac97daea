"""Overhead of `mjrun eval` over bare stepping and inference, for the same episodes and actions on one core.

Episodes are played as by `mjrun eval`, in worlds side by side. They are compared with the unavoidable work: the same
models under the same controls in `mujoco.batch` without any measurement, and the policy on the same observations.
MuJoCo's Python bindings time every stage of every step. A user's own loop pays for that, mjrun does not: `physics` is
the user's loop, `untimed` the same one without these timers, which is the lower bound.

All are timed alternately, one control period at a time, by CPU time, and each period counts with its lowest time over
the repetitions, so that other work on the machine has little effect. Figures are per period of one episode; the reset
does not count. `overhead` is the time of mjrun over that of physics and policy, with and without the timers.
Terminations are left out, so that all worlds step to the end.

    python benchmarks/eval_overhead.py
    python benchmarks/eval_overhead.py --episodes 64 --policies random zero
"""

import argparse
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mujoco.batch import Batch

from mjrun.document.task import read_task
from mjrun.evaluation.episode import SIDE_BY_SIDE, TaskPlayer
from mjrun.model.mujoco_globals import without_timers
from mjrun.policy.load import load_policy
from mjrun.policy.policy import ActionSpace, Policy
from mjrun.task.episode import Actor
from mjrun.task.task import Task
from mjrun.task.worlds import TaskWorlds

SCENES = Path(__file__).resolve().parents[1] / "scenes"
TASKS = ("car_drive", "humanoid_stand", "pendulum_swing_up")
TIMERS = {"physics": nullcontext, "untimed": without_timers}


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


class LoopBesideEval(Policy):
    """A policy that also takes the steps of a user's loops before its first action in each control period.

    Attributes:
      times: lowest CPU time of each period [s], of the evaluation and of each part of the loops.
    """

    def __init__(self, policy: Policy, found: Played) -> None:
        super().__init__(policy.name, policy.facts)
        self._policy, self._found = policy, found
        self.times = {part: np.full(len(found.controls), np.inf) for part in ("eval", *TIMERS, "policy")}
        self._driven = [each.control for each in found.worlds.actions.driven]  # the others keep what they start with
        self._batches = {part: Batch(found.worlds.model(0), found.worlds.count, 1) for part in TIMERS}
        self._actors: list[Actor] = []
        self._period, self._resumed = -1, 0.0

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        actor = self._policy.start(seed, actions)
        if seed:
            return actor
        for batch in self._batches.values():
            batch.state[:] = self._found.starts
        self._actors = [self._policy.episode(each, actions) for each in range(self._found.worlds.count)]
        self._period = -1

        def act(observation: np.ndarray) -> np.ndarray:
            self.end_period()
            self._run_loops()
            self._resumed = time.process_time()
            return actor(observation)

        return act

    def end_period(self) -> None:
        """Ends a period of the evaluation."""
        if self._period >= 0:
            self._note("eval", self._resumed)
        self._period += 1

    def _run_loops(self) -> None:
        found = self._found
        for part, timers in TIMERS.items():
            batch, start = self._batches[part], time.process_time()
            with timers():
                batch.ctrl[:, self._driven] = found.controls[self._period]
                batch.step(nstep=found.worlds.control_steps)
            self._note(part, start)
        start = time.process_time()
        for actor, observation in zip(self._actors, found.observations[self._period], strict=True):
            actor(observation)
        self._note("policy", start)

    def _note(self, part: str, start: float) -> None:
        times = self.times[part]
        times[self._period] = min(times[self._period], time.process_time() - start)


def compare(name: str, text: str, episodes: int, repeats: int) -> None:
    """Prints the row of a policy."""
    task = replace(read_task(SCENES / f"{name}.yaml"), terminations={})
    policy = load_policy(text)
    beside = LoopBesideEval(policy, played(task, policy, episodes))
    player = TaskPlayer(task, beside)
    for _ in range(repeats):
        player.play(range(episodes))
        beside.end_period()
    ours, bare, untimed, acting = (1e6 * float(times.mean()) / episodes for times in beside.times.values())
    print(
        f"{name:18} {Path(text).name:20} eval {ours:7.1f} us   physics {bare:7.1f} us   untimed {untimed:7.1f} us   "
        f"policy {acting:6.1f} us   overhead {ours / (bare + acting):.3f} x, {ours / (untimed + acting):.3f} x untimed"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=TASKS)
    parser.add_argument("--policies", nargs="+", default=["zero"], help="on every task; its own ONNX is played too")
    parser.add_argument("--episodes", type=int, default=100, help=f"at most {SIDE_BY_SIDE}, all side by side")
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    for name in given.tasks:
        own = SCENES / "policies" / f"{name}.onnx"
        for policy in [*given.policies, *([str(own)] if own.is_file() else [])]:
            compare(name, policy, min(given.episodes, SIDE_BY_SIDE), given.repeats)


if __name__ == "__main__":
    main()
