"""Where the time of a step goes, by MuJoCo's own timers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco

# A phase, its timer (`mjtTimer`, without the prefix), and what it consists of.
PhaseTimer = tuple[str, str, Sequence["PhaseTimer"]]
COLLISION: PhaseTimer = ("collision", "POS_COLLISION", [("broad", "COL_BROAD", ()), ("narrow", "COL_NARROW", ())])
POSITION: PhaseTimer = (
    "position",
    "POSITION",
    [
        ("kinematics", "POS_KINEMATICS", ()),
        ("inertia", "POS_INERTIA", ()),
        COLLISION,
        ("make", "POS_MAKE", ()),
        ("project", "POS_PROJECT", ()),
    ],
)
STEP: PhaseTimer = (
    "step",
    "STEP",
    [
        POSITION,
        ("velocity", "VELOCITY", ()),
        ("actuation", "ACTUATION", ()),
        ("constraint", "CONSTRAINT", ()),
        ("advance", "ADVANCE", ()),
        ("inverse", "INVERSE", ()),
    ],
)
OPTIONAL = ("inverse",)  # left out where they take no time
REST = "other"


@dataclass(frozen=True)
class Phase:
    """One of the phases of a step, as MuJoCo times them, and its parts.

    Attributes:
      name: `step`, `position`, `collision`, …; `other` is what no timer of that level counts.
      seconds: wall time per step, while the timers run.
      share: of the whole step.
      parts: of which it consists.
    """

    name: str
    seconds: float
    share: float
    parts: Sequence["Phase"] = ()


def phases(data: mujoco.MjData) -> Phase | None:
    """The phases of the steps that `data` has taken with timers on; None without any.

    RK4 derives four times a step and its advance is not timed by MuJoCo: it is under `other`.
    """
    whole = data.timer[int(mujoco.mjtTimer.mjTIMER_STEP)]
    if not whole.number or whole.duration <= 0:
        return None
    seconds = {
        name.removeprefix("mjTIMER_"): data.timer[int(i)].duration / whole.number
        for name, i in mujoco.mjtTimer.__members__.items()
        if "NTIMER" not in name
    }
    return _phase(STEP, seconds, seconds["STEP"])


def _phase(timer: PhaseTimer, seconds: Mapping[str, float], step: float) -> Phase:
    name, key, inner = timer
    parts = [_phase(part, seconds, step) for part in inner]
    parts = [part for part in parts if part.seconds or part.name not in OPTIONAL]

    rest = seconds[key] - sum(part.seconds for part in parts)
    if parts and rest > 0:
        parts.append(Phase(REST, rest, rest / step))
    return Phase(name, seconds[key], seconds[key] / step, tuple(parts))
