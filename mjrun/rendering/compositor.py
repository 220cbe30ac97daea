"""Frames from states: several views through several cameras, coloured, composed, captioned."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Protocol

import mujoco
import numpy as np

from mjrun.camera.pose import Pose
from mjrun.model.rendered_view import RenderedView
from mjrun.model.uint16_pixels import depth_millimetres, segment_numbers
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.colormaps import colors_of, colour_bar, depth_colors, depth_range, in_view, legend, seg_colors
from mjrun.rendering.decorations import Decoration
from mjrun.rendering.graph import Graph
from mjrun.rendering.layout import compose, layout_size
from mjrun.rendering.segmentation import Segmentation
from mjrun.rendering.text import stamp
from mjrun.rendering.visual import Visual

NAMES = {"rgb": "colour", "depth": "depth", "seg": "segmentation"}


class Renderer(Protocol):
    """Draws states of one model."""

    def look(self, state: np.ndarray, index: int = 0) -> None:
        """Goes to the instant of an integration `state`, that of a frame by its index."""
        ...

    def picture(self, pose: Pose, views: Sequence[str]) -> RenderedView:
        """What is seen of that instant from `pose`."""
        ...

    def draft_cost(self) -> float | None:
        """Seconds to draw the last scene as a draft; None where that is no use."""
        ...

    def close(self) -> None:
        """Frees what the graphics driver holds."""
        ...


@dataclass(frozen=True)
class Panel:
    """One view through one of the cameras, by its index."""

    camera: int
    view: str


@dataclass(frozen=True)
class Overlay:
    """What is written over a frame, and plotted beside it.

    Attributes:
      texts: of each frame; none when empty.
      corner: where they stand.
      plots: width and height of each plot [pixels].
      side: where plots stand, `under` the frame or `beside` it.
      graphs: the plots, once their values are known.
      times: of each frame [s], for the plots.
    """

    texts: Sequence[str] = ()
    corner: str = "top-left"
    plots: Sequence[tuple[int, int]] = ()
    side: str = "under"
    graphs: Sequence[Graph] = ()
    times: Sequence[float] = ()

    @property
    def room(self) -> tuple[int, int]:
        """What all plots add to the width and the height of a frame [pixels]."""
        if self.side == "under":
            return 0, sum(height for _, height in self.plots)
        return sum(width for width, _ in self.plots), 0


@dataclass(frozen=True)
class FrameStyle:
    """How panels become one frame.

    Attributes:
      layout: `row`, `column` or `grid`.
      captions: whether each panel says what it shows.
      legend: whether a segmentation lists what is in view; its colours are then no longer only its own.
      overlay: text and plot; on frames that are not numbers.
    """

    layout: str = "row"
    captions: bool = False
    legend: bool = False
    overlay: Overlay = Overlay()


@dataclass(frozen=True)
class FrameStream:
    """Frames of one film: one panel or several, as colours, or one panel's numbers.

    Attributes:
      size: of a panel [pixels].
      exact: whether frames are numbers `(h, w)` uint16: millimetres, or ids + 1; 0 is nothing.
    """

    panels: Sequence[Panel]
    size: tuple[int, int]
    style: FrameStyle
    exact: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a frame."""
        width, height = layout_size(len(self.panels), self.size, self.style.layout)
        across, down = self.style.overlay.room
        return (height, width) if self.exact else (height + down, width + across, 3)

    @property
    def size_of_frame(self) -> tuple[int, int]:
        """Width and height of a frame [pixels]."""
        return self.shape[1], self.shape[0]

    @property
    def dtype(self) -> np.dtype:
        """Of a frame."""
        return np.dtype(np.uint16 if self.exact else np.uint8)


@dataclass(frozen=True)
class DrawingCosts:
    """Wall time [s] of a frame, and of its last scene as a draft; None where that is no use."""

    frame: float
    draft: float | None


