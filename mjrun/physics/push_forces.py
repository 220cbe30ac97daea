"""Pushes in a simulation: the steps on which they act, and the forces on the bodies at each."""

from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property

import mujoco
import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.model.names import identify, names
from mjrun.options.simulation import Push
from mjrun.physics.control import NEVER
from mjrun.timeline import nearest

WORLD = 0  # the body that cannot be pushed


@dataclass(frozen=True)
class _TimedPush:
    """A push of a body on some steps, at its centre of mass or at a site on it."""

    text: str
    body: int
    site: int | None
    force: np.ndarray
    steps: range


class PushForces:
    """The forces of all pushes of a simulation; those that overlap add up.

    Step k is pushed when round(at / timestep) ≤ k < round((at + duration) / timestep).

    Args:
      timestep: [s], exact.

    Attributes:
      model: model of the bodies.

    Raises:
      UsageError: an object does not exist or cannot be pushed, or a push is too short for any step.
    """

    def __init__(self, model: mujoco.MjModel, pushes: Sequence[Push], timestep: Fraction) -> None:
        self.model = model
        self._pushes: list[_TimedPush] = []
        for index, push in enumerate(pushes):
            with concerning("push", index):
                body, site = _find(model, push.target)
                self._pushes.append(
                    _TimedPush(clean(str(push)), body, site, np.array(push.force), _steps(push, timestep))
                )

    @cached_property
    def _scratch(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    def __bool__(self) -> bool:
        return bool(self._pushes)

    def next_change(self, step: int) -> int:
        """Returns the first step after `step` at which `on_bodies` may change."""
        if any(push.site is not None and step in push.steps for push in self._pushes):
            return step + 1  # the lever of a force at a site turns with the body
        edges = [edge for push in self._pushes for edge in (push.steps.start, push.steps.stop)]
        return min((edge for edge in edges if edge > step), default=NEVER)

    def on_bodies(self, data: mujoco.MjData, step: int) -> np.ndarray:
        """Returns the forces and torques `(nbody, 6)` [N, N·m] at `step`, in the order of `xfrc_applied`.

        A force F at a site s acts on a body with its centre of mass at c as F with the torque (s - c) × F.

        Args:
          data: an MjData in the state at `step`; its derived fields are not used.
        """
        wrenches = np.zeros((self.model.nbody, 6))
        active = [push for push in self._pushes if step in push.steps]
        if any(push.site is not None for push in active):
            self._place(data)
        for push in active:
            wrenches[push.body, :3] += push.force
            if push.site is not None:
                lever = self._scratch.site_xpos[push.site] - self._scratch.xipos[push.body]
                wrenches[push.body, 3:] += np.cross(lever, push.force)
        return wrenches

    def remarks(self, steps: int) -> list[str]:
        """Returns a warning for each push that has no effect in a simulation of `steps` steps."""
        texts: list[str] = []
        for push in self._pushes:
            if push.steps.start >= steps:
                begin = f"begins at step {push.steps.start}, and the simulation has {steps} step{'s' * (steps != 1)}"
                texts.append(f"{option('push')} {push.text} does nothing: it {begin}")
            elif self.model.body_treeid[push.body] < 0:
                texts.append(f"{option('push')} {push.text} does nothing: no joint lets the body move")
        return texts

    def _place(self, data: mujoco.MjData) -> None:
        """Computes the positions of bodies and sites in the state of `data`."""
        scratch = self._scratch
        scratch.qpos[:], scratch.mocap_pos[:], scratch.mocap_quat[:] = data.qpos, data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(self.model, scratch)


def _find(model: mujoco.MjModel, target: str) -> tuple[int, int | None]:
    """Returns the body that `target` names, and the site on it if `target` is one."""
    kind, colon, name = target.partition(":")
    if colon and kind in ("body", "site"):
        index = identify(model, kind, name)
    elif target in (bodies := names(model, "body")):
        kind, index = "body", bodies.index(target)
    elif target in (sites := names(model, "site")):
        kind, index = "site", sites.index(target)
    else:
        movable = [site for site, body in zip(sites, model.site_bodyid, strict=True) if body != WORLD]
        named = [*bodies[1:], *movable]
        valid = list(dict.fromkeys(named))
        raise UnknownNameError("body or site", target, valid, option("push"), plural="bodies and sites")
    body = int(model.site_bodyid[index]) if kind == "site" else index
    if body == WORLD:
        what = f"the site {clean(target)} is fixed to the world" if kind == "site" else "the target is the world"
        raise UsageError(f"{option('push')}: {what}, which a force cannot move")
    return body, index if kind == "site" else None


def _steps(push: Push, timestep: Fraction) -> range:
    steps = range(nearest(push.at / timestep), nearest((push.at + push.duration) / timestep))
    if not steps:
        raise UsageError(
            f"{option('push')} {clean(str(push))} is too short: it contains no step of {float(timestep):g} s\n"
            f"set its duration to {float(timestep):g} s or longer"
        )
    return steps
