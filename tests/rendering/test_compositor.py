"""Frames of several views and cameras, against MuJoCo's renderer, arithmetic, and the parts they are made of."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.formats.image_encoding import depth_millimetres
from mjrun.model.state import save
from mjrun.options.rendering import LAYOUTS
from mjrun.rendering.added_geoms import Decoration, Ghost
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.colormaps import colors_of, colour_bar, depth_colors, seg_colors
from mjrun.rendering.compositor import (
    CameraPanel,
    FrameComposition,
    FrameSpec,
    SceneCompositor,
    TextAndLivePlots,
    compose_panels,
)
from mjrun.rendering.text import stamp
from mjrun.rendering.visual import SegmentationIds, Visual

SIZE = (64, 48)
CAMERAS = ("side", "free")
ANGLES = (0.0, 0.7)
RGB, DEPTH, SEG = CameraPanel(0, "rgb"), CameraPanel(0, "depth"), CameraPanel(0, "seg")


class Swing:
    """Instants of a model, and what draws them."""

    def __init__(self, path: Path, backend: WorkingBackend) -> None:
        self.model, self.backend = mujoco.MjModel.from_xml_path(str(path)), backend
        self.instants: list[mujoco.MjData] = []
        for angle in ANGLES:
            data = mujoco.MjData(self.model)
            data.qpos[0] = angle
            mujoco.mj_forward(self.model, data)
            self.instants.append(data)
        self.states = [save(self.model, data) for data in self.instants]

    def compositor(self, *specs: FrameSpec, **changes: object) -> SceneCompositor:
        motions = [BoundCameraScript(parse_camera(name, self.model), self.model, SIZE) for name in CAMERAS]
        poses = [[motion.pose(state) for motion in motions] for state in self.states]
        compositor = SceneCompositor(
            self.model, self.backend, SIZE, Visual(), CAMERAS, specs, poses, SegmentationIds(self.model)
        )
        return replace(compositor, **changes)  # type: ignore[arg-type]

    def frames(self, compositor: SceneCompositor, index: int = 0) -> list[np.ndarray]:
        """The frame of each spec at an instant."""
        flat = np.zeros(compositor.bytes, np.uint8)
        compositor.open()
        compositor.compose(self.states[index], index, flat)
        return [part.copy() for part in compositor.parts(flat)]


@pytest.fixture
def scene(swing: Path, backend: WorkingBackend) -> Swing:
    return Swing(swing, backend)


def spec(*panels: CameraPanel, exact: bool = False, **style: object) -> FrameSpec:
    return FrameSpec(panels, SIZE, FrameComposition(**style), exact)  # type: ignore[arg-type]


# --- sizes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("layout", "count", "side"), [*product(LAYOUTS, (1, 2, 5), ("under", "beside"))])
def test_a_frame_is_as_large_as_its_panels_composed_and_its_plots(layout: str, count: int, side: str) -> None:
    height, width = compose_panels([np.zeros((SIZE[1], SIZE[0], 3), np.uint8)] * count, layout).shape[:2]
    plots = [(30, 7), (30, 11)]
    overlay = TextAndLivePlots(plots=plots, side=side)
    frames = spec(*[RGB] * count, layout=layout, overlay=overlay)
    expected = (height + 18, width) if side == "under" else (height, width + 60)
    assert frames.shape == (*expected, 3)
    assert frames.size_of_frame == (expected[1], expected[0])
    assert frames.dtype == np.uint8


def test_the_frames_of_all_streams_share_flat_bytes_without_overlap(scene: Swing) -> None:
    compositor = scene.compositor(spec(RGB), spec(DEPTH, exact=True), spec(RGB, SEG, layout="column"))
    flat = np.zeros(compositor.bytes, np.uint8)
    parts = compositor.parts(flat)
    assert [(part.shape, part.dtype) for part in parts] == [(s.shape, s.dtype) for s in compositor.specs]
    assert sum(part.nbytes for part in parts) == flat.nbytes
    for part in parts:
        part[...] = 1
    assert flat.view(np.uint8).astype(bool).sum() == parts[0].size + parts[1].size + parts[2].size


# --- pixels -----------------------------------------------------------------------------------------


def test_colours_are_those_of_mujoco_s_renderer_whatever_other_streams_show(
    scene: Swing, still: Callable[..., np.ndarray]
) -> None:
    compositor = scene.compositor(spec(RGB), spec(RGB, CameraPanel(1, "rgb")), spec(SEG, exact=True))
    # Before the compositor opens: MuJoCo's renderer leaves its own OpenGL context current.
    expected = [[still(scene.model, data, SIZE, camera) for camera in ("side", -1)] for data in scene.instants]
    for index, (side, free) in enumerate(expected):
        alone, both, _ = scene.frames(compositor, index)
        assert np.array_equal(alone, side)
        assert np.array_equal(both, compose_panels([side, free]))
    compositor.close()


def test_numbers_are_millimetres_and_ids_plus_one(scene: Swing) -> None:
    compositor = scene.compositor(spec(DEPTH, exact=True), spec(SEG, exact=True))
    depth, segments = scene.frames(compositor)
    (seen, _) = compositor.render(scene.states[0], 0, ["depth", "seg"])
    compositor.close()
    assert seen.depth is not None
    assert seen.ids is not None
    assert np.array_equal(depth, depth_millimetres(seen.depth))
    assert np.array_equal(segments, seen.ids + 1)
    assert {0, 1, 2, 3} == set(np.unique(segments))


def test_coloured_depth_and_segments_are_their_numbers_through_the_maps(scene: Swing) -> None:
    ranges = [(1.0, 3.0), (1.0, 3.0)]
    compositor = scene.compositor(spec(DEPTH), spec(SEG), ranges=ranges)
    depth, segments = scene.frames(compositor)
    (seen, _) = compositor.render(scene.states[0], 0, ["depth", "seg"])
    compositor.close()
    assert seen.depth is not None
    assert seen.ids is not None
    expected = depth_colors(seen.depth, *ranges[0])
    colour_bar(expected, *ranges[0])
    assert np.array_equal(depth, expected)
    assert np.array_equal(segments, seg_colors(seen.ids, colors_of(SegmentationIds(scene.model).legend)))


def test_looking_ahead_finds_a_range_of_depth_that_holds_what_each_camera_sees(scene: Swing) -> None:
    compositor = scene.compositor(spec(DEPTH))
    compositor.open()
    compositor.choose_ranges(dict(enumerate(scene.states)))
    for camera, (near, far) in enumerate(compositor.ranges):
        depths = []
        for index, state in enumerate(scene.states):
            depth = compositor.render(state, index, ["depth"])[camera].depth
            assert depth is not None
            depths.append(depth[np.isfinite(depth)])
        seen = np.concatenate(depths)
        assert seen.min() <= near < far <= seen.max()
        assert ((seen >= near) & (seen <= far)).mean() > 0.85
    compositor.close()


# --- text -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("specs", "captions"),
    [
        ([spec(RGB)], ["side"]),
        ([spec(RGB, CameraPanel(1, "rgb"))], ["side", "free"]),
        ([spec(RGB, CameraPanel(1, "depth"))], ["side · colour", "free · depth"]),
        ([spec(SEG), spec(RGB)], ["side · segmentation"]),
    ],
)
def test_captions_name_the_camera_and_the_view_where_there_are_several(
    scene: Swing, specs: list[FrameSpec], captions: list[str]
) -> None:
    compositor = scene.compositor(*specs)
    assert [compositor.caption(panel) for panel in specs[0].panels] == captions


def test_captions_and_text_are_stamped_on_the_plain_frame(scene: Swing) -> None:
    texts = ["first", "second"]
    overlay = TextAndLivePlots(texts=texts, corner="bottom-right")
    compositor = scene.compositor(spec(RGB), spec(RGB, captions=True), spec(RGB, overlay=overlay))
    for index, text in enumerate(texts):
        plain, captioned, written = scene.frames(compositor, index)
        expected = plain.copy()
        stamp(expected, text, "bottom-right")
        assert np.array_equal(written, expected)
        assert np.array_equal(captioned, compose_panels([plain], labels=["side"]))
    compositor.close()


class Bar(Decoration):
    """Stands for a clock: a row whose brightness is the number of the frame."""

    def draw(self, frame: np.ndarray, index: int) -> None:
        frame[-1] = 100 + index


def test_decorations_draw_over_the_panels_of_a_frame_in_colour(scene: Swing) -> None:
    specs = spec(RGB, CameraPanel(1, "rgb")), spec(SEG), spec(DEPTH, exact=True)
    plain, drawn = (scene.compositor(*specs, ranges=[(1, 3)] * 2, decorations=each) for each in ([], [Bar()]))
    for index in range(len(ANGLES)):
        expected = scene.frames(plain, index)
        for frame in expected[:2]:
            frame[-1] = 100 + index
        assert all(map(np.array_equal, scene.frames(drawn, index), expected))
    plain.close()
    drawn.close()


class Stripes:
    """Stands for a plot: columns whose brightness is the time."""

    def draw(self, time: float) -> np.ndarray:
        return np.full((5, SIZE[0], 3), round(100 * time), np.uint8)


def test_plots_are_drawn_under_the_frame_at_its_time(scene: Swing) -> None:
    overlay = TextAndLivePlots(plots=[(SIZE[0], 5)], live_plots=[Stripes()], times=[0.5, 1.5])  # type: ignore[list-item]
    compositor = scene.compositor(spec(RGB), spec(RGB, overlay=overlay))
    for index, brightness in enumerate((50, 150)):
        plain, plotted = scene.frames(compositor, index)
        assert np.array_equal(plotted[: SIZE[1]], plain)
        assert (plotted[SIZE[1] :] == brightness).all()
    compositor.close()


def test_a_legend_names_what_is_in_view_and_leaves_the_rest_as_it_is(scene: Swing) -> None:
    large = (320, 240)
    specs = [FrameSpec([SEG], large, FrameComposition(legend=legend)) for legend in (False, True)]
    compositor = scene.compositor(*specs, size=large)
    plain, keyed = scene.frames(compositor)
    compositor.close()
    changed = (plain != keyed).any(axis=2)
    rows, columns = np.nonzero(changed)
    assert rows.min() > 0.3 * large[1]  # at the bottom left
    assert columns.max() < 0.5 * large[0]


# --- from process to process ------------------------------------------------------------------------


def test_a_compositor_that_has_drawn_is_the_same_in_another_process(scene: Swing) -> None:
    ghost = Ghost(scene.model, scene.states[::-1], offset=(0.0, 0.5, 0.0))
    compositor = scene.compositor(spec(RGB), spec(DEPTH), spec(SEG), decorations=[ghost])
    compositor.open()
    compositor.choose_ranges({0: scene.states[0]})
    here = [scene.frames(compositor, index) for index in range(2)]
    compositor.close()
    again = pickle.loads(pickle.dumps(compositor))
    there = [scene.frames(again, index) for index in range(2)]
    again.close()
    for mine, theirs in zip(here, there, strict=True):
        assert all(np.array_equal(*pair) for pair in zip(mine, theirs, strict=True))
    plain = scene.compositor(spec(RGB))
    assert not np.array_equal(here[0][0], scene.frames(plain)[0])
    plain.close()


@pytest.mark.parametrize("quality", ["model", "draft"])
def test_costs_are_wall_times_and_a_draft_of_a_draft_is_none(scene: Swing, quality: str) -> None:
    compositor = scene.compositor(spec(RGB), visual=Visual(quality=quality))
    scene.frames(compositor)
    costs = compositor.costs()
    compositor.close()
    assert costs.frame > 0
    assert (costs.draft is None) == (quality == "draft")
