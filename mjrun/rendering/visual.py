"""Visual options: visualizer and rendering flags, groups, frames, labels and quality; and the abstract scene.

In a segmentation, each geom of the scene has the id of an object, a body or a tree of bodies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, user_camera
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, option
from mjrun.model.camera_images import SegmentedObject
from mjrun.model.fields import flex_owners, skin_owners
from mjrun.model.mujoco_globals import collected_warnings, warn_again
from mjrun.model.names import KINDS, enum_members, enum_value, names
from mjrun.options.rendering import QUALITIES, SceneOptions, decoration_options

NOTHING = -1
BODY_OF = {"geom": "geom_bodyid", "site": "site_bodyid", "joint": "jnt_bodyid", "camera": "cam_bodyid"}
BODY_OF |= {"light": "light_bodyid"}
DRAWN = ("geom", "site", "tendon", "flex", "skin", "joint", "actuator", "camera", "light", "body")
# Flags that only change colours, and those that add geoms, which Filament renders only in colour images.
COLOURING = {"texture", "transparent", "island", *enum_members(mujoco.mjtRndFlag)}
MARKS = {"joint", "camera", "actuator", "activation", "light", "rangefinder", "constraint", "inertia", "sclinertia"}
MARKS |= {"pertforce", "pertobj", "contactpoint", "contactforce", "contactsplit", "autoconnect", "com", "select"}
MARKS |= {"bodybvh", "meshbvh", "sdfiter"}


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


ALL = mujoco.mjtCatBit.mjCAT_ALL.value
GROUPS = {
    "geom": "geomgroup",
    "site": "sitegroup",
    "joint": "jointgroup",
    "tendon": "tendongroup",
    "actuator": "actuatorgroup",
    "flex": "flexgroup",
    "skin": "skingroup",
}


@dataclass(frozen=True)
class Visual:
    """Options of MuJoCo's visualizer, by MuJoCo's names; anything not set keeps MuJoCo's default.

    Args:
      show, hide: names of mjtVisFlag and mjtRndFlag: `contactpoint`, `transparent`, `shadow`, …
      groups: kinds (`geom`, `site`, …) to the groups to show, `0`–`5`; other groups are hidden.
      frame: a name of mjtFrame: `none`, `body`, `geom`, `site`, `camera`, `light`, `contact`, `world`.
      label: a name of mjtLabel: `none`, `body`, `joint`, `geom`, …
      quality: `draft` drops shadows, reflections and multisampling; `model` follows the model; `high` renders at
          twice the size and averages.
    """

    show: Sequence[str] = ()
    hide: Sequence[str] = ()
    groups: Mapping[str, Sequence[int]] = field(default_factory=dict)
    frame: str = "none"
    label: str = "none"
    quality: str = "model"

    def __post_init__(self) -> None:
        if self.quality not in QUALITIES:
            raise UnknownNameError("quality", self.quality, QUALITIES, plural="qualities")
        valid = flags()
        for name in (*self.show, *self.hide):
            if name not in valid:
                raise UnknownNameError("visual flag", name, sorted(valid))
        both = set(self.show) & set(self.hide)
        if both:
            raise BadValueError(f"{option('show')} and {option('hide')}", ", ".join(sorted(both)), "to be in both")
        for kind, drawn in self.groups.items():
            if kind not in GROUPS:
                raise UnknownNameError("kind of group", kind, list(GROUPS), plural="kinds")
            for number in drawn:
                if not 0 <= number < mujoco.mjNGROUP:
                    raise BadValueError(option(GROUPS[kind]), number, f"a group from 0 to {mujoco.mjNGROUP - 1}")
        enum_value(mujoco.mjtFrame, "frame", self.frame)
        enum_value(mujoco.mjtLabel, "label", self.label)

    @property
    def samples(self) -> int:
        """The factor by which the image is rendered wider and higher than shown."""
        return 2 if self.quality == "high" else 1

    def options(self) -> mujoco.MjvOption:
        """Returns the visualizer's options."""
        options = mujoco.MjvOption()
        visualizer = enum_members(mujoco.mjtVisFlag)
        for flags, value in ((self.show, 1), (self.hide, 0)):
            for name in flags:
                if name in visualizer:
                    options.flags[visualizer[name]] = value
        for kind, drawn in self.groups.items():
            getattr(options, GROUPS[kind])[:] = [number in drawn for number in range(mujoco.mjNGROUP)]
        options.frame = enum_value(mujoco.mjtFrame, "frame", self.frame)
        options.label = enum_value(mujoco.mjtLabel, "label", self.label)
        return options

    def set_flags(self, scene: mujoco.MjvScene) -> None:
        """Sets the rendering flags of `scene`."""
        rendering = enum_members(mujoco.mjtRndFlag)
        if self.quality == "draft":
            scene.flags[rendering["shadow"]] = 0
            scene.flags[rendering["reflection"]] = 0
        for flags, value in ((self.show, 1), (self.hide, 0)):
            for name in flags:
                if name in rendering:
                    scene.flags[rendering[name]] = value


