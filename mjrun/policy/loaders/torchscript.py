"""TorchScript modules (.pt): an export format of Isaac Lab and rsl_rl."""

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjrun.errors import FileError, UsageError, clean
from mjrun.packages import require
from mjrun.policy.policy import POLICY, ActionSpace, Actor, Policy, PolicyFormat, require_trusted_file

if TYPE_CHECKING:
    from torch.jit import ScriptModule  # pyright: ignore[reportMissingImports]


class TorchScriptPolicy(Policy):
    """A network with its weights. It may contain recurrent state, so every episode gets a copy.

    Raises:
      UsageError: it is not trusted.
      FileError: it cannot be read, or contains weights alone.
      MissingExtraError: torch is not installed.
    """

    def __init__(self, path: Path, name: str, *, trust: bool) -> None:
        require_trusted_file(path, trust)
        super().__init__(name)
        self._path, self._content = path, path.read_bytes()
        self._network = self._read()

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        network = self._network
        if hasattr(network, "reset"):
            network = self._read()
            network.reset()
        return lambda observation: self._act(network, observation)

    def _read(self) -> "ScriptModule":
        require("a policy in TorchScript", "", "torch")
        import torch  # pyright: ignore[reportMissingImports]

        torch.set_num_threads(1)  # for a fixed order of sums
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # torch deprecates the export format of Isaac Lab and rsl_rl
                return torch.jit.load(io.BytesIO(self._content), map_location="cpu").eval()
        except (RuntimeError, ValueError) as error:
            advice = "a checkpoint has weights without the network; export the policy as ONNX or TorchScript"
            raise FileError(
                self._path, "is not TorchScript", f"{advice}\n{clean(str(error)).partition(chr(10))[0][:200]}"
            ) from error

    def _act(self, network: "ScriptModule", observation: np.ndarray) -> np.ndarray:
        import torch  # pyright: ignore[reportMissingImports]

        with torch.inference_mode():
            try:
                action = network(torch.from_numpy(observation.astype(np.float32))[None])
            except RuntimeError as error:
                reason = clean(str(error).strip().splitlines()[-1])
                raise UsageError(f"policy {clean(self.name)} cannot be computed: {reason}", POLICY) from error
        return action.numpy().astype(np.float64).reshape(-1)


FORMAT = PolicyFormat(
    (".pt", ".pth", ".jit", ".torchscript"),
    lambda path, name, trust, normalize: TorchScriptPolicy(path, name, trust=trust),
    packages=("torch",),
)
