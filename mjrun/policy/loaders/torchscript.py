"""TorchScript modules (.pt): an export format of Isaac Lab and rsl_rl."""

import copy
import io
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjrun.errors import FileError, UsageError, clean, described_type
from mjrun.packages import require
from mjrun.policy.policy import POLICY, ActionSpace, Actor, Policy, PolicyFormat, require_trusted_file

if TYPE_CHECKING:
    from torch.jit import ScriptModule  # pyright: ignore[reportMissingImports]


class TorchScriptPolicy(Policy):
    """A network with its weights. It may contain state, with or without `reset()`, so every episode gets a copy.

    Raises:
      UsageError: it is not trusted.
      FileError: it cannot be read, or contains weights alone.
      MissingExtraError: torch is not installed.
    """

    def __init__(self, path: Path, name: str, *, trust: bool) -> None:
        require_trusted_file(path, trust)
        super().__init__(name)
        self._network = _read(path)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        network = copy.deepcopy(self._network)
        if hasattr(network, "reset"):
            with self._errors_as("reset"):
                network.reset()
        return lambda observation: self._act(network, observation)

    def _act(self, network: "ScriptModule", observation: np.ndarray) -> np.ndarray:
        import torch  # pyright: ignore[reportMissingImports]

        with torch.inference_mode(), self._errors_as("computed"):
            action = network(torch.from_numpy(observation.astype(np.float32))[None])
        if not isinstance(action, torch.Tensor):
            what = f"returned {described_type(action)}, not a tensor; export the network with its actions alone"
            raise UsageError(f"policy {clean(self.name)} {what}", POLICY)
        return action.to(torch.float64).numpy().reshape(-1)

    @contextmanager
    def _errors_as(self, done: str) -> Generator[None]:
        """Converts errors of the network, which cannot be `done`."""
        try:
            yield
        except RuntimeError as error:
            reason = clean(str(error).strip().splitlines()[-1])
            raise UsageError(f"policy {clean(self.name)} cannot be {done}: {reason}", POLICY) from error


def _read(path: Path) -> "ScriptModule":
    require("a policy in TorchScript", "", "torch")
    import torch  # pyright: ignore[reportMissingImports]

    torch.set_num_threads(1)  # for a fixed order of sums
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch deprecates the export format of Isaac Lab and rsl_rl
            return torch.jit.load(io.BytesIO(path.read_bytes()), map_location="cpu").eval()
    except (RuntimeError, ValueError) as error:
        advice = "a checkpoint has weights without the network; export the policy as ONNX or TorchScript"
        raise FileError(
            path, "is not TorchScript", f"{advice}\n{clean(str(error)).partition(chr(10))[0][:200]}"
        ) from error


FORMAT = PolicyFormat(
    (".pt", ".pth", ".jit", ".torchscript"),
    lambda path, name, trust, normalize: TorchScriptPolicy(path, name, trust=trust),
    packages=("torch",),
)