def visual_of(options: SceneOptions) -> Visual:
    """Returns the flags, groups, frames, labels and quality in `options`.

    Raises:
      UsageError: MuJoCo has no such name, or a flag is both shown and hidden.
    """
    groups = {
        "geom": options.geomgroup,
        "site": options.sitegroup,
        "joint": options.jointgroup,
        "tendon": options.tendongroup,
        "actuator": options.actuatorgroup,
        "flex": options.flexgroup,
        "skin": options.skingroup,
    }
    return Visual(
        show=options.show,
        hide=options.hide,
        groups={kind: drawn for kind, drawn in groups.items() if drawn is not None},
        frame=options.frame_axes,
        label=options.label,
        quality=options.quality,
    )


def colour_options(options: SceneOptions) -> list[str]:
    """Returns the options in `options` that images of depth and segmentations do not show."""
    flags = COLOURING | (MARKS if options.renderer == "filament" else set())
    used = {
        **dict.fromkeys(decoration_options(options), True),
        "label": options.label != "none",
        "frame_axes": options.frame_axes != "none" and options.renderer == "filament",
    }
    names = [option(name) for name, is_used in used.items() if is_used]
    return [*names, *(f"{option('show')} {name}" for name in options.show if name in flags)]


def flags() -> list[str]:
    """Returns every name that the options show and hide accept."""
    return [*enum_members(mujoco.mjtVisFlag), *enum_members(mujoco.mjtRndFlag)]


def frame_axes() -> list[str]:
    """Returns every kind of object whose axes the option frame_axes can show."""
    return [*enum_members(mujoco.mjtFrame)]


def labels() -> list[str]:
    """Returns every kind of object whose names the option label can show."""
    return [*enum_members(mujoco.mjtLabel)]


def downsampled(pixels: np.ndarray, factor: int) -> np.ndarray:
    """Averages blocks of `factor` x `factor` pixels of an image `(h, w, 3)` uint8."""
    if factor == 1:
        return pixels
    height, width, channels = pixels.shape
    blocks = pixels.reshape(height // factor, factor, width // factor, factor, channels)
    count = factor * factor
    return ((blocks.sum(axis=(1, 3), dtype=np.uint16) + count // 2) // count).astype(np.uint8)


def updated_scene(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    options: mujoco.MjvOption,
    pose: CameraPose,
    scene: mujoco.MjvScene,
    room: int = 0,
) -> mujoco.MjvScene:
    """Updates `scene` with all that is visible from `pose`, and returns it, or a larger one if it was full.

    Args:
      room: geoms that must still fit afterwards.
    """
    while True:
        pose.place(scene)
        with collected_warnings() as texts:
            mujoco.mjv_updateScene(model, data, options, None, user_camera(), ALL, scene)
        if scene.ngeom + room < scene.maxgeom:
            break
        larger = mujoco.MjvScene(model, max(2 * scene.maxgeom, scene.ngeom + room + 1))
        larger.flags[:] = scene.flags
        scene = larger
    warn_again(texts)  # except of an earlier, smaller scene
    return scene
