"""Options that videos and images have in common: what is seen, and what draws it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mjrun.camera.script import CameraScript
from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.job.simulation import lone
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.compositor import VIEWS
from mjrun.rendering.filament import FilamentRenderer
from mjrun.rendering.layout import LAYOUTS
from mjrun.rendering.segmentation import grouping
from mjrun.rendering.visual import Visual

SIZE = (1280, 720)
STYLES = ("color", "exact")
RENDERERS = {"classic": ClassicRenderer, "filament": FilamentRenderer}


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """What is seen, and who draws it.

    Args:
      camera: `free`, a camera of the model, `orbit:…`, `track:…` or a script of shots; or several.
      view: `rgb`, `depth` or `seg`; or several.
      size: width and height of one view [pixels].
      visual: flags, groups, frames, labels and quality of what is drawn.
      layout: how several views stand in one picture: `row`, `column` or `grid`.
      separate: a file for each view instead, called `NAME-CAMERA-VIEW`.
      captions: whether views are labelled.
      style: `color`, for the eye, or `exact`, numbers, of depth and segmentation; what the file can hold when None.
      depth_range: the depths [m] of the first and the last colour; what is seen decides when None.
      seg_by: what a segmentation tells apart: `object`, `geom`, `site`, …, `body` or `root-body`.
      trail: objects whose path is drawn, wider and warmer where they are faster: bodies, geoms or sites.
      trail_span: how much of the past the path shows [s]; all when None.
      ghost: the model once more, translucent: `offset=0/1/0`, `key=NAME`, `trace=FILE`, `recording=FILE`, `opacity=.3`.
      text: a template that is written over the picture: `{time:.2f} s`.
      text_corner: where: `top-left`, `bottom`, …; where captions are not, when None.
      calibration: a file for what each picture is seen through.
      calibration_format: `mjrun`, `nerfstudio`, `bop` or `ros`.
      renderer: `classic`, MuJoCo's own OpenGL, or `filament`, physically based, by Vulkan.
      gl: OpenGL backend; `auto` tries all.
      require_gpu: refuse to draw in software.
      manifest: a file for what made the output.
      command: the command line, for the manifest.
    """

    camera: str | CameraScript | Sequence[str | CameraScript] = "free"
    view: str | Sequence[str] = "rgb"
    size: tuple[int, int] = SIZE
    visual: Visual = field(default_factory=Visual)
    layout: str = "row"
    separate: bool = False
    captions: bool = False
    style: str | None = None
    depth_range: tuple[float, float] | None = None
    seg_by: str = "object"
    trail: Sequence[str] = ()
    trail_span: float | None = None
    ghost: Sequence[str] = ()
    text: str | None = None
    text_corner: str | None = None
    calibration: str | None = None
    calibration_format: str = "mjrun"
    renderer: str = "classic"
    gl: str | None = None
    require_gpu: bool = False
    manifest: str | None = None
    command: str = ""

    def __post_init__(self) -> None:
        lone(self, "trail", "ghost")
        size = tuple(self.size) if not isinstance(self.size, str) else ()
        if len(size) != 2 or any(not isinstance(side, (int, np.integer)) or side < 1 for side in size):
            raise BadValueError("size", self.size, "a width and a height in pixels, as in (640, 480)")
        for what, given, valid in (
            ("view", self.views, VIEWS),
            ("layout", (self.layout,), LAYOUTS),
            ("style", (self.style or STYLES[0],), STYLES),
            ("segmentation", (self.seg_by,), grouping()),
            ("renderer", (self.renderer,), RENDERERS),
        ):
            for name in given:
                if name not in valid:
                    raise UnknownNameError(what, name, list(valid))
        if self.depth_range is not None and not 0 <= self.depth_range[0] < self.depth_range[1] < np.inf:
            near, far = self.depth_range
            raise BadValueError("--depth-range", f"{near:g}..{far:g}", "two depths in metres, the nearer first")
        for what, names in (("--camera", self.cameras), ("--view", self.views)):
            if not names or any(name in names[:index] for index, name in enumerate(names)):
                raise UsageError(f"{what}: each once, and at least one")

    @property
    def cameras(self) -> Sequence[str | CameraScript]:
        """The cameras, at least one."""
        return (self.camera,) if isinstance(self.camera, (str, CameraScript)) else tuple(self.camera)

    @property
    def views(self) -> Sequence[str]:
        """The views, at least one."""
        return (self.view,) if isinstance(self.view, str) else tuple(self.view)
