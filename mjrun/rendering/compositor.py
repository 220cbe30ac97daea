"""Composition of frames: views through cameras, side by side, with captions, text and plots."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import prod

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose
from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError
from mjrun.formats.image_encoding import depth_millimetres, segment_numbers
from mjrun.model.camera_images import CameraImages
from mjrun.model.state import widened
from mjrun.options.rendering import LAYOUTS
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.colormaps import colors_of, colour_bar, depth_colors, depth_range, in_view, legend, seg_colors
from mjrun.rendering.filament import FilamentRenderer
from mjrun.rendering.live_plot import LivePlot
from mjrun.rendering.text import BACKGROUND, stamp
from mjrun.rendering.visual import SegmentationIds, Visual

VIEW_NAMES = {"rgb": "colour", "depth": "depth", "seg": "segmentation"}
RENDERERS = {"classic": ClassicRenderer, "filament": FilamentRenderer}
ASPECT = 16 / 9  # target ratio of width to height of a grid, unless many cells would be empty


@dataclass(frozen=True)
class CameraPanel:
    """A panel of a frame: one view through the camera with this index."""

    camera: int
    view: str


@dataclass(frozen=True)
class TextAndLivePlots:
    """Text over a frame, and plots under or beside it.

    Attributes:
      texts: the text of each frame; empty for no text.
      corner: the corner of the frame that holds the text.
      plots: width and height of each plot [pixels].
      side: position of the plots: `under` the frame or `beside` it.
      live_plots: the plots, once their values are known.
      times: the time of each frame [s], for the plots.
    """

    texts: Sequence[str] = ()
    corner: str = "top-left"
    plots: Sequence[tuple[int, int]] = ()
    side: str = "under"
    live_plots: Sequence[LivePlot] = ()
    times: Sequence[float] = ()

    @property
    def room(self) -> tuple[int, int]:
        """The width and the height that the plots add to a frame [pixels]."""
        if self.side == "under":
            return 0, sum(height for _, height in self.plots)
        return sum(width for width, _ in self.plots), 0


@dataclass(frozen=True)
class FrameComposition:
    """The composition of panels into a frame.

    Attributes:
      layout: `row`, `column` or `grid`.
      captions: whether each panel has a caption.
      legend: whether a segmentation lists the segments in view; not all pixels are colours of segments then.
      overlay: text and plots; only for colour frames.
    """

    layout: str = "row"
    captions: bool = False
    legend: bool = False
    overlay: TextAndLivePlots = TextAndLivePlots()


@dataclass(frozen=True)
class FrameSpec:
    """The form of all frames of one video: panels in colour, or the numbers of a single panel.

    Attributes:
      size: width and height of a panel [pixels].
      exact: whether frames are numbers `(h, w)` uint16: millimetres or ids + 1; 0 is the background.
    """

    panels: Sequence[CameraPanel]
    size: tuple[int, int]
    composition: FrameComposition
    exact: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of a frame."""
        width, height = layout_size(len(self.panels), self.size, self.composition.layout)
        across, down = self.composition.overlay.room
        return (height, width) if self.exact else (height + down, width + across, 3)

    @property
    def size_of_frame(self) -> tuple[int, int]:
        """The width and the height of a frame [pixels]."""
        return self.shape[1], self.shape[0]

    @property
    def dtype(self) -> np.dtype:
        """The dtype of a frame."""
        return np.dtype(np.uint16 if self.exact else np.uint8)


@dataclass(frozen=True)
class FrameCosts:
    """The wall time to render a frame [s], and its last scene as a draft; None if it cannot be rendered as one."""

    frame: float
    draft: float | None


