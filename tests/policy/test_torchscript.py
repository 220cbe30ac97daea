"""TorchScript: only where it is trusted, each episode with memory of its own."""

import importlib.util
import pickle
from pathlib import Path
from zipfile import ZipFile

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
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_memory_without_a_reset_is_that_of_an_episode_too(tmp_path: Path) -> None:
    import torch  # type: ignore[import-not-found]

    class Buffer(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.register_buffer("memory", torch.zeros(1, 2))

        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            self.memory[:] = self.memory + observation
            return self.memory

    class Attributes(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.count, self.memory = 0, torch.zeros(1, 2)

        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            self.count += 1
            self.memory[:] = self.memory + observation
            return self.memory + 10 * self.count

    for network, per_call in ((Buffer(), 1), (Attributes(), 11)):
        torch.jit.script(network).save(tmp_path / "walk.pt")
        policy = load_policy(str(tmp_path / "walk.pt"), trust=True)
        one, other = policy.episode(0, LEFT_RIGHT), policy.episode(1, LEFT_RIGHT)
        answers = [actor(np.ones(2))[0] / per_call for actor in (one, one, other, one)]
        assert answers == [1, 2, 1, 3]


@pytest.mark.skipif(not INSTALLED, reason="torch is large, and not installed")
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_what_does_not_act_alone_is_reported(tmp_path: Path) -> None:
    import torch  # type: ignore[import-not-found]

    class WithValue(torch.nn.Module):
        def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return observation, observation.sum()

    class OfWorlds(torch.nn.Module):
        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            return observation.to(torch.bfloat16)

        @torch.jit.export
        def reset(self, worlds: torch.Tensor) -> None:
            pass

    torch.jit.script(WithValue()).save(tmp_path / "value.pt")
    policy = load_policy(str(tmp_path / "value.pt"), trust=True)
    with pytest.raises(UsageError, match=r"returned a tuple \(.*\), not a tensor; export"):
        policy.episode(0, LEFT_RIGHT)(np.ones(2))
    torch.jit.script(OfWorlds()).save(tmp_path / "worlds.pt")
    with pytest.raises(UsageError, match=r"cannot be reset: reset\(\) is missing value for argument 'worlds'"):
        load_policy(str(tmp_path / "worlds.pt"), trust=True).episode(0, LEFT_RIGHT)


def test_a_checkpoint_of_weights_is_told_from_a_network(tmp_path: Path) -> None:
    with ZipFile(tmp_path / "model.pt", "w") as archive:  # as torch.save writes it
        archive.writestr("model/data.pkl", pickle.dumps({"actor": 0.0}))
        archive.writestr("model/version", "3\n")
    (tmp_path / "old.pt").write_bytes(pickle.dumps({"actor": 0.0}, 2))
    message = r"is not TorchScript\ntorch\.save wrote weights .* without the code of the network\nexport the"
    for name in ("model.pt", "old.pt"):
        with pytest.raises(FileError, match=message):
            load_policy(str(tmp_path / name), trust=True)
