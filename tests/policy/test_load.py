"""What `--policy` may be, and what it then is."""

import sys
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.policy.built_in import RandomPolicy, ZeroPolicy
from mjrun.policy.load import load_policy
from mjrun.policy.normalization import NormalizedPolicy
from mjrun.policy.onnx_policy import OnnxPolicy
from mjrun.policy.python_policy import PythonPolicy
from tests.policy.networks import linear


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
        ("walk.h5", UsageError, r"^policy walk.h5 is of no kind that is known\n.onnx, "),
        ("wa\x1blk", UsageError, r"^policy wa\\x1blk is of no kind"),
        ("ramdom", UsageError, r"is of no kind that is known \(did you mean .random.\?\)"),
    ],
)
def test_what_is_no_policy_is_refused(name: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        load_policy(name)
