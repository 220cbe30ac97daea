"""Worlds of a task as rsl_rl receives them, against `make_vec`; on stand-ins where rsl_rl is absent."""

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mjrun.gym
from tests.gym.tasks import write_cart


class Tensor(np.ndarray):
    """An array with the methods of tensors."""

    def detach(self) -> "Tensor":
        return self

    cpu = numpy = detach

    def long(self) -> np.ndarray:
        return self.astype(int)


def as_tensor(values: Any, dtype: Any = None, device: object = None) -> Tensor:
    return np.asarray(values, dtype).view(Tensor)


def tensors_by_name(values: dict[str, Tensor], **_: object) -> dict[str, Tensor]:
    return values


@pytest.fixture
def torch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The library, or a stand-in that computes with NumPy."""
    if find_spec("rsl_rl"):
        yield pytest.importorskip("torch")
        return
    parts = {
        "torch": {
            "as_tensor": as_tensor,
            "float32": np.float32,
            "long": int,
            "Tensor": Tensor,
            "where": np.where,
            "zeros": lambda count, dtype, device: as_tensor(np.zeros(count, dtype)),
        },
        "rsl_rl.env": {"VecEnv": type("VecEnv", (), {})},
        "tensordict": {"TensorDict": tensors_by_name},
    }
    for name, contents in parts.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    yield SimpleNamespace(as_tensor=as_tensor)
    sys.modules.pop("mjrun.gym.rsl_rl", None)


def test_its_tensors_are_the_numbers_of_the_vector_environment(tmp_path: Path, torch: Any) -> None:
    from mjrun.gym.rsl_rl import TaskVecEnv

    task = write_cart(tmp_path)
    ours, plain = TaskVecEnv(task, 3, seed=2), mjrun.gym.make_vec(task, 3, autoreset_mode="SameStep")
    observations = plain.reset(seed=2)[0]
    lengths = np.zeros(3, int)
    plain.action_space.seed(0)
    assert isinstance(ours, sys.modules["rsl_rl.env"].VecEnv)
    for _ in range(60):
        np.testing.assert_array_equal(ours.get_observations()["policy"], observations.astype(np.float32))
        actions = plain.action_space.sample()
        got, rewards, dones, extras = ours.step(torch.as_tensor(actions))
        observations, expected, terminated, truncated, _ = plain.step(actions)
        np.testing.assert_array_equal(got["policy"], observations.astype(np.float32))
        np.testing.assert_array_equal(rewards, expected.astype(np.float32))
        np.testing.assert_array_equal(dones, terminated | truncated)
        np.testing.assert_array_equal(extras["time_outs"], truncated & ~terminated)
        lengths = np.where(terminated | truncated, 0, lengths + 1)
        np.testing.assert_array_equal(ours.episode_length_buf, lengths)
        assert sum(extras["log"].values()) == pytest.approx(expected.mean())  # of worlds that end in this step, too
    assert ours.num_actions == len(plain.worlds.action_names)
    assert ours.max_episode_length == plain.task.periods
