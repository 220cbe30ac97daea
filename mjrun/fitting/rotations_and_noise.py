"""Properties of measured signals: rotations, given as quaternions, and noise."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, listing, option

Floats = NDArray[np.float64]

PARTS = ("qw", "qx", "qy", "qz")
SHORTEST = 0.5  # least norm of a quaternion that was rounded or averaged
LEAST_NOISE = 1e-7  # noise of simulated data, as a share of the standard deviation of a signal
ROUNDING = 1e-7  # error of simulated numbers in any unit: solvers stop at a tolerance, so that resting bodies creep
FEWEST = 3  # differences that show a resolution
NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of absolute values
OUTLYING = 2.5  # standard deviations at which differences are clipped: contacts and outliers make some large
CLIPPED = 0.97756  # variance of a normal distribution that is clipped there


def rotations(signals: Sequence[str], available: Sequence[str]) -> list[list[int]]:
    """Groups the indices of the four signals of each rotation, in the order of `PARTS`.

    Args:
      available: columns of the model.

    Raises:
      UsageError: some signals of a rotation are missing.
    """
    groups: list[list[int]] = []
    known = set(available)
    for whole in dict.fromkeys(name.rpartition("/")[0] for name in signals if name.rpartition("/")[2] in PARTS):
        names = [f"{whole}/{part}" for part in PARTS]
        if not known.issuperset(names):  # a joint with such a name
            continue
        if missing := [name for name in names if name not in signals]:
            raise UsageError(
                f"{listing(missing)} of the rotation {clean(whole)} must be measured too, or none of it is"
            )
        groups.append([signals.index(name) for name in names])
    return groups


def normalize(values: Floats, groups: Sequence[Sequence[int]], where: str) -> None:
    """Normalizes quaternions in place, with the sign of the row before; incomplete ones become NaN.

    Args:
      values: rows of signals, `(n, signals)`.
      where: name of the table, for errors.

    Raises:
      UsageError: the norm of a quaternion is below `SHORTEST`.
    """
    for group in groups:
        quaternions = values[:, group]
        norms = np.linalg.norm(quaternions, axis=1)
        bad = np.flatnonzero(norms < SHORTEST)
        if len(bad):
            raise UsageError(f"{where}, row {bad[0]}: a quaternion of length {norms[bad[0]]:.3g} is not a rotation")
        quaternions = quaternions / norms[:, None]
        rows = np.flatnonzero(np.isfinite(norms))
        dots = np.sum(quaternions[rows[1:]] * quaternions[rows[:-1]], axis=1)
        quaternions[rows[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
        values[:, group] = quaternions


def align(predicted: Floats, measured: Floats, groups: Sequence[Sequence[int]]) -> None:
    """Normalizes predicted quaternions in place, with the sign that is nearer to the measured ones.

    Their difference is then the chord between two rotations: its length is 2·sin(θ/4) for an angle θ.
    """
    for group in groups:
        quaternions = predicted[:, group]
        nearer = np.where(np.sum(quaternions * measured[:, group], axis=1) < 0, -1.0, 1.0)
        predicted[:, group] = quaternions * (nearer / np.linalg.norm(quaternions, axis=1))[:, None]


def shared(deviations: Floats, groups: Sequence[Sequence[int]]) -> Floats:
    """Replaces the standard deviations of the four numbers of each rotation by their root mean square, `(signals,)`.

    Separately they depend on the orientation: near the identity, `qw` hardly changes.
    """
    deviations = deviations.copy()
    for group in groups:
        deviations[group] = np.sqrt(np.mean(deviations[group] ** 2))
    return deviations


def spread_of(values: Floats, loss: str = "linear") -> Floats:
    """Returns the standard deviation of each signal, `(signals,)`; with a robust loss, estimated by medians."""
    if loss == "linear":
        return np.nanstd(values, axis=0)
    return np.nanmedian(np.abs(values - np.nanmedian(values, axis=0)), axis=0) * NORMAL_MEDIAN


def set_noise(texts: Sequence[tuple[str, str]], signals: Sequence[str]) -> dict[int, float]:
    """Returns the standard deviations that the user has given, by index of the signal.

    Raises:
      UsageError: no signal has this name, or a number is not above 0.
    """
    known: dict[int, float] = {}
    for pattern, text in texts:
        matches = [i for i, name in enumerate(signals) if name == pattern or fnmatchcase(name, pattern)]
        if not matches:
            raise UnknownNameError("signal", pattern, signals, where=option("noise"))
        try:
            deviation = float(text)
        except ValueError:
            deviation = 0.0
        if not 0 < deviation < np.inf:
            raise BadValueError(f"{option('noise')} {clean(pattern)}", text, "a standard deviation above 0")
        known |= dict.fromkeys(matches, deviation)
    return known


def first_noise(parts: Sequence[Floats], rotations: Sequence[Sequence[int]] = ()) -> Floats:
    """Estimates the noise of each signal from third differences, in which smooth motion hardly shows: `(signals,)`.

    Third differences of white noise with standard deviation s have the standard deviation √20·s.

    Args:
      parts: measured values of each segment, `(n, signals)`.
    """
    differences = np.concatenate([np.diff(values, 3, axis=0) for values in parts])
    spread = np.nanmedian(np.abs(differences), axis=0) * NORMAL_MEDIAN
    limit = OUTLYING * np.where(spread > 0, spread, np.inf)
    spread = np.sqrt(np.nanmean(np.clip(differences, -limit, limit) ** 2, axis=0) / CLIPPED / 20) * (spread > 0)
    values = np.concatenate(parts)
    least = LEAST_NOISE * shared(np.nanstd(values, axis=0), rotations) + ROUNDING
    return np.maximum(np.maximum(shared(spread, rotations), least), shared(resolution(values) / np.sqrt(12), rotations))


def resolution(values: Floats) -> Floats:
    """Returns the largest step of which all differences of a signal are multiples, `(signals,)`; about 0 without one.

    Logs with few digits and encoders have one: its rounding is noise even where a signal is constant most of the time.
    """
    steps = np.zeros(values.shape[1])
    for i, column in enumerate(values.T):
        sizes: Floats = np.diff(np.unique(column[np.isfinite(column)]))
        left = sizes[sizes > ROUNDING]
        while len(sizes) >= FEWEST and len(left):  # Euclid's algorithm
            steps[i] = left.min()
            left = np.abs(sizes - steps[i] * np.round(sizes / steps[i]))
            left = left[left > ROUNDING]
    return steps
