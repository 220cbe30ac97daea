"""Filament, against rays, against the classic renderer, and against itself."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import product
from pathlib import Path
from unittest import mock

import mujoco
import numpy as np
import pytest

from mjrun.camera.pose import CameraPose
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import DrawError, UsageError
from mjrun.model.camera_images import CameraImages
from mjrun.model.state import save
from mjrun.rendering import filament
from mjrun.rendering.added_geoms import Ghost
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.filament import FilamentRenderer, check_segmentation, check_visual, omissions
from mjrun.rendering.visual import SegmentationIds, Visual
from tests.cases import cases, mjcf

pytestmark = pytest.mark.slow

SIZE = (96, 64)
EXACT = ("depth", "seg")
ROOM = mjcf("room")
ROUNDED = 10  # times larger are errors of depth on a GPU, which rounds corners to 1/256 of a pixel


@pytest.fixture(scope="module")
def room() -> mujoco.MjModel:
    """Boxes, a wedge and a rope in a room, seen by three kinds of camera."""
    return mujoco.MjModel.from_xml_string(ROOM)


def after(model: mujoco.MjModel, steps: int) -> mujoco.MjData:
    """With everything derived from that state computed."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=steps)
    mujoco.mj_forward(model, data)
    return data


def pose(camera: str, model: mujoco.MjModel, state: np.ndarray) -> CameraPose:
    return BoundCameraScript(parse_camera(camera, model), model, SIZE).pose(state)


class ReusedProcess:
    """A process of Filament in which one renderer after another opens a model, since it takes long to start."""

    def __init__(self) -> None:
        self._worker = filament._started()
        self.send, self.receive, self.end = self._worker.send, self._worker.receive, self._worker.close

    def close(self) -> None:
        """Keeps the process for the next renderer."""


class Draw:
    """Draws a model after some steps. The first renderer without options stays open, and the last other one."""

    def __init__(self, renderer: type, backend: WorkingBackend) -> None:
        self._make = lambda model, visual: renderer(model, SIZE, backend, visual, SegmentationIds(model))
        self._open: dict[tuple[mujoco.MjModel, str], ClassicRenderer | FilamentRenderer] = {}
        self._plain: tuple[mujoco.MjModel, str] | None = None
        self._process = ReusedProcess() if renderer is FilamentRenderer else None

    def _opened(self, key: tuple[mujoco.MjModel, str], visual: Visual) -> ClassicRenderer | FilamentRenderer:
        if self._plain is None and visual == Visual():
            self._plain = key
            return self._make(key[0], visual)
        for other in self._open.keys() - {self._plain}:
            self._open.pop(other).close()
        with mock.patch.object(filament, "_started", return_value=self._process):
            return self._make(key[0], visual)

    def __call__(
        self, model: mujoco.MjModel, views: tuple[str, ...] = ("rgb",), camera: str = "side", steps: int = 5, **visual
    ) -> CameraImages:
        key = (model, repr(visual))
        if key not in self._open:
            self._open[key] = self._opened(key, Visual(**visual))
        renderer, state = self._open[key], save(model, after(model, steps))
        if isinstance(renderer, ClassicRenderer):
            renderer.make_current()
        renderer.set_state(state)
        picture = renderer.render(pose(camera, model, state), views)
        return picture if picture.rgb is None else replace(picture, rgb=picture.rgb.copy())

    def close(self) -> None:
        for renderer in self._open.values():
            if isinstance(renderer, ClassicRenderer):
                renderer.make_current()
            renderer.close()
        if self._process:
            self._process.end()


@pytest.fixture(scope="module")
def draw(vulkan: WorkingBackend) -> Iterator[Draw]:
    with closing(Draw(FilamentRenderer, vulkan)) as drawing:
        yield drawing


@pytest.fixture(scope="module")
def classic(backend: WorkingBackend) -> Iterator[Draw]:
    with closing(Draw(ClassicRenderer, backend)) as drawing:
        yield drawing


