"""From what the user wrote to a policy."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from mjrun.errors import UsageError, clean, option, suggestion
from mjrun.formats.input_file import is_file, is_folder
from mjrun.options.policy import BUILT_IN, NONE, RANDOM, ZERO, is_code
from mjrun.policy.built_in import RandomPolicy, ZeroPolicy
from mjrun.policy.normalization import normalized
from mjrun.policy.policy import Policy
from mjrun.policy.python_policy import PythonPolicy, load_python
from mjrun.suffixes import is_yaml

ARCHIVES, TORCH = (".zip",), (".pt", ".pth", ".jit", ".torchscript")


def load_policy(
    text: object,
    *,
    trust: bool = False,
    normalize: str | None = None,
    place: Callable[[str | Path], Path] = Path,
) -> Policy:
    """The policy that `text` names: a file, `random`, `zero` or code; in Python also a policy, a function or an object.

    Args:
      trust: whether files that can run code as they are opened may be opened.
      normalize: a file of statistics that observations are normalized with, `none`, or nothing said.
      place: says where files are read; the policy is named by its text in any case.

    Raises:
      UsageError: it cannot be a policy, is not trusted, or its normalization is not said.
      FileError: a file cannot be read, or is damaged.
      ControllerError: its code failed.
      MissingExtraError: a library that it needs is not installed.
    """
    stored = normalize if normalize in (None, NONE) else str(place(normalize))
    policy = _load(text, trust, stored, place)
    return policy if stored in (None, NONE) else normalized(policy, Path(stored))


def files_of(path: Path) -> list[Path]:
    """Returns the files of the policy at `path`, a file or a folder, the first being `path` itself if it is a file."""
    if is_folder(path):
        return sorted(file for file in path.rglob("*") if file.is_file())
    return _files_of(path, path.stat().st_mtime_ns) if is_file(path) else [path]


@lru_cache
def _files_of(path: Path, version: int) -> list[Path]:
    files = [path]
    if is_yaml(path):
        from mjrun.policy.leapp_package import files_beside

        files += files_beside(path)
    networks = [file for file in files if file.suffix.lower() == ".onnx"]
    if networks:
        from mjrun.policy.onnx_model import weight_files

        files += [weights for network in networks for weights in weight_files(network)]
    return list(dict.fromkeys(files))


def _load(text: object, trust: bool, normalize: str | None, place: Callable[[str | Path], Path]) -> Policy:
    if isinstance(text, Policy):
        return text
    if not isinstance(text, str):
        return PythonPolicy(text, type(text).__name__)
    if text == RANDOM:
        return RandomPolicy()
    if text == ZERO:
        return ZeroPolicy()
    return load_python(text) if is_code(text) else _read(place(text), text, trust, normalize)


def _read(path: Path, name: str, trust: bool, normalize: str | None) -> Policy:
    # Each kind is imported where it is read, as its library may not be installed.
    suffix = path.suffix.lower()
    if suffix == ".onnx":
        from mjrun.policy.onnx_policy import OnnxPolicy

        return OnnxPolicy(path, name)
    if is_yaml(path) or is_folder(path):
        from mjrun.policy.leapp import LeappPolicy

        return LeappPolicy(path, name)
    if suffix in ARCHIVES:
        from mjrun.policy.stable_baselines import StableBaselinesPolicy

        return StableBaselinesPolicy(path, name, trust=trust, normalize=normalize)
    if suffix in TORCH:
        from mjrun.policy.torchscript import TorchScriptPolicy

        return TorchScriptPolicy(path, name, trust=trust)
    raise UsageError(
        f"{option('policy')} {clean(name)} is of no kind that is known{suggestion(name, BUILT_IN)}\n"
        ".onnx, a LEAPP package (.yaml or its folder), .zip of Stable-Baselines3, .pt (TorchScript), "
        "FILE.py:NAME, random, zero"
    )
