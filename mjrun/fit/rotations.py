"""Measured rotations: columns of quaternions, of which one and its negative mean the same."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjrun.errors import UsageError, clean, listing

PARTS = ("qw", "qx", "qy", "qz")
SHORTEST = 0.5  # norm of what may be a quaternion that was rounded or averaged

Floats = NDArray[np.float64]


def rotations(signals: Sequence[str], available: Sequence[str]) -> list[list[int]]:
    """Which signals are the four numbers of a rotation, by their places.

    Args:
      available: the columns of the model.

    Raises:
      UsageError: some numbers of a rotation are missing.
    """
    groups: list[list[int]] = []
    known = set(available)
    for whole in dict.fromkeys(name.rpartition("/")[0] for name in signals if name.rpartition("/")[2] in PARTS):
        names = [f"{whole}/{part}" for part in PARTS]
        if not known.issuperset(names):  # joints that are called so
            continue
        if missing := [name for name in names if name not in signals]:
            raise UsageError(
                f"{listing(missing)} of the rotation {clean(whole)} must be measured too, or none of it is"
            )
        groups.append([signals.index(name) for name in names])
    return groups


def normalize(values: Floats, groups: Sequence[Sequence[int]], where: str) -> None:
    """Gives quaternions in rows of signals unit length, and the sign of the one before; a part of one is none.

    Raises:
      UsageError: one is nowhere near unit length; `where` is the table.
    """
    for group in groups:
        quaternions = values[:, group]
        norms = np.linalg.norm(quaternions, axis=1)
        bad = np.flatnonzero(norms < SHORTEST)
        if len(bad):
            raise UsageError(f"{where}, row {bad[0]}: a quaternion of length {norms[bad[0]]:.3g} is no rotation")
        quaternions = quaternions / norms[:, None]  # NaN as a whole where a part is missing
        rows = np.flatnonzero(np.isfinite(norms))
        dots = np.sum(quaternions[rows[1:]] * quaternions[rows[:-1]], axis=1)
        quaternions[rows[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
        values[:, group] = quaternions


def align(predicted: Floats, measured: Floats, groups: Sequence[Sequence[int]]) -> None:
    """Gives predicted quaternions in rows of signals unit length, and the sign that is nearer to the measured ones.

    Their difference is then the chord between two rotations, 2·sin(θ/4) long for an angle of θ.
    """
    for group in groups:
        quaternions = predicted[:, group]
        nearer = np.where(np.sum(quaternions * measured[:, group], axis=1) < 0, -1.0, 1.0)
        predicted[:, group] = quaternions * (nearer / np.linalg.norm(quaternions, axis=1))[:, None]


def shared(deviations: Floats, groups: Sequence[Sequence[int]]) -> Floats:
    """Standard deviations of signals, `(signals,)`, in which the four numbers of a rotation have one in common.

    By themselves they depend on where the rotation happens to be: that of no rotation has a `qw` that hardly changes.
    """
    deviations = deviations.copy()
    for group in groups:
        deviations[group] = np.sqrt(np.mean(deviations[group] ** 2))
    return deviations
