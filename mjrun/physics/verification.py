"""Whether physics, stepped again, goes through recorded states: the first step at which it does not."""

import copy
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.errors import FailedStepError
from mjrun.model import state
from mjrun.physics.replay import RecordedStates

PROGRESS = 1000  # states from one report to the next


@dataclass(frozen=True)
class FirstDifference:
    """Where physics leaves the recorded states.

    Attributes:
      index, step: of the first recorded state that differs.
      recorded, stepped: the integration states `(nstate,)` there; inputs are the recorded ones in both.
    """

    index: int
    step: int
    recorded: np.ndarray
    stepped: np.ndarray


def first_difference(
    model: mujoco.MjModel, states: RecordedStates, last: int, progress: Callable[[int], None] = lambda done: None
) -> FirstDifference | None:
    """Steps from the first of `states` up to number `last`, and compares every recorded state, bit for bit.

    Inputs are those recorded: controls, applied forces, mocap poses, active equalities and user data. Between recorded
    states that are further apart than a step they stay what they are at the first of the two.

    Args:
      progress: told from time to time how many states agree.

    Returns:
      Where they differ first; None if they do not.

    Raises:
      FailedStepError: MuJoCo gave up.
    """
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    inputs = state.part(model, state.INPUTS)
    data = mujoco.MjData(model)
    steps = states.steps

    recorded = states.state(0)
    state.restore(model, data, recorded)
    for index in range(1, last + 1):
        try:
            mujoco.mj_step(model, data, nstep=int(steps[index] - steps[index - 1]))
        except mujoco.FatalError as error:
            raise FailedStepError(int(steps[index - 1]), data.time, str(error)) from None
        recorded = states.state(index)
        state.restore(model, data, recorded[inputs], state.INPUTS)
        stepped = state.save(model, data)
        if stepped.tobytes() != recorded.tobytes():
            return FirstDifference(index, int(steps[index]), recorded, stepped)
        if index % PROGRESS == 0:
            progress(index)
    return None
