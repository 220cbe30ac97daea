"""TorchScript modules (.pt): an export format of Isaac Lab and rsl_rl."""

import copy
import io
import pickle
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING
from zipfile import BadZipFile, ZipFile

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
    content = path.read_bytes()
    if _is_checkpoint(content):
        reason = "torch.save wrote weights or pickled objects into it, without the code of the network"
        advice = "export the network with torch.jit.script(network).save('policy.pt'), or with torch.onnx.export"
        raise FileError(path, "is not TorchScript", f"{reason}\n{advice}")
    require("a policy in TorchScript", "", "torch")
    import torch  # pyright: ignore[reportMissingImports]

    torch.set_num_threads(1)  # for a fixed order of sums
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch deprecates the export format of Isaac Lab and rsl_rl
            return torch.jit.load(io.BytesIO(content), map_location="cpu").eval()
    except (RuntimeError, ValueError) as error:
        raise FileError(path, "is not TorchScript", clean(str(error)).partition("\n")[0][:200]) from error


def _is_checkpoint(content: bytes) -> bool:
    """Returns whether torch.save wrote this: a pickle, or an archive of one without the constants of TorchScript."""
    if content.startswith(pickle.PROTO):
        return True
    try:
        with ZipFile(io.BytesIO(content)) as archive:
            names = {PurePosixPath(name).name for name in archive.namelist()}
    except BadZipFile:
        return False
    return "data.pkl" in names and "constants.pkl" not in names


FORMAT = PolicyFormat(
    (".pt", ".pth", ".jit", ".torchscript"),
    lambda path, name, trust, normalize: TorchScriptPolicy(path, name, trust=trust),
    packages=("torch",),
)