def colors(picture: CameraImages) -> np.ndarray:
    assert picture.rgb is not None
    return picture.rgb.astype(int)


def exact(picture: CameraImages) -> tuple[np.ndarray, np.ndarray]:
    assert picture.depth is not None
    assert picture.ids is not None
    return picture.depth, picture.ids


def seen_as(picture: CameraImages, name: str) -> np.ndarray:
    """Where the thing called `name` is in a picture's ids."""
    assert picture.ids is not None
    return picture.ids == [thing.name for thing in picture.legend].index(name)


def rays(model: mujoco.MjModel, data: mujoco.MjData, picture: CameraImages) -> Iterator[tuple[int, int, float, int]]:
    """Column, row, planar depth [m] and geom of some pixels, by mj_ray; sites and tendons do not stop it."""
    lens, met = picture.calibration, np.zeros(1, np.int32)
    corner, ahead = lens.pose[:3, 3], lens.pose[:3, 2]
    for y, x in product(range(0, SIZE[1], 5), range(0, SIZE[0], 5)):
        (point,) = lens.unproject(np.ones(SIZE[::-1]))[y, x][None]
        start, way = (corner, point - corner) if lens.perspective else (point - ahead, ahead)
        hit = mujoco.mj_ray(model, data, start, way / np.linalg.norm(way), None, 1, -1, met)
        yield x, y, hit * float(way @ ahead) / float(np.linalg.norm(way)) if hit >= 0 else np.inf, int(met[0])


@pytest.mark.parametrize("camera", ["side", "shifted", "flat", "free"])
def test_depth_and_ids_are_those_of_rays(room: mujoco.MjModel, draw: Draw, vulkan: WorkingBackend, camera: str) -> None:
    # What rays see is what geoms alone would be: no wholly transparent ones, no sites, no tendons.
    options: dict = {"groups": {"site": (), "tendon": (), "geom": (0, 4)}}
    picture, data = draw(room, EXACT, camera, **options), after(room, 5)
    depth, ids = exact(picture)
    agreed, count = 0, 0
    for x, y, distance, geom in rays(room, data, picture):
        if geom == room.geom("unseen").id:
            continue
        count += 1
        if ids[y, x] == geom:  # but at edges
            agreed += 1
            assert depth[y, x] == pytest.approx(distance, rel=1e-5 if vulkan.software else ROUNDED * 1e-5)
    assert agreed >= 0.97 * count > 200


@pytest.mark.parametrize(
    "visual",
    [
        {},
        {"hide": ["static"], "groups": {"geom": [0, 4], "site": [1]}},
        {"groups": {"geom": [], "tendon": [1]}},
        {"show": ["transparent", "convexhull"], "quality": "draft"},
    ],
    ids=str,
)
def test_what_is_shown_and_hidden_is_what_the_classic_renderer_shows(
    room: mujoco.MjModel, draw: Draw, vulkan: WorkingBackend, classic: Draw, visual: dict
) -> None:
    (depth, ids), (expected_depth, expected_ids) = (exact(d(room, EXACT, **visual)) for d in (draw, classic))
    same = ids == expected_ids
    assert same.mean() > 0.99
    assert len(np.unique(expected_ids)) > 2
    seen = same & (ids >= 0)
    error = 1e-5 if vulkan.software else ROUNDED * 1e-5
    assert np.median(np.abs(depth[seen] / expected_depth[seen] - 1)) < error
    assert np.isinf(depth[ids < 0]).all()


def test_things_other_than_geoms_have_ids_too(room: mujoco.MjModel, draw: Draw) -> None:
    picture = draw(room, EXACT)
    depth, _ = exact(picture)
    for name, nearest, farthest in (("mark", 1.5, 1.7), ("rope", 1.6, 2.3)):
        assert seen_as(picture, name).sum() > 10
        assert nearest < depth[seen_as(picture, name)].min() < farthest
    assert not seen_as(picture, "unseen").any()


