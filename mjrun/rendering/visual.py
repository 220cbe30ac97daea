"""Visual options: visualizer and rendering flags, groups, frames, labels and quality; and the abstract scene."""

from collections.abc import Mapping, Sequence
from dataclasses import field

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, user_camera
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, UnknownNameError, option
from mjrun.model.mujoco_globals import collected_warnings, warn_again
from mjrun.model.names import enum_members, enum_value
from mjrun.options.rendering import QUALITIES, SceneOptions

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
        for names, value in ((self.show, 1), (self.hide, 0)):
            for name in names:
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
        for names, value in ((self.show, 1), (self.hide, 0)):
            for name in names:
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
