"""Where the time of a step goes, by MuJoCo's own timers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco

# A phase, its timer (`mjtTimer`, without the prefix), and what it consists of.
Plan = tuple[str, str, Sequence["Plan"]]
COLLISION: Plan = ("collision", "POS_COLLISION", [("broad", "COL_BROAD", ()), ("narrow", "COL_NARROW", ())])
POSITION: Plan = (
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
STEP: Plan = (
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
OPTIONAL = ("inverse",)  # shown only when it happened
REST = "other"


@dataclass(frozen=True)
class Phase:
    """One of MuJoCo's phases, and those in it.

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
    kinds = {
        name.removeprefix("mjTIMER_"): int(i) for name, i in mujoco.mjtTimer.__members__.items() if "NTIMER" not in name
    }
    seconds = {name: data.timer[i].duration / whole.number for name, i in kinds.items()}
    return _phase(STEP, seconds, seconds["STEP"])


def _phase(plan: Plan, seconds: Mapping[str, float], whole: float) -> Phase:
    name, timer, parts = plan
    found = [_phase(part, seconds, whole) for part in parts]
    found = [part for part in found if part.seconds or part.name not in OPTIONAL]
    rest = seconds[timer] - sum(part.seconds for part in found)
    if found and rest > 0:
        found.append(Phase(REST, rest, rest / whole))
    return Phase(name, seconds[timer], seconds[timer] / whole, tuple(found))
