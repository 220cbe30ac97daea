"""Spaces of actions."""

from collections.abc import Sequence

import numpy as np

from mjrun.policy.policy import ActionSpace


def unbounded(names: Sequence[str]) -> ActionSpace:
    """Actions without a clip."""
    return ActionSpace(names, np.full(len(names), -np.inf), np.full(len(names), np.inf))
