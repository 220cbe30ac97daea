"""What `--policy` may be; answers of policies are checked; code runs only where it is trusted."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy

from mjrun.errors import ControllerError, FileError, MjrunError, UsageError
from mjrun.options.option import options_of
from mjrun.options.policy import PolicyOptions
from mjrun.policy.load import PythonPolicy, RandomPolicy, ZeroPolicy, load_policy
from mjrun.policy.loaders import formats, loaders
from mjrun.policy.loaders.onnx import OnnxPolicy
from mjrun.policy.normalization import NormalizedPolicy
from mjrun.policy.policy import ActionSpace, Actor, Policy, require_trusted_file
from tests.policy.action_spaces import unbounded
from tests.policy.networks import linear

NAMES = unbounded(["left", "ri\x1bght"])


class Constant(Policy):
    def __init__(self, answer: object) -> None:
        super().__init__("con\x1bstant")
        self._answer = answer

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return lambda observation: self._answer  # type: ignore[return-value]


@pytest.mark.parametrize("answer", [[1, 2], (1.0, 2.0), np.array([[1, 2]], np.float16), np.array([[1], [2]])])
def test_an_answer_is_a_vector_of_doubles(answer: object) -> None:
    action = Constant(answer).episode(0, NAMES)(np.zeros(3))
    assert action.tolist() == [1, 2]
    assert action.dtype == np.float64


@pytest.mark.parametrize("answer", [[1], 3.0, np.zeros((2, 2)), []])
def test_another_number_of_numbers_shows_both_sides(answer: object) -> None:
    with pytest.raises(
        UsageError, match=r"^policy con\\x1bstant returned \d numbers?, and the task takes 2 actions: left"
    ):
        Constant(answer).episode(0, NAMES)(np.zeros(3))


@pytest.mark.parametrize("answer", ["left", None, {"a": 1}, [[1], [2, 3]]])
def test_what_is_no_number_is_refused(answer: object) -> None:
    with pytest.raises(ControllerError, match=r"^policy con\\x1bstant raised (Type|Value)Error"):
        Constant(answer).episode(0, NAMES)(np.zeros(3))


def test_texts_name_kinds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "policy_of_load_test.py").write_text("def act(observation): return observation")
    path = str(linear(tmp_path / "walk.ONNX", np.ones((2, 3), np.float32)))
    assert isinstance(load_policy("random"), RandomPolicy)
    assert isinstance(load_policy("zero"), ZeroPolicy)
    assert isinstance(load_policy(path), OnnxPolicy)
    assert isinstance(load_policy(f"{tmp_path}/policy_of_load_test.py:act"), PythonPolicy)
    assert load_policy(path).name == path


def test_in_python_policies_and_functions_are_policies() -> None:
    policy = ZeroPolicy()
    assert load_policy(policy) is policy
    assert load_policy(lambda observation: observation).name == "function"


def test_statistics_normalize_and_none_declines(tmp_path: Path) -> None:
    path = str(linear(tmp_path / "walk.onnx", np.ones((2, 3), np.float32)))
    np.savez(tmp_path / "s.npz", mean=np.zeros(3), var=np.ones(3))
    assert isinstance(load_policy(path, normalize=str(tmp_path / "s.npz")), NormalizedPolicy)
    assert isinstance(load_policy(path, normalize="none"), OnnxPolicy)


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("walk.onnx", FileError, r"walk.onnx: no such file"),
        ("walk.h5", UsageError, r"unknown policy format\nformats: LEAPP.*, ONNX.*, Torch.* \(.pt\), FILE.py:NAME"),
        ("wa\x1blk", UsageError, r"^policy wa\\x1blk: unknown policy format"),
        ("ramdom", UsageError, r"unknown policy format \(did you mean .random.\?\)"),
    ],
)
def test_what_is_no_policy_is_refused(name: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        load_policy(name)


def test_a_file_of_code_is_refused_with_the_policies_that_it_defines(tmp_path: Path) -> None:
    path = tmp_path / "walk.py"
    path.write_text("class Walk: pass\ndef run(observation): pass\ndef _helper(): pass\n")
    with pytest.raises(UsageError, match=f"select one of its policies\n{path}:Walk, {path}:run$"):
        load_policy(str(path))


CLIPPED = ActionSpace(["a", "b", "c"], np.array([-2.0, -np.inf, 3.0]), np.array([5.0, np.inf, np.inf]))


def drawn(seed: int, count: int = 500) -> np.ndarray:
    actor = RandomPolicy().episode(seed, CLIPPED)
    return np.array([actor(np.zeros(1)) for _ in range(count)])


def test_random_actions_are_uniform_within_the_clip_or_one() -> None:
    actions = drawn(7)
    for column, (low, high) in zip(actions.T, [(-2, 5), (-1, 1), (3, 5)], strict=True):
        assert scipy.stats.kstest(column, scipy.stats.uniform(low, high - low).cdf).pvalue > 1e-3


def test_they_depend_on_the_seed_alone() -> None:
    assert np.array_equal(drawn(7), drawn(7))
    assert not np.array_equal(drawn(7), drawn(8))
    # and not on numbers that a task draws from the same seed
    assert not np.isin(drawn(7), np.random.default_rng(7).uniform(CLIPPED.low[0], CLIPPED.high[0], 500)).any()


def test_zeros_are_zeros() -> None:
    assert ZeroPolicy().episode(3, CLIPPED)(np.ones(9)).tolist() == [0, 0, 0]


def test_trust_is_asked_for_a_file_that_is_there(tmp_path: Path) -> None:
    path = tmp_path / "walk.zip"
    with pytest.raises(FileError, match="no such file"):
        require_trusted_file(path, False)
    path.touch()
    require_trusted_file(path, True)
    with pytest.raises(UsageError, match=r"walk.zip can run any code when it is opened\nset trust") as error:
        require_trusted_file(path, False)
    assert error.value.path == ("policy",)


def test_the_help_names_the_formats_that_require_trust(tmp_path: Path) -> None:
    help_text = next(each.help for each in options_of(PolicyOptions) if each.name == "policy")
    named = re.search(r"of which (.*) require --trust", help_text)
    assert named
    asking = set[str]()
    for name, loader in zip(formats(), loaders(), strict=True):
        path = tmp_path / f"policy{loader.suffixes[0]}"
        path.touch()
        with pytest.raises(MjrunError) as error:
            load_policy(str(path))
        if "can run any code" in str(error.value):
            asking.add(name.partition(" (")[0])
    assert asking == set(named[1].split(" and "))
