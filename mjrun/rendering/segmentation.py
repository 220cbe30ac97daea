"""Which object each geom of a scene belongs to, and what a segmentation tells apart."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from mjrun.model.names import KINDS, names
from mjrun.model.rendered_view import Segment

NOTHING = -1
BODY_OF = {"geom": "geom_bodyid", "site": "site_bodyid", "joint": "jnt_bodyid", "camera": "cam_bodyid"}
BODY_OF |= {"light": "light_bodyid"}
DRAWN = ("geom", "site", "tendon", "flex", "skin", "joint", "actuator", "camera", "light", "body")


class Segmentation:
    """What is told apart, by object, by body or by whole tree of bodies.

    Args:
      by: `object`, every geom, site, tendon, flex, skin, … for itself; one of these kinds, all else being
        nothing; `body`; or `root-body`, a body of the world with all that hangs on it.

    Attributes:
      legend: what the ids mean: the same for every frame, whatever is in view.
    """

    def __init__(self, model: mujoco.MjModel, by: str = "object") -> None:
        self._of: dict[int, np.ndarray] = {}  # type of object to the ids of its objects
        self.legend: list[Segment] = []
        (self._by_body if by in ("body", "root-body") else self._by_object)(model, by)

    def ids(self, scene: mujoco.MjvScene) -> np.ndarray:
        """The id of what is drawn in each colour: `(ngeom + 1,)` int32, for the segment ids 0 (nothing) and up."""
        found = np.full(scene.ngeom + 1, NOTHING, np.int32)
        for geom in scene.geoms[: scene.ngeom]:
            known = self._of.get(geom.objtype)
            if known is not None and 0 <= geom.objid < len(known) and 0 <= geom.segid < scene.ngeom:
                found[geom.segid + 1] = known[geom.objid]
        return found

    def _by_object(self, model: mujoco.MjModel, by: str) -> None:
        bodies = names(model, "body")
        for kind in DRAWN if by == "object" else (by,):
            found = names(model, kind)
            self._of[int(KINDS[kind])] = np.arange(len(self.legend), len(self.legend) + len(found), dtype=np.int32)
            owners = getattr(model, BODY_OF[kind]) if kind in BODY_OF else range(model.nbody) if kind == "body" else ()
            owner = [bodies[i] for i in owners] or [""] * len(found)
            self.legend += [Segment(kind, i, name, owner[i]) for i, name in enumerate(found)]

    def _by_body(self, model: mujoco.MjModel, by: str) -> None:
        found = names(model, "body")
        tree = model.body_rootid if by == "root-body" else np.arange(model.nbody)
        roots, index = np.unique(tree, return_inverse=True)
        self.legend = [Segment(by, int(i), found[i], found[i]) for i in roots]
        self._of[int(KINDS["body"])] = index.astype(np.int32)
        for kind, owners in BODY_OF.items():
            self._of[int(KINDS[kind])] = index[getattr(model, owners)].astype(np.int32)
        for kind, body in (("flex", _flex_body(model)), ("skin", _skin_body(model))):
            ids = [index[body(i)] if body(i) >= 0 else NOTHING for i in range(len(names(model, kind)))]
            self._of[int(KINDS[kind])] = np.array(ids, np.int32)


def _flex_body(model: mujoco.MjModel) -> Callable[[int], int]:
    """The body that a flex hangs on: that of its first vertex."""
    return lambda i: int(model.flex_vertbodyid[model.flex_vertadr[i]]) if model.flex_vertnum[i] else NOTHING


def _skin_body(model: mujoco.MjModel) -> Callable[[int], int]:
    """The body that moves a skin first."""
    return lambda i: int(model.skin_bonebodyid[model.skin_boneadr[i]]) if model.skin_bonenum[i] else NOTHING


def groupings() -> Sequence[str]:
    """What a segmentation can tell apart."""
    return ("object", *DRAWN[:-1], "body", "root-body")
