"""Segmentation: the object, body or tree of bodies that each geom of a scene belongs to."""

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
    """Assigns ids by object, by body or by tree of bodies.

    Args:
      by: `object`, an id for every geom, site, tendon, flex, skin, …; one of these kinds, all others being background;
        `body`; or `root-body`, a child of the world with all its descendants.

    Attributes:
      legend: what the ids mean: the same for every frame, whatever is in view.
    """

    def __init__(self, model: mujoco.MjModel, by: str = "object") -> None:
        self._ids_by_type: dict[int, np.ndarray] = {}  # type of object to the ids of its objects
        self.legend: list[Segment] = []
        (self._by_body if by in ("body", "root-body") else self._by_object)(model, by)

    def ids(self, scene: mujoco.MjvScene) -> np.ndarray:
        """The id of each segment number of the scene, `(ngeom + 1,)` int32; number 0 is the background."""
        ids = np.full(scene.ngeom + 1, NOTHING, np.int32)
        for geom in scene.geoms[: scene.ngeom]:
            by_object = self._ids_by_type.get(geom.objtype)
            if by_object is not None and 0 <= geom.objid < len(by_object) and 0 <= geom.segid < scene.ngeom:
                ids[geom.segid + 1] = by_object[geom.objid]
        return ids

    def _by_object(self, model: mujoco.MjModel, by: str) -> None:
        bodies = names(model, "body")
        for kind in DRAWN if by == "object" else (by,):
            objects, first = names(model, kind), len(self.legend)
            ids = np.arange(first, first + len(objects), dtype=np.int32)
            self._ids_by_type[int(KINDS[kind])] = ids

            owners = getattr(model, BODY_OF[kind]) if kind in BODY_OF else range(model.nbody) if kind == "body" else ()
            owner = [bodies[i] for i in owners] or [""] * len(objects)
            self.legend += [Segment(kind, i, name, owner[i]) for i, name in enumerate(objects)]

    def _by_body(self, model: mujoco.MjModel, by: str) -> None:
        bodies = names(model, "body")
        tree = model.body_rootid if by == "root-body" else np.arange(model.nbody)
        roots, index = np.unique(tree, return_inverse=True)
        self.legend = [Segment(by, int(i), bodies[i], bodies[i]) for i in roots]

        self._ids_by_type[int(KINDS["body"])] = index.astype(np.int32)
        for kind, owners in BODY_OF.items():
            self._ids_by_type[int(KINDS[kind])] = index[getattr(model, owners)].astype(np.int32)
        for kind, body in (("flex", _flex_body(model)), ("skin", _skin_body(model))):
            ids = [index[body(i)] if body(i) >= 0 else NOTHING for i in range(len(names(model, kind)))]
            self._ids_by_type[int(KINDS[kind])] = np.array(ids, np.int32)


def _flex_body(model: mujoco.MjModel) -> Callable[[int], int]:
    """The body of a flex: that of its first vertex."""
    return lambda i: int(model.flex_vertbodyid[model.flex_vertadr[i]]) if model.flex_vertnum[i] else NOTHING


def _skin_body(model: mujoco.MjModel) -> Callable[[int], int]:
    """The body of a skin: that of its first bone."""
    return lambda i: int(model.skin_bonebodyid[model.skin_boneadr[i]]) if model.skin_bonenum[i] else NOTHING


def groupings() -> Sequence[str]:
    """What a segmentation can distinguish."""
    return ("object", *DRAWN[:-1], "body", "root-body")