@dataclass
class SceneCompositor:
    """Paints the frames of all streams from one state, one after the other into flat bytes.

    Args:
      names: what the cameras are called in captions.
      poses: of each frame, of each camera.
      decorations: what is added to colour pictures.
      ranges: of each camera, the depths [m] of the first and the last colour; needed for coloured depth.
    """

    model: mujoco.MjModel
    backend: Backend
    size: tuple[int, int]
    visual: Visual
    names: Sequence[str]
    streams: Sequence[FrameStream]
    poses: Sequence[Sequence[Pose]]
    segmentation: Segmentation
    decorations: Sequence[Decoration] = ()
    ranges: Sequence[tuple[float, float]] = ()
    renderer: Callable[..., Renderer] = ClassicRenderer

    def __post_init__(self) -> None:
        self._drawing: Renderer | None = None
        self._spent = 0.0

    @cached_property
    def colors(self) -> np.ndarray:
        """Of what a segmentation tells apart."""
        return colors_of(self.segmentation.legend)

    @property
    def bytes(self) -> int:
        """Of the frames of all streams."""
        return sum(prod(stream.shape) * stream.dtype.itemsize for stream in self.streams)

    def open(self) -> None:
        """Gets a renderer, unless there is one already."""
        if self._drawing is None:
            self._drawing = self.renderer(
                self.model, self.size, self.backend, self.visual, self.segmentation, self.decorations
            )

    def look_ahead(self, states: Mapping[int, np.ndarray]) -> None:
        """Chooses the `ranges` that suit the frames with these indices."""
        seen = [self.see(state, index, ["depth"]) for index, state in states.items()]
        self.ranges = [depth_range([picture.depth for picture in pictures]) for pictures in zip(*seen, strict=True)]

    def paint(self, state: np.ndarray, index: int, into: np.ndarray) -> None:
        start = time.perf_counter()
        pictures = self.see(state, index)
        for stream, part in zip(self.streams, self.parts(into), strict=True):
            part[:] = self.frame(stream, pictures, index)
        self._spent = time.perf_counter() - start

    def costs(self) -> DrawingCosts:
        """Of the last frame, and of the same as a draft."""
        assert self._drawing
        return DrawingCosts(self._spent, None if self.visual.quality == "draft" else self._drawing.draft_cost())

    def close(self) -> None:
        if self._drawing:
            self._drawing.close()
            self._drawing = None

    def parts(self, frames: np.ndarray) -> list[np.ndarray]:
        """The frame of each stream in the flat bytes that `paint` fills."""
        found, start = [], 0
        for stream in self.streams:
            end = start + prod(stream.shape) * stream.dtype.itemsize
            found.append(frames[start:end].view(stream.dtype).reshape(stream.shape))
            start = end
        return found

    def see(self, state: np.ndarray, index: int, views: Sequence[str] | None = None) -> list[RenderedView]:
        """What each camera sees of a state: the views that streams want of it, or `views`."""
        assert self._drawing
        self._drawing.look(state, index)
        found = []
        for camera, pose in enumerate(self.poses[index]):
            wanted = [panel.view for stream in self.streams for panel in stream.panels if panel.camera == camera]
            picture = self._drawing.picture(pose, wanted if views is None else views)
            found.append(picture if picture.rgb is None else _kept(picture))
        return found

    def frame(self, stream: FrameStream, pictures: Sequence[RenderedView], index: int) -> np.ndarray:
        """The frame of `stream`, made of what each camera sees."""
        if stream.exact:
            (panel,) = stream.panels
            return _numbers(panel, pictures[panel.camera])
        style, overlay = stream.style, stream.style.overlay
        shown = [self._colored(panel, pictures[panel.camera], style.legend) for panel in stream.panels]
        captions = [self.caption(panel) for panel in stream.panels] if style.captions else None
        frame = compose(shown, style.layout, captions) if len(shown) > 1 or captions else shown[0]
        if overlay.texts:
            stamp(frame, overlay.texts[index], overlay.corner)
        if overlay.graphs:
            plots = [graph.draw(overlay.times[index]) for graph in overlay.graphs]
            frame = np.concatenate([frame, *plots], axis=0 if overlay.side == "under" else 1)
        return frame

    def caption(self, panel: Panel) -> str:
        """What a panel shows, in words."""
        many = len({other.view for stream in self.streams for other in stream.panels}) > 1
        return f"{self.names[panel.camera]} · {NAMES[panel.view]}" if many else self.names[panel.camera]

    def _colored(self, panel: Panel, picture: RenderedView, with_legend: bool) -> np.ndarray:
        if panel.view == "rgb":
            assert picture.rgb is not None
            return picture.rgb
        if panel.view == "depth":
            assert picture.depth is not None
            near, far = self.ranges[panel.camera]
            image = depth_colors(picture.depth, near, far)
            colour_bar(image, near, far)
            return image
        assert picture.ids is not None
        image = seg_colors(picture.ids, self.colors)
        if with_legend:
            ids = in_view(picture.ids)
            legend(image, [picture.legend[i] for i in ids], self.colors[ids])
        return image


def _kept(picture: RenderedView) -> RenderedView:
    """The picture with colours that outlast the next one, and may be written on."""
    assert picture.rgb is not None
    return replace(picture, rgb=np.array(picture.rgb))


def _numbers(panel: Panel, picture: RenderedView) -> np.ndarray:
    if panel.view == "depth":
        assert picture.depth is not None
        return depth_millimetres(picture.depth)
    assert picture.ids is not None
    return segment_numbers(picture.ids, len(picture.legend))
