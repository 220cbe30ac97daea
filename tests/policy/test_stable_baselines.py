"""Archives of Stable-Baselines3: refused until their normalization is said; played as its own `predict` plays them."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, MissingExtraError, UsageError
from mjrun.policy.load import load_policy
from mjrun.policy.loaders.stable_baselines import StableBaselinesPolicy
from tests.policy.action_spaces import unbounded

INSTALLED = importlib.util.find_spec("stable_baselines3") is not None


def test_trust_and_normalization_are_asked_for_before_anything_is_opened(tmp_path: Path) -> None:
    path = tmp_path / "walk.zip"
    path.write_bytes(b"PK\3\4")
    with pytest.raises(UsageError, match="can run any code when it is opened"):
        load_policy(str(path), normalize="none")
    with pytest.raises(UsageError, match=r"keeps the statistics of VecNormalize in a separate file\n") as error:
        load_policy(str(path), trust=True)
    assert error.value.path == ("normalize",)


@pytest.mark.skipif(INSTALLED, reason="Stable-Baselines3 is installed")
def test_without_the_library_the_error_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "walk.zip").write_bytes(b"PK\3\4")
    with pytest.raises(MissingExtraError, match=r"needs stable-baselines3, .*\npip install stable-baselines3"):
        load_policy(str(tmp_path / "walk.zip"), trust=True, normalize="none")


@pytest.mark.parametrize("library", ["libLLVM.so.1", "libother.so"])
def test_it_is_refused_where_triton_would_crash(tmp_path: Path, library: str) -> None:
    for name in ("triton", "stable_baselines3"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported')")
    (tmp_path / "torch.py").write_text("import triton")  # as PyTorch does in the end
    (tmp_path / "walk.zip").write_bytes(b"PK\3\4")
    (tmp_path / library).write_text("stands for Mesa's LLVM, by its name")
    code = f"""import mmap
file = open({str(tmp_path / library)!r}, "rb")
mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
from mjrun.policy.load import load_policy
load_policy({str(tmp_path / "walk.zip")!r}, trust=True, normalize="none")"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    expected = "this process has used software OpenGL" if library.startswith("libLLVM") else "imported"
    assert expected in done.stderr


@pytest.mark.skipif(not INSTALLED, reason="Stable-Baselines3 is large, and not installed")
@pytest.mark.parametrize("algorithm", ["PPO", "SAC", "TD3"])
def test_it_answers_as_predict_does(tmp_path: Path, algorithm: str) -> None:
    import stable_baselines3  # type: ignore[import-not-found]

    model = getattr(stable_baselines3, algorithm)("MlpPolicy", "Pendulum-v1", seed=0)
    model.save(tmp_path / "swing.zip")
    policy = StableBaselinesPolicy(tmp_path / "swing.zip", "swing.zip", trust=True, normalize="none")
    assert (policy.facts.observation_size, policy.facts.action_size) == (3, 1)
    actor = policy.episode(0, unbounded(["torque"]))
    for observation in np.random.default_rng(0).normal(size=(5, 3)):
        expected, _ = model.predict(observation, deterministic=True)
        assert actor(observation).tolist() == expected.tolist()


@pytest.mark.skipif(not INSTALLED, reason="Stable-Baselines3 is large, and not installed")
def test_other_archives_and_discrete_actions_are_refused(tmp_path: Path) -> None:
    from stable_baselines3 import DQN  # type: ignore[import-not-found]

    (tmp_path / "walk.zip").write_bytes(b"PK\3\4")
    with pytest.raises(FileError, match="is not a readable archive of Stable-Baselines3"):
        load_policy(str(tmp_path / "walk.zip"), trust=True, normalize="none")
    DQN("MlpPolicy", "CartPole-v1").save(tmp_path / "walk.zip")
    with pytest.raises(UsageError, match="its action is not a vector of numbers"):
        load_policy(str(tmp_path / "walk.zip"), trust=True, normalize="none")
