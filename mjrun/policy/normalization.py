"""Normalization of observations by statistics that were kept while a policy was trained."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.errors import FileError, UsageError, clean, counted, option
from mjrun.formats.input_file import decoding, opened
from mjrun.formats.npy_header import read_arrays
from mjrun.policy.policy import ActionSpace, Actor, Policy
from mjrun.policy.safe_unpickler import SUFFIXES as PICKLES
from mjrun.policy.safe_unpickler import Inert, read_inert

SUFFIXES = (*PICKLES, ".npz")
STATISTICS = ("mean", "var", "epsilon", "clip")
EPSILON = 1e-8  # VecNormalize's


@dataclass(frozen=True)
class Statistics:
    """`clip((observation - mean)/sqrt(var + epsilon), -clip, clip)`, as VecNormalize of Stable-Baselines3 has it.

    Attributes:
      mean, var: `(nobs,)`, float64.
      path: of their file.
    """

    mean: np.ndarray
    var: np.ndarray
    epsilon: float
    clip: float
    path: Path

    def normalize(self, observation: np.ndarray) -> np.ndarray:
        """The same as VecNormalize, to the bit: float32."""
        normalized = (observation - self.mean) / np.sqrt(self.var + self.epsilon)
        return np.clip(normalized, -self.clip, self.clip).astype(np.float32)


class NormalizedPolicy(Policy):
    """A policy that observes what is normalized."""

    def __init__(self, policy: Policy, statistics: Statistics) -> None:
        """Raises UsageError if the statistics are of an observation of another size."""
        size, expected = len(statistics.mean), policy.facts.observation_size
        if expected is not None and size != expected:
            what = f"{option('normalize')} {clean(str(statistics.path))} is of {counted(size, 'number')}"
            raise UsageError(f"{what}, and {option('policy')} {clean(policy.name)} observes {expected}")
        super().__init__(policy.name, policy.facts)
        self._policy, self._statistics = policy, statistics

    def start(self, seed: int, actions: ActionSpace) -> Actor:
        actor = self._policy.start(seed, actions)
        return lambda observation: actor(self._normalize(observation))

    def _normalize(self, observation: np.ndarray) -> np.ndarray:
        mean = self._statistics.mean
        if len(observation) != len(mean):
            what = f"{option('normalize')} {clean(str(self._statistics.path))} is of {counted(len(mean), 'number')}"
            raise UsageError(f"{what}, and the task gives {len(observation)}")
        return self._statistics.normalize(observation)


def normalized(policy: Policy, path: Path) -> Policy:
    """`policy` with the statistics at `path`; itself, if they are of rewards alone.

    Raises:
      FileError: the file cannot be read, or holds no statistics.
      UsageError: they are of an observation of another size.
    """
    statistics = read_statistics(path)
    return policy if statistics is None else NormalizedPolicy(policy, statistics)


def read_statistics(path: Path) -> Statistics | None:
    """The statistics in a file; None if VecNormalize did not normalize observations. Runs no code of a pickle.

    Raises:
      FileError: the file cannot be read, or holds no statistics.
      UsageError: it is of another kind.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"{option('normalize')}: {clean(str(path))} is none of {', '.join(SUFFIXES)}, and not none")
    values = _archive(path) if suffix == ".npz" else _vec_normalize(path)
    return None if values is None else _statistics(values, path)


def _archive(path: Path) -> dict[str, object]:
    with opened(path, "file of statistics", SUFFIXES) as file, decoding(path, "cannot be read as .npz"):
        return {"epsilon": EPSILON, "clip": math.inf, **read_arrays(path, file, STATISTICS)}


def _vec_normalize(path: Path) -> dict[str, object] | None:
    root = read_inert(path)
    state = root.values if isinstance(root, Inert) and root.name.endswith(".VecNormalize") else {}
    if not state:
        raise FileError(path, "holds no VecNormalize of Stable-Baselines3")
    if state.get("norm_obs") is False:
        return None
    running = state.get("obs_rms")
    if not isinstance(running, Inert):
        raise FileError(path, "holds statistics of several observations by name; only one is supported")
    return {**running.values, "epsilon": state.get("epsilon"), "clip": state.get("clip_obs")}


def _statistics(values: dict[str, object], path: Path) -> Statistics:
    try:
        mean, var = (np.asarray(values[name], np.float64) for name in ("mean", "var"))
        epsilon, clip = (float(cast("float", values[name])) for name in ("epsilon", "clip"))
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(path, "holds no statistics: mean, var, epsilon and clip") from error
    fits = mean.ndim == 1 and mean.shape == var.shape and len(mean) > 0
    if not fits or not (np.isfinite(mean).all() and np.isfinite(var).all() and (var + epsilon > 0).all() and clip > 0):
        raise FileError(path, "its mean and var are not two lists of as many finite numbers, with var from 0 on")
    return Statistics(mean, var, epsilon, clip, path)
