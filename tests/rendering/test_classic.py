"""Pixels, against MuJoCo's own renderer."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.camera.pose import CameraPose
from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import DrawError, UsageError
from mjrun.model.camera_images import CameraImages
from mjrun.rendering import classic
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import ClassicRenderer, check_size
from mjrun.rendering.visual import SegmentationIds, Visual
from tests.conftest import SWING, instant

SIZE = (96, 64)
Still = Callable[..., np.ndarray]


@pytest.fixture
def swing(tmp_path: Path) -> Path:
    """The model of most tests with multisampling, as models have by default."""
    path = tmp_path / "swing.xml"
    path.write_text(SWING.replace('offsamples="0"', 'offsamples="4"'))
    return path


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    every = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, every))
    mujoco.mj_getState(model, data, state, every)
    return state


def pose(camera: str, model: mujoco.MjModel, data: mujoco.MjData) -> CameraPose:
    return BoundCameraScript(parse_camera(camera, model), model, SIZE).pose(state_of(model, data))


def draw(path: Path, step: int, backend: WorkingBackend, camera: str = "side", **visual: object) -> np.ndarray:
    """What mjrun draws of a step."""
    model, data = instant(path, step)
    with closing(ClassicRenderer(model, SIZE, backend, Visual(**visual))) as renderer:  # type: ignore[arg-type]
        return picture(renderer, model, data, camera)


def picture(renderer: ClassicRenderer, model: mujoco.MjModel, data: mujoco.MjData, camera: str) -> np.ndarray:
    renderer.set_state(state_of(model, data))
    found = renderer.render(pose(camera, model, data)).rgb
    assert found is not None
    return found.copy()


@pytest.mark.parametrize("camera", ["side", "free"])
@pytest.mark.parametrize("step", [0, 300])
def test_a_picture_is_mujoco_s_own_to_the_last_bit(
    swing: Path, backend: WorkingBackend, still: Still, camera: str, step: int
) -> None:
    expected = still(*instant(swing, step), SIZE, -1 if camera == "free" else camera)
    assert np.array_equal(draw(swing, step, backend, camera), expected)


def test_contact_forces_belong_to_the_state_that_is_shown(swing: Path, backend: WorkingBackend, still: Still) -> None:
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_CONTACTFORCE] = 1
    expected = still(*instant(swing, 80), SIZE, "side", option)
    plain = still(*instant(swing, 80), SIZE, "side")
    assert not np.array_equal(expected, plain)
    assert np.array_equal(draw(swing, 80, backend, show=["contactforce"]), expected)


def test_pictures_do_not_depend_on_what_was_drawn_before(swing: Path, backend: WorkingBackend) -> None:
    model, early = instant(swing, 20)
    _, late = instant(swing, 300)
    with closing(ClassicRenderer(model, SIZE, backend, Visual())) as renderer:
        first = picture(renderer, model, early, "side")
        other = picture(renderer, model, late, "side")
        renderer.draft_cost()
        renderer.render(pose("side", model, late), ["depth"])
        again = picture(renderer, model, early, "side")
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


def test_drawing_leaves_the_model_as_it_was(swing: Path, backend: WorkingBackend) -> None:
    model, data = instant(swing, 0)
    with closing(ClassicRenderer(model, (200, 100), backend, Visual(quality="draft"))) as renderer:
        assert picture(renderer, model, data, "free").shape == (100, 200, 3)
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (64, 64)
    assert (model.vis.quality.offsamples, model.vis.quality.shadowsize) == (4, 256)


def test_high_quality_is_the_average_of_a_picture_twice_the_size(
    swing: Path, backend: WorkingBackend, still: Still
) -> None:
    width, height = SIZE
    large = still(*instant(swing, 0), (2 * width, 2 * height), "side").astype(int)
    average = large.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    assert np.abs(draw(swing, 0, backend, quality="high") - average).max() <= 0.5


def test_a_draft_has_no_shadow_where_the_model_has_one(swing: Path, backend: WorkingBackend) -> None:
    model, draft = (draw(swing, 0, backend, quality=q).astype(int) for q in ("model", "draft"))
    darker = (draft - model).max(axis=2) > 30
    assert 0.005 < darker.mean() < 0.3


@pytest.mark.parametrize("show", [(), ("shadow",)])
def test_a_draft_is_what_the_flags_of_mujoco_make_of_the_model(
    swing: Path, backend: WorkingBackend, show: tuple[str, ...]
) -> None:
    model, data = instant(swing, 0)
    model.vis.quality.offsamples = 0
    model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
    with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
        renderer.update_scene(data, "side")
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = bool(show)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        expected = renderer.render()
    assert np.array_equal(draw(swing, 0, backend, quality="draft", show=show), expected)


def test_the_flag_for_depth_in_grey_does_not_change_ids(swing: Path, backend: WorkingBackend) -> None:
    model, data = instant(swing, 0)
    place, found = pose("side", model, data), list[np.ndarray | None]()
    for visual in (Visual(), Visual(show=["depth"])):
        with closing(ClassicRenderer(model, SIZE, backend, visual, SegmentationIds(model))) as renderer:
            renderer.set_state(state_of(model, data))
            found.append(renderer.render(place, ["seg"]).ids)
    assert np.array_equal(*found)


def test_hidden_things_are_not_drawn(swing: Path, backend: WorkingBackend) -> None:
    green = np.array([0, 1, 0])

    def greenness(picture: np.ndarray) -> int:
        return int((picture.argmax(axis=2) == 1)[(picture * (1 - green)).max(axis=2) < 60].sum())

    assert greenness(draw(swing, 0, backend)) > 20
    assert greenness(draw(swing, 0, backend, groups={"geom": ()})) == 0


def test_a_scene_grows_until_everything_is_in_it(
    swing: Path, backend: WorkingBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = draw(swing, 0, backend, show=["joint", "com"], hide=["shadow"])
    monkeypatch.setattr(classic, "GEOMS", 2)
    assert np.array_equal(draw(swing, 0, backend, show=["joint", "com"], hide=["shadow"]), expected)


def test_a_size_beyond_the_renderer_s_is_refused(backend: WorkingBackend) -> None:
    side = backend.max_size // 2
    with pytest.raises(UsageError, match=f"renders at most {side} pixels a side at quality high"):
        check_size((side + 1, 64), backend, Visual(quality="high"))


def seen(
    path: Path, backend: WorkingBackend, by: str = "object", camera: str = "side", **visual: object
) -> CameraImages:
    """Depth and ids of the model where it begins."""
    model, data = instant(path, 0)
    look = Visual(**visual)  # type: ignore[arg-type]
    with closing(ClassicRenderer(model, SIZE, backend, look, SegmentationIds(model, by))) as renderer:
        renderer.set_state(state_of(model, data))
        return renderer.render(pose(camera, model, data), ["depth", "seg"])


def rays(path: Path, picture: CameraImages) -> tuple[np.ndarray, np.ndarray]:
    """What `mj_ray` hits from the camera through the centre of every pixel: geom ids and planar depths [m]."""
    model, data = instant(path, 0)
    width, height = SIZE
    eye, ahead = picture.calibration.pose[:3, 3], picture.calibration.pose[:3, 2]
    ids, depths, hit = np.full((height, width), -1), np.full((height, width), np.inf), np.zeros(1, np.int32)
    for v in range(height):
        for u in range(width):
            local = [
                (u + 0.5 - picture.calibration.cx) / picture.calibration.fx,
                (v + 0.5 - picture.calibration.cy) / picture.calibration.fy,
                1,
            ]
            ray = picture.calibration.pose[:3, :3] @ local
            ray /= np.linalg.norm(ray)
            distance = mujoco.mj_ray(model, data, eye, ray, None, 1, -1, hit)
            if distance >= 0:
                ids[v, u], depths[v, u] = hit[0], distance * (ray @ ahead)
    return ids, depths


@pytest.mark.parametrize("quality", ["model", "high"])
@pytest.mark.parametrize("camera", ["side", "free"])
def test_depth_and_ids_are_those_of_rays(swing: Path, backend: WorkingBackend, camera: str, quality: str) -> None:
    picture = seen(swing, backend, camera=camera, quality=quality)
    assert picture.depth is not None
    assert picture.ids is not None
    ids, depths = rays(swing, picture)
    named = np.array([*(thing.id if thing.type == "geom" else -2 for thing in picture.legend), -1])
    same = named[picture.ids] == ids
    assert same.mean() > 0.98
    edges = np.zeros_like(same)  # where a neighbour is something else, a ray may pass on the other side
    edges[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    edges[:, :-1] |= ids[:, 1:] != ids[:, :-1]
    edges[1:] |= ids[1:] != ids[:-1]
    edges[:-1] |= ids[1:] != ids[:-1]
    assert same[~edges].all()
    assert {0, 1, 2} <= set(ids[~edges])
    inner = same & ~edges & np.isfinite(depths) & (depths < 4)
    assert inner.mean() > 0.4
    box = inner & (ids == 1)
    error = 1e-5 if backend.software else 3e-5
    assert picture.depth[box] == pytest.approx(depths[box], rel=error)  # balls are drawn with flat facets
    assert picture.depth[inner] == pytest.approx(depths[inner], rel=5e-3)
    assert np.array_equal(np.isinf(picture.depth), picture.ids < 0)


def test_a_segmentation_has_no_colours_between_objects(swing: Path, backend: WorkingBackend) -> None:
    picture = seen(swing, backend)
    assert picture.ids is not None
    shown = {picture.legend[i].name for i in np.unique(picture.ids) if i >= 0}
    assert shown == {"floor", "box", "ball"}


@pytest.mark.parametrize(
    ("by", "expected"),
    [
        ("geom", {("geom", "floor"), ("geom", "box"), ("geom", "ball")}),
        ("body", {("body", "world"), ("body", "box"), ("body", "ball")}),
        ("root-body", {("root-body", "world"), ("root-body", "box"), ("root-body", "ball")}),
        ("site", set()),
    ],
)
def test_a_segmentation_tells_apart_what_it_is_asked_to(
    swing: Path, backend: WorkingBackend, by: str, expected: set[tuple[str, str]]
) -> None:
    picture = seen(swing, backend, by)
    assert picture.ids is not None
    assert {(picture.legend[i].type, picture.legend[i].name) for i in np.unique(picture.ids) if i >= 0} == expected


def test_a_tree_of_bodies_is_one_thing(tmp_path: Path, backend: WorkingBackend) -> None:
    path = tmp_path / "tree.xml"
    path.write_text(
        '<mujoco><worldbody><camera name="side" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>'
        '<body name="arm"><geom name="upper" size=".2" pos="-.3 0 0"/>'
        '<body name="hand"><site name="tip" pos="0 0 .4" size=".1"/><geom name="lower" size=".2" pos=".3 0 0"/></body>'
        "</body></worldbody></mujoco>"
    )
    found = {}
    for by in ("object", "body", "root-body", "site"):
        picture = seen(path, backend, by)
        assert picture.ids is not None
        found[by] = {picture.legend[i].name for i in np.unique(picture.ids) if i >= 0}
        assert {picture.legend[i].body for i in np.unique(picture.ids) if i >= 0} <= {"arm", "hand"}
    assert found["object"] == {"upper", "lower", "tip"}
    assert found["body"] == {"arm", "hand"}
    assert found["root-body"] == {"arm"}
    assert found["site"] == {"tip"}


def test_exact_pictures_do_not_depend_on_the_camera_before(tmp_path: Path, backend: WorkingBackend) -> None:
    path = tmp_path / "plane.xml"  # an infinite plane is drawn as a finite one, centred under a camera
    path.write_text(
        '<mujoco><worldbody><geom type="plane" size="0 0 .05"/><body pos="0 0 .3"><geom size=".3"/></body>'
        '<camera name="a" pos="0 -2 1" xyaxes="1 0 0 0 .4 1"/><camera name="b" pos="9 7 1" xyaxes="0 1 0 -.4 0 1"/>'
        "</worldbody></mujoco>"
    )
    model, data = instant(path, 0)
    views = ["depth", "seg", "rgb"]
    with closing(ClassicRenderer(model, SIZE, backend, Visual(), SegmentationIds(model))) as renderer:
        renderer.set_state(state_of(model, data))
        first = renderer.render(pose("a", model, data), ["depth", "seg"])
        renderer.render(pose("b", model, data), views)
        later = renderer.render(pose("a", model, data), ["depth", "seg"])
    assert np.array_equal(first.depth, later.depth)  # type: ignore[arg-type]
    assert np.array_equal(first.ids, later.ids)  # type: ignore[arg-type]


def test_more_things_than_a_byte_can_number_are_reported_apart(tmp_path: Path, backend: WorkingBackend) -> None:
    path = tmp_path / "many.xml"
    path.write_text(
        '<mujoco><worldbody><camera name="side" pos="0 0 30" fovy="60"/>'
        '<replicate count="20" offset="1 0 0"><replicate count="20" offset="0 1 0">'
        '<geom type="box" size=".4 .4 .1" pos="-9.5 -9.5 0"/></replicate></replicate></worldbody></mujoco>'
    )
    picture = seen(path, backend)
    ids, _ = rays(path, picture)
    assert picture.ids is not None
    assert len(np.unique(picture.ids)) == 401
    assert (picture.ids == ids).mean() > 0.85  # the rest are edges
    assert set(np.unique(ids[ids == picture.ids])) == {-1, *range(400)}


def test_maps_of_shadows_that_the_driver_does_not_have_are_refused(backend: WorkingBackend) -> None:
    quality = f'<visual><quality shadowsize="{2 * backend.max_size}"/></visual>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{quality}<worldbody><light/></worldbody></mujoco>")
    with pytest.raises(DrawError, match=f"shadowsize of the model, {2 * backend.max_size}, is too large"):
        ClassicRenderer(model, (8, 8), backend, Visual())
