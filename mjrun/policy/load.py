"""From what the user wrote to a policy."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, clean, option, suggestion
from mjrun.formats.input_file import is_file, is_folder
from mjrun.options.policy import BUILT_IN, NONE, RANDOM, ZERO, is_code
from mjrun.policy.loaders import loader_of, loaders
from mjrun.policy.normalization import normalized
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.policy.python_policy import PythonPolicy, load_python

STREAM = 1_886_350_441  # keeps the random numbers of policies apart from those of tasks


class RandomPolicy(Policy):
    """Actions that are uniform within the clip of the task, or within [-1, 1] where there is none."""

    def __init__(self) -> None:
        super().__init__(RANDOM)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        low = np.where(np.isfinite(actions.low), actions.low, np.minimum(-1, actions.high - 2))
        high = np.where(np.isfinite(actions.high), actions.high, np.maximum(1, low + 2))
        generator = np.random.default_rng([seed, STREAM])
        return lambda observation: generator.uniform(low, high)


class ZeroPolicy(Policy):
    """Zeros, whatever is observed."""

    def __init__(self) -> None:
        super().__init__(ZERO)

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        return lambda observation: np.zeros(len(actions.names))


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
    loader = loader_of(path)
    return list(dict.fromkeys(loader.files(path))) if loader else [path]


def _load(text: object, trust: bool, normalize: str | None, place: Callable[[str | Path], Path]) -> Policy:
    if isinstance(text, Policy):
        return text
    if not isinstance(text, str):
        return PythonPolicy(text, type(text).__name__)
    if text == RANDOM:
        return RandomPolicy()
    if text == ZERO:
        return ZeroPolicy()
    if is_code(text):
        return load_python(text)
    path = place(text)
    if loader := loader_of(path):
        return loader.load(path, text, trust, normalize)
    kinds = ", ".join([*sorted(each.description for each in loaders()), "FILE.py:NAME", *BUILT_IN])
    raise UsageError(
        f"{option('policy')} {clean(text)} is of no kind that is known{suggestion(text, BUILT_IN)}\n{kinds}"
    )
