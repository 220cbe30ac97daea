"""Objects that are looked at or followed: by name, and where they go over a recording."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError
from mjrun.model.names import PLURALS, identify, names
from mjrun.model.state import restore

# In the order in which a bare name is looked up, with their position in MjData.
TARGETS = {"body": "xpos", "geom": "geom_xpos", "site": "site_xpos"}
FRAMES = {
    "body": mujoco.mjtObj.mjOBJ_XBODY,  # mjOBJ_BODY would be its centre of mass
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
}


def identify_object(text: str, model: mujoco.MjModel) -> tuple[str, int]:
    """Kind and id of the body, else geom, else site called `text`; `geom:NAME` and `site:NAME` say which.

    Raises:
      UnknownNameError: there is none; the message lists those there are.
    """
    kind, colon, name = text.partition(":")
    if colon and kind in TARGETS:
        return kind, identify(model, kind, name)
    for kind in TARGETS:
        if text in names(model, kind):
            return kind, identify(model, kind, text)
    valid = {kind: [n for n in names(model, kind) if not n.startswith(f"{kind}:")] for kind in TARGETS}
    everything = list(dict.fromkeys(name for known in valid.values() for name in known))
    raise UnknownNameError("object", text, everything, plural=f"{PLURALS['body']}, geoms and sites")


def trail(text: str, model: mujoco.MjModel) -> list[tuple[str, int]]:
    """Kinds and ids of the objects in `text`, `OBJECT[,OBJECT…]`, each once.

    Raises:
      UnknownNameError: one of them is not there.
    """
    return list(dict.fromkeys(identify_object(part, model) for part in text.split(",")))


@dataclass(frozen=True)
class ObjectPath:
    """Where an object is, and how fast, at the instants of a recording.

    Attributes:
      times: `(n,)` [s], in order.
      positions: `(n, 3)` [m], of the body's frame, the geom's or the site's.
      velocities: `(n, 3)` [m/s], in the world.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Positions `(m, 3)` at `times` `(m,)`: cubic Hermite arcs through positions and velocities.

        Between the instants of a film, a few hundredths of a second apart, straight lines would show.
        """
        last = len(self.times) - 1
        if not last:
            return np.repeat(self.positions, len(times), axis=0)
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, last - 1)
        span = self.times[i + 1] - self.times[i]
        u = ((times - self.times[i]) / np.where(span > 0, span, 1))[:, None].clip(0, 1)
        start, end = self.positions[i], self.positions[i + 1]
        leaving, arriving = (self.velocities[k] * span[:, None] for k in (i, i + 1))
        return (
            (1 + 2 * u) * (1 - u) ** 2 * start
            + u * (1 - u) ** 2 * leaving
            + u**2 * (3 - 2 * u) * end
            + u**2 * (u - 1) * arriving
        )

    def speeds(self, times: np.ndarray) -> np.ndarray:
        """Speeds `(m,)` [m/s] at `times` `(m,)`, linear in between."""
        return np.interp(times, self.times, np.linalg.norm(self.velocities, axis=1))


def object_paths(
    model: mujoco.MjModel, objects: Sequence[tuple[str, int]], states: Iterable[np.ndarray]
) -> list[ObjectPath]:
    """The path of each of `objects`, as kind and id, through integration `states`, which are read once.

    Velocities are MuJoCo's own (mj_objectVelocity), of each instant by itself: no time between states is too
    long for them. Those of mocap bodies, which have none, are zero.
    """
    data = mujoco.MjData(model)
    times: list[float] = []
    points: list[list[np.ndarray]] = []
    velocity = np.empty(6)  # rotation first
    for state in states:
        restore(model, data, state)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        times.append(data.time)
        row = []
        for kind, index in objects:
            mujoco.mj_objectVelocity(model, data, FRAMES[kind].value, index, velocity, 0)
            row.append(np.concatenate([getattr(data, TARGETS[kind])[index], velocity[3:]]))
        points.append(row)
    found = np.array(points).reshape(len(times), len(objects), 6)
    return [ObjectPath(np.array(times), found[:, k, :3], found[:, k, 3:]) for k in range(len(objects))]