def test_colours_are_where_the_ids_are(room: mujoco.MjModel, draw: Draw) -> None:
    picture = draw(room, ("rgb", "seg"))
    rgb = colors(picture)
    for name, channel in (("box", 0), ("cube", 1)):
        others = np.delete(np.arange(3), channel)
        vivid = rgb[:, :, channel] > 2 * rgb[:, :, others].max(axis=2) + 20
        where = seen_as(picture, name)
        assert (vivid & where).sum() > 0.85 * max(vivid.sum(), where.sum())


def test_views_that_were_not_asked_for_are_not_there(room: mujoco.MjModel, draw: Draw) -> None:
    picture = draw(room, ("seg",))
    assert (picture.rgb, picture.depth) == (None, None)
    assert picture.ids is not None


def test_colours_vary_by_noise_only_and_the_rest_not_at_all(room: mujoco.MjModel, vulkan: WorkingBackend) -> None:
    early, late = (save(room, after(room, steps)) for steps in (0, 60))
    with closing(FilamentRenderer(room, SIZE, vulkan, Visual(), SegmentationIds(room))) as renderer:
        view, pictures = pose("side", room, early), []
        for state in (early, late, early):
            renderer.set_state(state)
            pictures.append(renderer.render(view, ("rgb", *EXACT)))
    first, other, again = pictures
    noise = np.abs(colors(first) - colors(again)).max(axis=2)
    assert (noise > 2).mean() < 0.03  # at edges
    assert noise.mean() < 1
    assert all(map(np.array_equal, exact(first), exact(again)))
    assert not all(map(np.array_equal, exact(first), exact(other)))