@dataclass
class SceneCompositor:
    """A compositor that renders the frames of all videos for one state, one after the other, into flat bytes.

    It can be pickled while closed.

    Args:
      size: width and height of a panel [pixels].
      names: names of the cameras, for captions.
      poses: the pose of each camera, for each frame.
      segmentation: the grouping of ids; None if no view is a segmentation.
      decorations: additions to colour images.
      ranges: the depths [m] of the first and the last colour for each camera; required for depth in colour.
      renderer: the name of the renderer.
    """

    model: mujoco.MjModel
    backend: WorkingBackend
    size: tuple[int, int]
    visual: Visual
    names: Sequence[str]
    specs: Sequence[FrameSpec]
    poses: Sequence[Sequence[CameraPose]]
    segmentation: SegmentationIds | None
    decorations: Sequence[Decoration] = ()
    ranges: Sequence[tuple[float, float]] = ()
    renderer: str = "classic"

    def __post_init__(self) -> None:
        self._open_renderer: ClassicRenderer | FilamentRenderer | None = None
        self._frame_cost = 0.0  # [s]

    @cached_property
    def colors(self) -> np.ndarray:
        """The colour of each segment, `(n, 3)` uint8."""
        assert self.segmentation
        return colors_of(self.segmentation.legend)

    @property
    def bytes(self) -> int:
        """The size of the frames of all videos for one state [bytes]."""
        return sum(prod(spec.shape) * spec.dtype.itemsize for spec in self.specs)

    def open(self) -> None:
        """Creates a renderer unless one is open, which it makes current in this thread.

        `CompositorPool` calls this in the process that renders.
        """
        if self._open_renderer is None:
            self._open_renderer = RENDERERS[self.renderer](
                self.model, self.size, self.backend, self.visual, self.segmentation, self.decorations
            )
        elif isinstance(self._open_renderer, ClassicRenderer):
            self._open_renderer.make_current()

    def use(self, renderer: ClassicRenderer | FilamentRenderer) -> None:
        """Renders with an open renderer, which is closed with the compositor."""
        self._open_renderer = renderer

    def continue_from(self, other: "SceneCompositor") -> None:
        """Takes over the renderer of another compositor, or closes it if it cannot render this model."""
        renderer, other._open_renderer = other._open_renderer, None
        if isinstance(renderer, ClassicRenderer) and renderer.can_show(self.model):
            renderer.show(self.model, self.segmentation)
            self.use(renderer)
        elif renderer:
            renderer.close()

    def choose_ranges(self, states: Mapping[int, np.ndarray]) -> None:
        """Sets the `ranges` that suit these states, given by frame index."""
        by_frame = [self.render(state, index, ["depth"]) for index, state in states.items()]
        self.ranges = [depth_range([seen.depth for seen in frames]) for frames in zip(*by_frame, strict=True)]

    def compose(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        """Fills `into`, `bytes` long, with the frames of all specs, laid out as in `parts`."""
        start = time.perf_counter()
        views = self.render(state, index)
        for spec, part in zip(self.specs, self.parts(into), strict=True):
            part[:] = self.frame(spec, views, index)
        self._frame_cost = time.perf_counter() - start

    def costs(self) -> FrameCosts:
        """Returns the costs of the last frame."""
        assert self._open_renderer
        draft = None if self.visual.quality == "draft" else self._open_renderer.draft_cost()
        return FrameCosts(self._frame_cost, draft)

    def close(self) -> None:
        """Closes the renderer, if open."""
        if self._open_renderer:
            self._open_renderer.close()
            self._open_renderer = None

    def parts(self, frames: np.ndarray) -> list[np.ndarray]:
        """Returns a view of each frame in the flat bytes that `compose` fills."""
        parts, start = [], 0
        for spec in self.specs:
            end = start + prod(spec.shape) * spec.dtype.itemsize
            parts.append(frames[start:end].view(spec.dtype).reshape(spec.shape))
            start = end
        return parts

    def render(self, state: np.ndarray, index: int, views: Sequence[str] | None = None) -> list[CameraImages]:
        """Renders the view of each camera in a state: the views that its panels show, or `views`."""
        assert self._open_renderer
        self._open_renderer.set_state(widened(self.model, state), index)
        by_camera = []
        for camera, pose in enumerate(self.poses[index]):
            shown = [panel.view for spec in self.specs for panel in spec.panels if panel.camera == camera]
            seen = self._open_renderer.render(pose, shown if views is None else views)
            # Colours must survive the next call, and are drawn on.
            by_camera.append(seen if seen.rgb is None else replace(seen, rgb=np.array(seen.rgb)))
        return by_camera

    def frame(self, spec: FrameSpec, views: Sequence[CameraImages], index: int) -> np.ndarray:
        """Composes the frame that `spec` describes from the view of each camera."""
        if spec.exact:
            (panel,) = spec.panels
            return _numbers(panel, views[panel.camera])

        composition, overlay = spec.composition, spec.composition.overlay
        panels = [self._colored(panel, views[panel.camera], composition.legend) for panel in spec.panels]
        captions = [self.caption(panel) for panel in spec.panels] if composition.captions else None
        frame = compose_panels(panels, composition.layout, captions) if len(panels) > 1 or captions else panels[0]

        for decoration in self.decorations:
            decoration.draw(frame, index)
        if overlay.texts:
            stamp(frame, overlay.texts[index], overlay.corner)
        if overlay.live_plots:
            plots = [live_plot.draw(overlay.times[index]) for live_plot in overlay.live_plots]
            frame = np.concatenate([frame, *plots], axis=0 if overlay.side == "under" else 1)
        return frame

    def caption(self, panel: CameraPanel) -> str:
        """Returns the caption of a panel: its camera, and its view if the frames show several views."""
        several = len({other.view for spec in self.specs for other in spec.panels}) > 1
        return f"{self.names[panel.camera]} · {VIEW_NAMES[panel.view]}" if several else self.names[panel.camera]

    def _colored(self, panel: CameraPanel, seen: CameraImages, with_legend: bool) -> np.ndarray:
        if panel.view == "rgb":
            assert seen.rgb is not None
            return seen.rgb

        if panel.view == "depth":
            assert seen.depth is not None
            near, far = self.ranges[panel.camera]
            image = depth_colors(seen.depth, near, far)
            colour_bar(image, near, far)
            return image

        assert seen.ids is not None
        image = seg_colors(seen.ids, self.colors)
        if with_legend:
            ids = in_view(seen.ids)
            legend(image, [seen.legend[i] for i in ids], self.colors[ids])
        return image


def _numbers(panel: CameraPanel, seen: CameraImages) -> np.ndarray:
    if panel.view == "depth":
        assert seen.depth is not None
        return depth_millimetres(seen.depth)
    assert seen.ids is not None
    return segment_numbers(seen.ids, len(seen.legend))


def gap(height: int) -> int:
    """Returns the gap between images of a height [pixels]: 2 at 240, 8 at 1080; even, so that even sizes stay even."""
    return 2 * max(1, round(height / 240))


def columns(count: int, size: tuple[int, int], layout: str = "row") -> int:
    """Returns the number of images of a size (width, height) in a row.

    Raises:
      UnknownNameError: the layout is not one of `LAYOUTS`.
    """
    if layout not in LAYOUTS:
        raise UnknownNameError("layout", layout, LAYOUTS)
    if layout != "grid":
        return count if layout == "row" else 1
    # Deviation from the target shape, and share of empty cells, as logarithms. Ties: the fullest, then the widest.
    costs: dict[int, tuple[float, int, int]] = {}
    for across in range(1, count + 1):
        width, height = _extent(count, size, across)
        taken = -(-count // across) * across
        costs[across] = round(abs(math.log(width / height / ASPECT)) + 1.5 * math.log(taken / count), 2), taken, -across
    return min(costs, key=lambda across: costs[across])


def layout_size(count: int, size: tuple[int, int], layout: str = "row") -> tuple[int, int]:
    """Returns the width and height of `count` composed images of a size (width, height)."""
    return _extent(count, size, columns(count, size, layout))


def places(count: int, size: tuple[int, int], layout: str = "row") -> list[tuple[int, int]]:
    """Returns the upper left corners x, y of the images, row by row."""
    across, between = columns(count, size, layout), gap(size[1])
    return [((i % across) * (size[0] + between), (i // across) * (size[1] + between)) for i in range(count)]


def compose_panels(
    images: Sequence[np.ndarray], layout: str = "row", labels: Sequence[str] | None = None
) -> np.ndarray:
    """Composes images `(h, w, 3)` of one size into one image `(H, W, 3)` uint8 of size `layout_size`.

    Args:
      labels: text for the upper left corner of each image; empty for none.

    Raises:
      ValueError: images differ in size, or in number from labels.
      UnknownNameError: the layout is not one of `LAYOUTS`.
    """
    height, width = images[0].shape[:2]
    size, count = (width, height), len(images)
    total = layout_size(count, size, layout)
    whole = np.empty((total[1], total[0], 3), np.uint8)
    if math.prod(total) > count * width * height:
        whole[:] = BACKGROUND
    for image, label, (x, y) in zip(images, labels or [""] * count, places(count, size, layout), strict=True):
        if image.shape != images[0].shape:
            raise ValueError(f"images must have the same size, not {images[0].shape} and {image.shape}")
        panel = whole[y : y + height, x : x + width]
        panel[:] = image
        if label:
            stamp(panel, label)
    return whole


def _extent(count: int, size: tuple[int, int], across: int) -> tuple[int, int]:
    down, between = -(-count // across), gap(size[1])
    return across * size[0] + (across - 1) * between, down * size[1] + (down - 1) * between
