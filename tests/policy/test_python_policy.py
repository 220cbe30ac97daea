"""Code as a policy: functions, objects and classes, each episode by itself."""

import sys
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import ControllerError, FileError, UnknownNameError, UsageError
from mjrun.policy.load import PythonPolicy, load_policy
from mjrun.policy.policy import Policy
from tests.policy.action_spaces import unbounded

ONE = unbounded(["motor"])
CODE = '''
class Counter:
    """Counts its calls."""
    def __init__(self):
        self.count = 100
    def reset(self):
        print("reset")
        self.count = 0
    def act(self, observation):
        print("acting")
        self.count += 1
        return [self.count]

class Seeded:
    def reset(self, seed):
        self.seed = seed
    def __call__(self, observation):
        return self.seed

class Predictor:
    """As in Stable-Baselines3."""
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        assert episode_start == [state is None]
        state = (state or 0) + observation[0]
        return [state], state

shared = Counter()

class Forgotten:
    count = 0
    def act(self, observation):
        self.count += 1
        return [self.count]

kept = Forgotten()

def double(observation):
    observation *= 2
    return observation[:1]

def fails(observation):
    raise RuntimeError("no \\x1bway")

VALUE = 3
'''


@pytest.fixture
def code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    path = tmp_path / "policy_in_test.py"
    path.write_text(CODE)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, path.stem, raising=False)
    return str(path)


def acted(policy: Policy, seed: int = 0) -> list[float]:
    actor = policy.episode(seed, ONE)
    return [float(actor(np.array([1.0, 5.0]))[0]) for _ in range(3)]


@pytest.mark.parametrize(
    ("name", "actions"),
    [
        ("Counter", [1, 2, 3]),
        ("shared", [1, 2, 3]),
        ("kept", [1, 2, 3]),
        ("Seeded", [9, 9, 9]),
        ("Predictor", [1, 2, 3]),
        ("double", [2, 2, 2]),
    ],
)
def test_whatever_acts_is_a_policy_and_forgets_between_episodes(
    code: str, name: str, actions: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    policy = load_policy(f"{code}:{name}")
    assert acted(policy, 9) == acted(policy, 9) == actions
    assert capsys.readouterr().out == ""  # what it prints is not payload


def test_an_action_stays_as_it_is_when_the_policy_reuses_its_array() -> None:
    array = np.zeros(1)

    def act(observation: np.ndarray) -> np.ndarray:
        array[0] += 1
        return array

    actor = load_policy(act).episode(0, ONE)
    assert [float(action[0]) for action in [actor(np.zeros(1)) for _ in range(3)]] == [1, 2, 3]


@pytest.mark.parametrize("name", ["shared", "kept"])
def test_episodes_side_by_side_do_not_share_memory(code: str, name: str) -> None:
    policy = load_policy(f"{code}:{name}")
    one, other = policy.episode(0, ONE), policy.episode(1, ONE)
    assert [float(actor(np.zeros(1))[0]) for actor in (one, one, other, one)] == [1, 2, 1, 3]


def test_the_observation_is_the_tasks(code: str) -> None:
    observation = np.array([1.0, 2.0])
    load_policy(f"{code}:double").episode(0, ONE)(observation)
    assert observation.tolist() == [1, 2]


def test_a_function_of_pythons_is_a_policy_too() -> None:
    assert acted(PythonPolicy(lambda observation: observation[1], "it")) == [5, 5, 5]


def test_what_cannot_act_is_refused(code: str) -> None:
    with pytest.raises(UsageError, match=r"is of type int, which cannot act\nFILE.py:NAME or"):
        load_policy(f"{code}:VALUE")
    with pytest.raises(UnknownNameError, match=r"no policy 'dubble' in .* \(did you mean 'double'\?\)\npolicies: "):
        load_policy(f"{code}:dubble")
    with pytest.raises(FileError, match="there is no such file"):
        load_policy(f"{code}.py:double")
    with pytest.raises(ControllerError, match=r"raised RuntimeError: no \\x1bway"):
        acted(load_policy(f"{code}:fails"))
