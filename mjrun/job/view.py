"""What is seen and who draws it: what films and stills have in common."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mjrun.camera.argument import parse_camera
from mjrun.camera.motion import CameraMotion
from mjrun.camera.pose import Pose
from mjrun.camera.script import CameraScript
from mjrun.errors import BadValueError, UnknownNameError, UsageError, clean, listing
from mjrun.formats.labels import labels_beside
from mjrun.job.output_files import named
from mjrun.job.scene_decorations import SceneDecorations, additions
from mjrun.job.simulation import lone
from mjrun.rendering.backend import Backend
from mjrun.rendering.backend_detection import BackendDetection, VulkanDetection
from mjrun.rendering.classic import ClassicRenderer, check_size
from mjrun.rendering.compositor import VIEWS, Overlay, Panel, SceneCompositor, Stream, Style
from mjrun.rendering.decorations import Decoration
from mjrun.rendering.filament import FilamentRenderer, check_segmentation, check_visual, omissions
from mjrun.rendering.segmentation import Segmentation, grouping
from mjrun.rendering.visual import Visual

SIZE = (1280, 720)
LAYOUTS = ("row", "column", "grid")
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

    def search(self) -> BackendDetection | VulkanDetection:
        """Begins to try what can draw."""
        return VulkanDetection() if self.renderer == "filament" else BackendDetection(self.gl)

    def check(self, model: mujoco.MjModel, backend: Backend) -> list[str]:
        """What the renderer will leave out of this unasked.

        Raises:
          UsageError: it cannot draw this, or not that large.
        """
        check_size(self.size, backend, self.visual)
        if self.renderer != "filament":
            return []
        check_visual(model, self.visual)
        check_segmentation(Segmentation(model, self.seg_by) if "seg" in self.views else None)
        return omissions(model, self.visual)

    @property
    def cameras(self) -> Sequence[str | CameraScript]:
        """The cameras asked for."""
        return (self.camera,) if isinstance(self.camera, (str, CameraScript)) else tuple(self.camera)

    @property
    def names(self) -> list[str]:
        """What the cameras are called."""
        return [
            camera.name if isinstance(camera, CameraScript) else camera.partition(",")[0] for camera in self.cameras
        ]

    @property
    def views(self) -> Sequence[str]:
        """The views asked for."""
        return (self.view,) if isinstance(self.view, str) else tuple(self.view)

    @property
    def corner(self) -> str:
        """Where the text stands."""
        return self.text_corner or ("bottom-right" if self.captions else "top-left")

    @property
    def panels(self) -> list[Panel]:
        """Every view through every camera."""
        return [Panel(index, view) for index in range(len(self.cameras)) for view in self.views]

    def outputs(self, output: str) -> list[tuple[str, list[Panel]]]:
        """The files to make, each with what is in it."""
        if not self.separate or len(self.panels) == 1:
            return [(output, self.panels)]
        if output == "-":
            raise UsageError("--separate makes several files; standard output is one")
        return [(_numbered(output, name), [panel]) for panel, name in zip(self.panels, self._names(), strict=True)]

    def written(self, output: str) -> list[tuple[str, str]]:
        """The files of `output`: one for each view if they are separate, what explains ids, and what stands beside."""
        files = [path for path, _ in self.outputs(output)]
        labels = [labels_beside(path) for path, panels in self.outputs(output) if [p.view for p in panels] == ["seg"]]
        made = [("output", path) for path in [*files, *labels] if output != "-"]
        return [*made, *named(self, "calibration", "manifest")]

    def streams(self, with_legend: bool, overlay: Overlay) -> list[Stream]:
        """The frames of each output.

        Raises:
          UsageError: numbers are to be composed.
        """
        found = []
        for _, panels in self.outputs("drawing"):
            exact = self.style == "exact" and any(panel.view != "rgb" for panel in panels)
            if exact and len(panels) > 1:
                raise UsageError("--style exact: numbers cannot share a picture; add --separate for a file each")
            style = Style(self.layout, self.captions, with_legend, Overlay() if exact else overlay)
            found.append(Stream(panels, self.size, style, exact))
        return found

    def scripts(self, model: mujoco.MjModel) -> list[CameraScript]:
        """What each camera does."""
        return [camera if isinstance(camera, CameraScript) else parse_camera(camera, model) for camera in self.cameras]

    def courses(self, model: mujoco.MjModel) -> list[CameraMotion]:
        """The cameras, found in `model`."""
        return [CameraMotion(script, model, self.size) for script in self.scripts(model)]

    def additions(self, model: mujoco.MjModel) -> SceneDecorations:
        """Trails and ghosts."""
        return additions(model, self.visual, self.trail, self.trail_span, self.ghost)

    def _names(self) -> list[str]:
        """A part of a file's name for each panel, no two alike."""
        words = ["".join(c if c.isalnum() else "_" for c in text.partition(":")[0]) for text in self.names]
        cameras = [word if words.count(word) == 1 else f"{word}{index}" for index, word in enumerate(words)]
        parts = []
        for panel in self.panels:
            camera = [cameras[panel.camera]] if len(self.cameras) > 1 else []
            parts.append("-".join([*camera, *([panel.view] if len(self.views) > 1 else [])]))
        return parts


def painter(
    job: Drawing,
    model: mujoco.MjModel,
    backend: Backend,
    streams: Sequence[Stream],
    poses: Sequence[Sequence[Pose]],
    decors: Sequence[Decoration] = (),
) -> SceneCompositor:
    """What draws the streams of `job`; `poses` are those of each frame, of each camera."""
    segmentation = Segmentation(model, job.seg_by)
    return SceneCompositor(
        model=model,
        backend=backend,
        size=job.size,
        visual=job.visual,
        names=job.names,
        poses=poses,
        streams=streams,
        segmentation=segmentation,
        decors=decors,
        ranges=[job.depth_range] * len(job.cameras) if job.depth_range else [],
        renderer=RENDERERS[job.renderer],
    )


def unused(job: Drawing, **more: object) -> list[str]:
    """The warning that what stands in pictures was asked for, where there are only numbers; `more` are options too."""
    asked = {"text": job.text, "captions": job.captions, "depth-range": job.depth_range, **more}
    names = [f"--{name}" for name, value in asked.items() if value]
    return [f"{listing(names)}: numbers have no room for it; --style color draws pictures"] if names else []


def tags(path: str | None, facts: Mapping[str, Any]) -> dict[str, str]:
    """What is embedded in a film or picture: its title, who made it, and all that is known of it as JSON."""
    made_by = ", ".join(
        [f"mjrun {facts['mjrun']}", f"MuJoCo {facts['mujoco']}", *([facts["renderer"]] if "renderer" in facts else [])]
    )
    title = {} if path is None else {"title": Path(path).stem}
    return {**title, "comment": clean(made_by), "description": json.dumps(facts)}


def _numbered(output: str, name: str) -> str:
    """`film.mp4` for one of several: `film-NAME.mp4`."""
    folder = output.rstrip("/")
    if folder != output or not Path(output).suffix:
        return f"{folder}-{name}/"
    path = Path(output)
    return str(path.with_name(f"{path.stem}-{name}{path.suffix}"))
