"""What `--policy` may be, code and metadata of mjlab too; answers are checked; code runs only where it is trusted."""

import re
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import scipy.stats

from mjrun.errors import ControllerError, FileError, MjrunError, UnknownNameError, UsageError
from mjrun.options.option import options_of
from mjrun.options.policy import PolicyOptions
from mjrun.policy.load import NormalizedPolicy, PythonPolicy, RandomPolicy, ZeroPolicy, load_policy
from mjrun.policy.loaders import formats, loaders
from mjrun.policy.loaders.onnx import OnnxPolicy, is_mjlab, mjlab_facts
from mjrun.policy.policy import ActionSpace, Actor, ObservationFacts, Policy, require_trusted_file
from tests.cases import cases
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


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        ("left", "a str"),
        (None, "a NoneType"),
        ({"a": 1}, "a dict"),
        (np.array([1j, 0]), "a ndarray"),
        ([1, 2 + 0j], "a list"),
        ([[1], [2, 3]], "a list"),
        ((np.zeros(2), None), "a tuple (ndarray, NoneType)"),
    ],
)
def test_what_is_no_number_is_refused(answer: object, kind: str) -> None:
    message = rf"^policy con\\x1bstant returned {re.escape(kind)}, not numbers\nthe task takes 2 actions: left, "
    with pytest.raises(ControllerError, match=message):
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
    actions, stats = drawn(7), cast(Any, scipy.stats)
    for column, (low, high) in zip(actions.T, [(-2, 5), (-1, 1), (3, 5)], strict=True):
        assert stats.kstest(column, stats.uniform(low, high - low).cdf).pvalue > 1e-3


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


PATH = Path("walk.onnx")
INFINITE = (float("-inf"), float("inf"))
# As `list_to_csv_str` and `attach_metadata_to_onnx` of mjlab 1.6 write it.
METADATA = {
    "run_path": "local",
    "joint_names": "hip,knee,wheel",
    "joint_stiffness": "20.000,30.000",
    "joint_damping": "1.000,1.500",
    "default_joint_pos": "0.100,-0.200,0.000",
    "command_names": "twist",
    "observation_names": "joint_pos,joint_vel,actions,command",
    "observation_terms_scale": "1.000,0.050,1.000,2.000;2.000;0.250",
    "observation_terms_flatten_history_dim": "1.000,1.000,1.000,1.000",
    "observation_terms_history_length": "0.000,3.000,0.000,0.000",
    "observation_terms_clip": "-inf;inf,-100.000;100.000,-inf;inf,-inf;inf",
    "action_scale": "0.250,0.500",
}


def test_it_is_told_by_its_keys() -> None:
    assert is_mjlab(METADATA)
    assert not is_mjlab({"run_path": "local"})


def test_part_of_it_counts_in_brackets_too_and_says_nothing_else() -> None:
    assert is_mjlab({"joint_names": "hip"})
    facts = mjlab_facts({"joint_names": '["hip", "knee"]', "action_scale": "[0.5, 0.25]"}, PATH)
    assert (facts.joints, facts.action_scale) == (("hip", "knee"), (0.5, 0.25))
    assert (facts.action_target, facts.quaternion_order, facts.action_size) == (None, None, None)


def test_lists_are_facts() -> None:
    facts = mjlab_facts(METADATA, PATH)
    assert facts.joints == ("hip", "knee", "wheel")
    assert facts.action_joints is None  # of three joints two have actuators, and the file does not say which
    assert (facts.action_size, facts.action_scale) == (2, (0.25, 0.5))
    assert (facts.stiffness, facts.damping, facts.default_position) == ((20, 30), (1, 1.5), (0.1, -0.2, 0))
    assert (facts.quaternion_order, facts.control_dt, facts.action_target) == ("wxyz", None, "position")
    assert facts.observations == (
        ObservationFacts("joint_pos", scale=(1,), clip=INFINITE, history=1),
        ObservationFacts("joint_vel", scale=(0.05,), clip=(-5, 5), history=3),  # mjlab clips before it scales
        ObservationFacts("actions", scale=(1,), clip=INFINITE, history=1),
        ObservationFacts("command", scale=(2, 2, 0.25), clip=None, history=1),
    )


def test_clips_of_older_versions_and_one_scale_for_all_actions() -> None:
    older = {
        "observation_terms_history_length": "0,3,0,0",
        "observation_terms_clip": "[-inf, inf],[-100, 100],[-1.5, 2],[-inf, inf]",
        "action_scale": "0.5",
    }
    facts = mjlab_facts({**METADATA, **older, "observation_terms_scale": "1.0,-0.05,1.0,1.0"}, PATH)
    assert facts.action_scale == (0.5,)
    assert [part.history for part in facts.observations or ()] == [1, 3, 1, 1]
    assert [part.clip for part in facts.observations or ()] == [INFINITE, (-5, 5), (-1.5, 2), INFINITE]


def test_what_is_not_said_is_not_known() -> None:
    facts = mjlab_facts({key: METADATA[key] for key in ("joint_names", "observation_names", "action_scale")}, PATH)
    assert facts.default_position is facts.stiffness is facts.action_size is None
    assert facts.observations is not None
    assert facts.observations[1] == ObservationFacts("joint_vel")


@cases("key, text, message")
def test_what_is_otherwise_is_refused(key: str, text: str, message: str) -> None:
    with pytest.raises(FileError, match=rf"^walk.onnx: .*{message}"):
        mjlab_facts({**METADATA, key: text}, PATH)


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


@cases("name, actions")
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


def test_an_answer_beyond_the_floats_is_an_error_of_the_policy() -> None:
    actions = ActionSpace(["left"], np.array([-1.0]), np.array([1.0]))
    policy = load_policy(lambda observation: [10**400])
    with pytest.raises(ControllerError, match="not numbers"):
        policy.episode(0, actions)(np.zeros(1))


def test_code_that_changes_the_working_directory_to_read_its_files_leaves_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    home = tmp_path / "elsewhere"
    home.mkdir()
    (home / "gain.txt").write_text("3")
    read = f"import os, pathlib; os.chdir({str(home)!r}); gain = float(pathlib.Path('gain.txt').read_text())"
    lines = [
        read,
        "class Gain:",
        f"    def __init__(self): {read}; self.first = gain",
        f"    def reset(self): {read}; self.second = gain",
        "    def act(self, observation): return [self.first, self.second]",
    ]
    (tmp_path / "policy_elsewhere.py").write_text("\n".join(lines))
    actor = load_policy("policy_elsewhere.py:Gain").episode(0, NAMES)
    assert actor(np.zeros(3)).tolist() == [3, 3]
    assert Path.cwd() == tmp_path
