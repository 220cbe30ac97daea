"""What is seen, from the options of views: flags and groups of MuJoCo's, and what draws them."""

from collections.abc import Sequence

from mjrun.errors import BadValueError, UnknownNameError, UsageError, concerning, option
from mjrun.options.view import ViewOptions
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.filament import FilamentRenderer
from mjrun.rendering.segmentation import groupings
from mjrun.rendering.visual import Visual

RENDERERS = {"classic": ClassicRenderer, "filament": FilamentRenderer}


def visual_of(options: ViewOptions) -> Visual:
    """The flags, groups, frames, labels and quality that `options` ask for.

    Raises:
      UsageError: a name that MuJoCo does not know, or a flag that is both shown and hidden.
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


def check_view(options: ViewOptions) -> None:
    """Checks all that can be checked without the model.

    Raises:
      UsageError: a name that MuJoCo does not know, a view twice, or a range of depths that cannot be.
    """
    visual_of(options)
    with concerning("seg_by"):
        check_segmentation_name(options.seg_by)
    if options.depth_range is not None and options.depth_range[0] < 0:
        near, far = options.depth_range
        raise BadValueError(option("depth_range"), f"{near:g}..{far:g}", "two depths in metres, the nearer first")
    _check_once("camera", options.camera)
    _check_once("view", options.view)


def check_segmentation_name(name: str) -> None:
    """Raises UnknownNameError if `name` is nothing that a segmentation can tell apart."""
    if name not in groupings():
        raise UnknownNameError("segmentation", name, list(groupings()))


def _check_once(name: str, values: Sequence[object]) -> None:
    if not values or any(value in values[:index] for index, value in enumerate(values)):
        raise UsageError(f"{option(name)}: each once, and at least one")