def test_a_video_is_the_same_each_time_across_processes(
    room: mujoco.MjModel, vulkan: WorkingBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(filament, "LIFETIME", 2)
    videos, processes = [], set()
    for _ in range(2):
        with closing(FilamentRenderer(room, SIZE, vulkan, Visual())) as renderer:
            video, view = [], pose("side", room, save(room, after(room, 0)))
            for steps in range(0, 30, 10):
                renderer.set_state(save(room, after(room, steps)))
                video.append(renderer.render(view).rgb)
                processes.add(renderer._worker.process.pid)
            videos.append(np.array(video))
    assert np.array_equal(*videos)
    assert len(processes) == 4


def test_contacts_are_drawn_where_they_are_in_colours_only(room: mujoco.MjModel, draw: Draw) -> None:
    plain = draw(room, ("rgb", *EXACT), steps=40)
    shown = draw(room, ("rgb", *EXACT), steps=40, show=["contactpoint"])
    contacts = np.array([contact.pos for contact in after(room, 40).contact])
    changed = np.abs(colors(plain) - colors(shown)).max(axis=2) > 40
    rows, columns = np.nonzero(changed)
    assert len(rows) > 3
    places = plain.calibration.project(contacts)[:, :2]
    distances = np.linalg.norm(np.stack([columns, rows], axis=1)[:, None] + 0.5 - places, axis=2)
    assert (distances.min(axis=1) < 8).all()
    assert all(map(np.array_equal, exact(plain), exact(shown)))


@pytest.mark.parametrize(
    "visual",
    [
        *({"show": [flag]} for flag in ("wireframe", "transparent", "joint", "island")),
        *({"hide": [flag]} for flag in ("shadow", "texture", "post_processing")),
        {"frame": "site"},
    ],
    ids=str,
)
def test_a_flag_that_is_taken_has_an_effect(room: mujoco.MjModel, draw: Draw, visual: dict) -> None:
    changed = np.abs(colors(draw(room, steps=40)) - colors(draw(room, steps=40, **visual))).max(axis=2) > 20
    assert changed.mean() > 0.003


def test_decors_are_in_colours_only_meshes_too(room: mujoco.MjModel, vulkan: WorkingBackend, draw: Draw) -> None:
    plain = draw(room, ("rgb", *EXACT))
    offset = (0.15, 0.0, 0.2)
    ghost = Ghost(room, offset=offset, opacity=1)
    with closing(FilamentRenderer(room, SIZE, vulkan, Visual(), SegmentationIds(room), [ghost])) as renderer:
        state = save(room, after(room, 5))
        renderer.set_state(state)
        renderer.render(pose("side", room, state))
        shown = renderer.render(pose("side", room, state), ("rgb", *EXACT))
    assert all(map(np.array_equal, exact(plain), exact(shown)))
    for name in ("box", "cube", "geom:6"):
        centre = after(room, 5).geom_xpos[room.ngeom - 1 if ":" in name else room.geom(name).id] + offset
        u, v, _ = plain.calibration.project(centre[None])[0]
        assert np.abs(colors(plain) - colors(shown))[int(v), int(u)].max() > 10


def test_high_quality_is_the_average_of_a_picture_twice_the_size(room: mujoco.MjModel, vulkan: WorkingBackend) -> None:
    width, height = SIZE
    state = save(room, after(room, 5))
    view = pose("side", room, state)
    with closing(FilamentRenderer(room, (2 * width, 2 * height), vulkan, Visual())) as renderer:
        renderer.set_state(state)
        large = colors(renderer.render(view))
    with closing(FilamentRenderer(room, SIZE, vulkan, Visual(quality="high"))) as renderer:
        renderer.set_state(state)
        high = colors(renderer.render(view))
    average = large.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    assert np.abs(high - average).max() <= 0.5


def test_a_draft_has_no_shadow_where_the_model_has_one(room: mujoco.MjModel, draw: Draw) -> None:
    model, draft = (colors(draw(room, quality=quality)) for quality in ("model", "draft"))
    assert 0.005 < ((draft - model).max(axis=2) > 20).mean() < 0.3


def test_light_does_not_depend_on_the_unit_of_length(draw: Draw) -> None:
    def scaled(scale: float) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(
            f"""<mujoco><visual><headlight active="0"/></visual><worldbody>
            <light pos="0 0 {2 * scale}" cutoff="80"/><light type="point" pos="{scale} 0 {scale}"/>
            <geom type="plane" size="{scale} {scale} 1"/><geom size="{0.3 * scale}" pos="0 0 {0.3 * scale}"/>
            <camera name="side" pos="0 {-2 * scale} {scale}" xyaxes="1 0 0 0 1 2"/></worldbody></mujoco>"""
        )

    small, large = (colors(draw(scaled(scale))) for scale in (0.02, 20))
    assert 30 < small.mean() < 120
    assert np.abs(small - large).mean() < 3


def test_lights_with_an_intensity_keep_it(draw: Draw) -> None:
    def lit(candela: float) -> int:
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody><light pos="0 0 3" intensity="{candela}"/>
            <geom type="plane" size="1 1 1"/><camera name="side" pos="0 0 2"/></worldbody></mujoco>"""
        )
        return int(colors(draw(model))[32, 48].max())

    assert lit(1e-3) < 5 < lit(3e5) < lit(1e6) < 255


@cases("visual, message")
def test_what_filament_cannot_draw_is_refused(room: mujoco.MjModel, visual: dict, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        check_visual(room, Visual(**visual))
    assert message in str(caught.value)


def test_asking_for_what_is_so_anyway_is_no_refusal(room: mujoco.MjModel) -> None:
    check_visual(
        room, Visual(show=["cull_face", "flexskin", "shadow"], hide=["fog", "depth", "flexvert", "reflection"])
    )


def test_a_segmentation_of_what_filament_never_shows_to_one_is_refused(room: mujoco.MjModel) -> None:
    for by in ("object", "geom", "tendon", "body", "root-body"):
        check_segmentation(SegmentationIds(room, by))
    with pytest.raises(UsageError, match="filament cannot render a joint in a segmentation"):
        check_segmentation(SegmentationIds(room, "joint"))


@pytest.mark.parametrize(("shape", "told"), [("plane", True), ("box", True), ("sphere", False)])
def test_reflections_that_are_left_out_are_reported(shape: str, told: bool) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><material name="mirror" reflectance=".5"/></asset>
        <worldbody><geom type="{shape}" size="1 1 1" material="mirror"/></worldbody></mujoco>"""
    )
    assert bool(omissions(model, Visual())) is told
    assert omissions(model, Visual(hide=["reflection"])) == []
    assert omissions(model, Visual(quality="draft")) == []


