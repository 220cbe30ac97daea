"""Segmentation: the object, body or tree of bodies that each geom of a scene belongs to."""

from collections.abc import Sequence

import mujoco
import numpy as np

from mjrun.errors import UnknownNameError
from mjrun.model.camera_images import SegmentedObject
from mjrun.model.fields import flex_owners, skin_owners
from mjrun.model.names import KINDS, names

NOTHING = -1
BODY_OF = {"geom": "geom_bodyid", "site": "site_bodyid", "joint": "jnt_bodyid", "camera": "cam_bodyid"}
BODY_OF |= {"light": "light_bodyid"}
DRAWN = ("geom", "site", "tendon", "flex", "skin", "joint", "actuator", "camera", "light", "body")


class SegmentationIds:
    """The assignment of ids to objects, bodies or trees of bodies.

    Args:
      by: `object`, an id for every geom, site, tendon, flex, skin, …; one of these kinds, with all others as
          background; `body`; or `root-body`, a child of the world with all its descendants.

    Attributes:
      legend: the segment of each id: the same for every frame, whatever is in view.
    """

    def __init__(self, model: mujoco.MjModel, by: str = "object") -> None:
        self._ids_by_type: dict[int, np.ndarray] = {}  # type of object to the ids of its objects
        self.legend: list[SegmentedObject] = []
        (self._by_body if by in ("body", "root-body") else self._by_object)(model, by)

    def ids(self, scene: mujoco.MjvScene) -> np.ndarray:
        """Returns the id of each segment number of the scene, `(ngeom + 1,)` int32; number 0 is the background."""
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
            self.legend += [SegmentedObject(kind, i, name, owner[i]) for i, name in enumerate(objects)]

    def _by_body(self, model: mujoco.MjModel, by: str) -> None:
        bodies = names(model, "body")
        tree = model.body_rootid if by == "root-body" else np.arange(model.nbody)
        roots, index = np.unique(tree, return_inverse=True)
        self.legend = [SegmentedObject(by, int(i), bodies[i], bodies[i]) for i in roots]

        self._ids_by_type[int(KINDS["body"])] = index.astype(np.int32)
        for kind, owners in BODY_OF.items():
            self._ids_by_type[int(KINDS[kind])] = index[getattr(model, owners)].astype(np.int32)
        self._ids_by_type[int(KINDS["flex"])] = index[flex_owners(model)].astype(np.int32)
        self._ids_by_type[int(KINDS["skin"])] = np.append(index, NOTHING)[skin_owners(model)].astype(np.int32)


def groupings() -> Sequence[str]:
    """Returns the valid groupings of a segmentation."""
    return ("object", *DRAWN[:-1], "body", "root-body")


def check_segmentation_name(name: str) -> None:
    """Raises UnknownNameError if `name` is not a valid segmentation."""
    if name not in groupings():
        raise UnknownNameError("segmentation", name, list(groupings()))
