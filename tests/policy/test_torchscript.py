"""TorchScript: only where it is trusted, each episode with memory of its own."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError, MissingExtraError, UsageError
from mjrun.policy.load import load_policy
from mjrun.policy.loaders.torchscript import TorchScriptPolicy
from tests.policy.networks import LEFT_RIGHT

INSTALLED = importlib.util.find_spec("torch") is not None


def test_trust_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "walk.pt").write_bytes(b"PK\3\4")
    with pytest.raises(UsageError, match="can run any code when it is opened"):
        load_policy(str(tmp_path / "walk.pt"))


@pytest.mark.skipif(INSTALLED, reason="torch is installed")
def test_without_torch_the_error_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "walk.pt").write_bytes(b"PK\3\4")
    with pytest.raises(MissingExtraError, match=r"needs torch, which is not installed\npip install torch"):
        load_policy(str(tmp_path / "walk.pt"), trust=True)


@pytest.mark.skipif(not INSTALLED, reason="torch is large, and not installed")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_memory_is_that_of_an_episode(tmp_path: Path) -> None:
    import torch  # type: ignore[import-not-found]

    class Sum(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.register_buffer("memory", torch.zeros(1, 2))

        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            self.memory[:] = self.memory + observation
            return self.memory.clone()

        @torch.jit.export
        def reset(self) -> None:
            self.memory[:] = 0.0

    torch.jit.script(Sum()).save(tmp_path / "walk.pt")
    policy = load_policy(str(tmp_path / "walk.pt"), trust=True)
    assert isinstance(policy, TorchScriptPolicy)
    one, other = policy.episode(0, LEFT_RIGHT), policy.episode(1, LEFT_RIGHT)
    assert [actor(np.ones(2)).tolist() for actor in (one, one, other, one)] == [[1, 1], [2, 2], [1, 1], [3, 3]]
    with pytest.raises(UsageError, match="cannot be computed"):
        one(np.ones(3))


@pytest.mark.skipif(not INSTALLED, reason="torch is large, and not installed")
def test_a_checkpoint_of_weights_is_told_from_a_network(tmp_path: Path) -> None:
    import torch  # type: ignore[import-not-found]

    torch.save({"actor": torch.zeros(3)}, tmp_path / "model.pt")
    with pytest.raises(FileError, match=r"is not TorchScript\na checkpoint has weights without the network"):
        load_policy(str(tmp_path / "model.pt"), trust=True)