MIRROR = """
import mujoco, numpy as np
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.rendering.filament_worker import FilamentScene, PixelFormat
from mjrun.camera.script import parse_camera
from mjrun.model.state import save
model = mujoco.MjModel.from_xml_string('''<mujoco><asset><material name="mirror" reflectance=".8"/></asset><worldbody>
  <light pos="0 0 4" castshadow="false"/><geom type="plane" size="3 3 .1" material="mirror"/>
  <geom size=".2" pos="-.5 0 1" rgba="1 0 0 1"/><camera pos="0 -2 3" xyaxes="1 0 0 0 .83 .55"/></worldbody></mujoco>''')
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene = FilamentScene(model, mujoco.MjvOption())
seen = BoundCameraScript(parse_camera("0", model), model, (96, 64)).pose(save(model, data))
scene.update(data)
colours = PixelFormat("RGB8", "DEFAULT", 3, np.uint8)
shown = [scene.draw((96, 64), seen, colours, reflections=on).astype(int) for on in (0, 1)]
print("row", np.nonzero(np.abs(shown[0] - shown[1]).max(axis=2) > 20)[0].mean())
"""


def test_mujoco_s_reflections_are_still_upside_down(vulkan: WorkingBackend) -> None:
    """When this fails, see whether MIRRORS can be true."""
    code = MIRROR.replace(".astype(int) for", ".copy().astype(int) for")
    path = os.pathsep.join(entry for entry in sys.path if entry)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    row = float(next(line for line in done.stdout.splitlines() if line.startswith("row")).split()[1])
    assert not filament.MIRRORS
    assert row < 32  # of 64: the centre of the ball one metre below the floor is seen in row 41


def test_nothing_is_printed(room: mujoco.MjModel, vulkan: WorkingBackend, capfd: pytest.CaptureFixture[str]) -> None:
    with closing(Draw(FilamentRenderer, vulkan)) as draw:
        draw(room, ("rgb", *EXACT))
    assert capfd.readouterr() == ("", "")


def test_a_process_that_ends_is_reported_and_ends_nothing_else(room: mujoco.MjModel, vulkan: WorkingBackend) -> None:
    with closing(FilamentRenderer(room, SIZE, vulkan, Visual())) as renderer:
        os.kill(renderer._worker.process.pid, signal.SIGABRT)
        with pytest.raises(DrawError, match="filament's process was killed by SIGABRT"):
            renderer.set_state(save(room, after(room, 0)))


def test_without_a_driver_the_process_says_why_it_ended(
    room: mujoco.MjModel, vulkan: WorkingBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
        monkeypatch.setenv(variable, "/nonexistent.json")
    with pytest.raises(DrawError, match=r"(?s)killed by SIGABRT: .*Unable to create Vulkan instance.*renderer classic"):
        FilamentRenderer(room, SIZE, vulkan, Visual())


def test_a_size_beyond_the_renderer_s_is_refused(room: mujoco.MjModel, vulkan: WorkingBackend) -> None:
    side = vulkan.max_size // 2
    with pytest.raises(UsageError, match=f"renders at most {side} pixels a side at quality high"):
        FilamentRenderer(room, (side + 1, 64), vulkan, Visual(quality="high"))


def test_a_flex_looks_as_in_the_classic_renderer(shared_models: Path, draw: Draw, classic: Draw) -> None:
    model = mujoco.MjModel.from_xml_path(str(shared_models / "flex/flag.xml"))
    (depth, ids), (expected_depth, expected_ids) = (exact(d(model, EXACT, "free")) for d in (draw, classic))
    same = (ids == expected_ids) & (ids >= 0)
    assert (ids == expected_ids).mean() > 0.99
    assert np.median(np.abs(depth[same] / expected_depth[same] - 1)) < 1e-5
