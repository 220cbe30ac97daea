"""Throughput of `mjrun.gym.make_vec`, compared with the vector environments of Gymnasium on the same tasks.

The tasks are Gymnasium's Humanoid-v5 and Ant-v5, written as tasks of mjrun, whose numbers equal theirs to 1e-12
(`lagged`); and the same with quantities of the observed state (`current`), which is the default of mjrun's tasks.
`bare` is `mujoco.batch` alone on all cores: the same models, actions and lengths of episodes without any measurement,
as a user would write it. `untimed` is the same without the timers of MuJoCo's Python bindings, which mjrun switches
off; no environment can beat it. All are stepped alternately in one run, a few steps at a time, with uniformly random
actions. Each block of steps counts with its shortest time over all repetitions, so that other work on the machine has
little effect; ratios above 1 are faster.

With `--single` one environment of each kind is stepped instead: `mjrun.gym.TaskEnv` and Gymnasium's own, alternately,
without wrappers and with the necessary resets. `cost` is the CPU time of mjrun over that of Gymnasium, each of its
fastest turn, so that other work on the machine has little effect; below 1 is faster.

    python benchmarks/eval.py
    python benchmarks/eval.py --single --environments HalfCheetah-v5 Hopper-v5
    python benchmarks/eval.py --environments Hopper-v5 --worlds 256 --steps 200
"""

import argparse
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from mujoco.batch import Batch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for the tests' tasks

import mjrun.gym
from mjrun.model.mujoco_globals import without_log, without_timers
from mjrun.platform.cores import available_cores
from tests.task.gymnasium_tasks import TASKS

CORES = available_cores()
SEED = 1
BLOCK = 10  # steps that are timed together


def stepped(env: VectorEnv, actions: np.ndarray) -> Callable[[int, int], float]:
    """Returns a function that times the steps from one to another [s], including resets."""

    def run(first: int, end: int) -> float:
        if not first:
            env.reset(seed=SEED)
        start = time.perf_counter()
        for action in actions[first:end]:
            env.step(action)
        return time.perf_counter() - start

    return run


def bare(
    worlds: mjrun.gym.TaskVectorEnv, actions: np.ndarray, timers: Callable[[], AbstractContextManager[None]]
) -> Callable[[int, int], float]:
    """Returns a function that times the same steps of the same episodes with `mujoco.batch` alone, in a context [s]."""
    env = worlds.worlds
    model, steps = env.model(0), env.control_steps
    ends = [np.flatnonzero(over) for over in _ends(worlds, actions)]
    worlds.reset(seed=SEED)  # as all others begin
    starts = np.stack([env.state(world) for world in range(env.count)])
    batch = Batch(model, env.count)

    def run(first: int, end: int) -> float:
        if not first:
            batch.state[:] = starts
        start = time.perf_counter()
        with timers():
            for action, over in zip(actions[first:end], ends[first:end], strict=True):
                batch.ctrl[:] = action
                batch.step(nstep=steps)
                batch.state[over] = starts[over]
        return time.perf_counter() - start

    return run


def _ends(worlds: mjrun.gym.TaskVectorEnv, actions: np.ndarray) -> list[np.ndarray]:
    """Returns the worlds in which an episode ends at each step."""
    worlds.reset(seed=SEED)
    return [np.logical_or(*worlds.step(action)[2:4]) for action in actions]


def compare(name: str, count: int, steps: int, repeats: int) -> None:
    """Prints the row of an environment."""
    task = TASKS[name]()
    space = gymnasium.make(name).action_space
    assert isinstance(space, gymnasium.spaces.Box)
    actions = np.random.default_rng(SEED).uniform(space.low, space.high, (steps, count, *space.shape))
    makers: list[Callable[[], gymnasium.Env]] = [lambda: gymnasium.make(name)] * count
    same_step = AutoresetMode.SAME_STEP
    environments = {
        "sync": gymnasium.vector.SyncVectorEnv(makers, autoreset_mode=same_step),
        "async": gymnasium.vector.AsyncVectorEnv(makers, autoreset_mode=same_step),
        "lagged": mjrun.gym.make_vec(task, count, autoreset_mode=same_step),
        "current": mjrun.gym.make_vec(replace_derived(task), count, autoreset_mode=same_step),
    }
    ours = environments["lagged"]
    assert isinstance(ours, mjrun.gym.TaskVectorEnv)
    runs = {kind: stepped(env, actions) for kind, env in environments.items()}
    runs |= {"bare": bare(ours, actions, nullcontext), "untimed": bare(ours, actions, without_timers)}
    blocks = [(first, min(first + BLOCK, steps)) for first in range(0, steps, BLOCK)]
    times = {kind: np.full(len(blocks), np.inf) for kind in runs}
    for _ in range(repeats):
        for index, block in enumerate(blocks):
            for kind, run in runs.items():
                times[kind][index] = min(times[kind][index], run(*block))
    for env in environments.values():
        env.close()

    print(f"{name}, {count} worlds, {steps} steps, {CORES} cores")
    totals = {kind: float(each.sum()) for kind, each in times.items()}
    for kind, total in totals.items():
        ratios = " ".join(f"{totals[other] / total:5.2f} x {other}" for other in ("sync", "async", "bare", "untimed"))
        print(f"  {kind:8} {steps * count / total:9.0f} steps/s   {ratios}")


def compare_single(name: str, steps: int, repeats: int) -> None:
    """Prints the row of a single environment."""
    theirs, ours = gymnasium.make(name).unwrapped, mjrun.gym.TaskEnv(TASKS[name]())
    space = theirs.action_space
    assert isinstance(space, gymnasium.spaces.Box)
    actions = np.random.default_rng(SEED).uniform(space.low, space.high, (steps, *space.shape)).astype(np.float32)
    times = [[single_step(env, actions) for env in (theirs, ours)] for _ in range(repeats)]
    their_time, our_time = map(min, zip(*times, strict=True))
    print(
        f"{name:26} Gymnasium {1e6 * their_time:7.1f} us   mjrun {1e6 * our_time:7.1f} us   "
        f"cost {our_time / their_time:.2f} x"
    )


def single_step(env: gymnasium.Env, actions: np.ndarray) -> float:
    """Returns the CPU time of a step, including resets [s]."""
    env.reset(seed=SEED)
    start = time.process_time()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return (time.process_time() - start) / len(actions)


def replace_derived(task: "mjrun.Task") -> "mjrun.Task":
    """Returns the same task with quantities of the observed state."""
    return replace(task, derived="current")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--environments", nargs="+", choices=sorted(TASKS), help="Humanoid-v5 and Ant-v5, or all single"
    )
    parser.add_argument(
        "--single", action="store_true", help="one environment of each kind, instead of many side by side"
    )
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    warnings.simplefilter("ignore")  # of the models' deprecated attributes
    with without_log():
        if given.single:
            for name in given.environments or TASKS:
                compare_single(name, given.steps, 8 * given.repeats)
            return
        for name in given.environments or ("Humanoid-v5", "Ant-v5"):
            compare(name, given.worlds, given.steps, given.repeats)


if __name__ == "__main__":
    main()
