"""Labelled images, against renderings of MuJoCo's segmentation and closed forms."""

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.model.state import save
from mjrun.options.datasets import LabelledImageOptions
from mjrun.outputs.labelled_images import AcceptanceConditions, LabelledImage, LabelledImageRenderer, labelled_objects
from mjrun.rendering.single_render import render
from mjrun.rendering.visual import SegmentationIds

SIZE = (160, 120)
CAMERA = "look:from=0/-2/.5,at=0/0/.5"
MODEL = """<mujoco><visual><quality shadowsize="64" offsamples="0"/></visual>
<asset><texture name="t" type="2d" builtin="flat" rgb1="1 0 0" width="8" height="8"/>
  <material name="m" texture="t"/></asset>
  <worldbody><light pos="0 -1 3"/><geom name="floor" type="plane" size="3 3 .1"/>
  <body name="box" pos="-.3 0 .5" euler="10 20 30"><freejoint/><geom type="box" size=".1 .15 .2" material="m"/>
    <geom size="2" group="3" contype="0" conaffinity="0"/><site name="corner" pos=".1 .15 .2" size=".001"/></body>
  <body name="ball" pos=".3 .3 .5"><freejoint/><geom size=".1"/><site name="middle" size=".001"/></body>
  <body name="plate" pos="{plate} -.3 .5"><geom type="box" size=".2 .01 .3"/></body>
  <body name="arm" pos="0 1 .2"><geom size=".05"/>
    <body name="hand" pos="0 0 .5"><joint/><geom size=".05"/></body></body>
  </worldbody></mujoco>"""


@pytest.fixture
def renderer() -> Iterator[LabelledImageRenderer]:
    made = LabelledImageRenderer(LabelledImageOptions(size=SIZE, keypoints="middle,corner"), outlines=True)
    yield made
    made.close()


def compiled(plate: float = 9.0) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL.format(plate=plate))


def pictured(renderer: LabelledImageRenderer, model: mujoco.MjModel, camera: str = CAMERA) -> LabelledImage:
    (image,) = renderer.images(model, [camera], [save(model, mujoco.MjData(model))], [0.0])
    return image


def test_masks_and_depth_are_those_of_mjruns_segmentation(renderer: LabelledImageRenderer) -> None:
    model = compiled()
    image = pictured(renderer, model)
    data = mujoco.MjData(model)
    ids = render(model, data, CAMERA, SIZE, "seg")
    legend = SegmentationIds(model).legend
    bodies = [each.body for each in legend]
    for view in image.views:
        names = {view.object.name} | ({"hand"} if view.object.name == "arm" else set())
        expected = np.isin(ids, [i for i, body in enumerate(bodies) if body in names])
        np.testing.assert_array_equal(image.objects == image.views.index(view), expected)
        assert view.pixels == expected.sum()
    np.testing.assert_array_equal(image.depth, render(model, data, CAMERA, SIZE, "depth"))
    hand = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "hand")
    assert (image.bodies == hand).any()


SOFT = """<mujoco><visual><quality shadowsize="64" offsamples="0"/></visual>
<worldbody><light pos="0 -1 3"/>
  <flexcomp name="pinned" type="grid" dim="2" count="3 3 1" spacing=".2 .2 .2" pos="-.3 0 .5" euler="60 0 0"
    radius=".01" mass="1"><edge equality="true"/><pin id="0 2"/></flexcomp>
  <flexcomp name="bulk" type="grid" dim="3" count="3 3 3" spacing=".1 .1 .1" pos=".3 0 .5" dof="trilinear" radius=".01"
    mass="1"><elasticity young="1e4" poisson=".2"/></flexcomp>
  <body name="last" pos="0 0 1"><freejoint/><geom size=".05"/></body></worldbody></mujoco>"""


def test_a_flex_is_one_object_pinned_or_interpolated() -> None:
    model = mujoco.MjModel.from_xml_string(SOFT)
    renderer = LabelledImageRenderer(LabelledImageOptions(size=SIZE))
    image = pictured(renderer, model)
    renderer.close()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ids = render(model, data, CAMERA, SIZE, "seg")
    numbers = {each.name: number for number, each in enumerate(SegmentationIds(model).legend) if each.type == "flex"}
    assert [view.object.category for view in image.views] == ["pinned", "bulk", "last"]
    for index, name in enumerate(["pinned", "bulk"]):
        view = image.views[index]
        assert view.pixels > 50
        np.testing.assert_array_equal(image.objects == index, ids == numbers[name])
        first, count = model.flex_vertadr[index], model.flex_vertnum[index]
        world = image.calibration.pose @ view.pose
        points = (data.flexvert_xpos[first : first + count] - world[:3, 3]) @ world[:3, :3] - view.box.center
        np.testing.assert_allclose(np.abs(points).max(axis=0), view.box.size / 2, atol=1e-9)
    assert image.views[2].box.size.max() == pytest.approx(0.1)


SKINNED = """<mujoco><worldbody><light pos="0 0 3"/>
  <camera name="half" pos=".26667 0 2" projection="orthographic" fovy=".4"/>
  <body name="sheet"><freejoint/><geom size=".1" group="4"/></body></worldbody>
  <deformable><skin vertex="-.2 -.1 0  .2 -.1 0  -.2 .1 0  .2 .1 0" face="0 1 2  2 1 3">
    <bone body="sheet" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2 3" vertweight="1 1 1 1"/></skin></deformable>
  </mujoco>"""


def test_a_skin_is_part_of_its_object_also_outside_of_the_image() -> None:
    model = mujoco.MjModel.from_xml_string(SKINNED)
    renderer = LabelledImageRenderer(LabelledImageOptions(size=SIZE))
    (view,) = pictured(renderer, model, "half").views
    renderer.close()
    np.testing.assert_allclose(view.box.size, [0.4, 0.2, 0], atol=1e-6)
    assert view.truncated == pytest.approx(0.5, abs=0.02)


def test_colours_are_those_of_a_rendering_of_each_model_in_turn(renderer: LabelledImageRenderer) -> None:
    model = compiled()
    first = pictured(renderer, model)
    np.testing.assert_array_equal(first.rgb, render(model, mujoco.MjData(model), CAMERA, SIZE))
    for change in ("geom_rgba", "tex_data"):  # the second needs another upload
        other = compiled()
        getattr(other, change)[:] = getattr(other, change) // 2 if change == "tex_data" else 0.5
        image = pictured(renderer, other)
        np.testing.assert_array_equal(image.rgb, render(other, mujoco.MjData(other), CAMERA, SIZE))
        assert (image.rgb != first.rgb).any()


def test_corners_of_boxes_project_to_within_half_a_pixel(renderer: LabelledImageRenderer) -> None:
    image = pictured(renderer, compiled())
    view = image.views[0]
    u, v = image.calibration.project(view.box.corners(image.calibration.pose @ view.pose))[:, :2].T
    x, y, width, height = view.outline
    np.testing.assert_allclose([u.min(), v.min(), u.max(), v.max()], [x, y, x + width, y + height], atol=0.5 + 1e-6)
    corner = view.keypoints[0]
    assert np.abs(np.stack([u, v], axis=1) - corner[:2]).max(axis=1).min() < 1e-6


def test_covered_objects_are_less_visible_than_their_silhouettes(renderer: LabelledImageRenderer) -> None:
    open_view = pictured(renderer, compiled()).views[1]
    assert open_view.visible == 1
    assert open_view.keypoints[0, 2] == 2
    covered = pictured(renderer, compiled(plate=0.3)).views[1]
    assert (covered.pixels, covered.region) == (0, None)
    assert covered.silhouette == open_view.pixels
    assert covered.keypoints[0, 2] == 1
    assert covered.alone is not None
    assert covered.alone.sum() == open_view.pixels


def test_half_of_a_ball_at_the_edge_of_the_image_is_truncated(renderer: LabelledImageRenderer) -> None:
    # The camera looks along y at x = a, such that the centre of the ball is on the right edge.
    model = compiled()
    half_width = np.tan(np.radians(model.vis.global_.fovy) / 2) * SIZE[0] / SIZE[1]
    across = 0.3 - 2.3 * half_width
    image = pictured(renderer, model, f"look:from={across}/-2/.5,at={across}/0/.5")
    ball = image.views[1]
    u = image.calibration.project(np.array([[0.3, 0.3, 0.5]]))[0, 0]
    assert u == pytest.approx(SIZE[0])
    assert ball.truncated == pytest.approx(0.5, abs=0.05)
    assert ball.visible == pytest.approx(1 - ball.truncated, abs=0.05)
    x, _, width, _ = ball.outline
    assert x + width / 2 == pytest.approx(SIZE[0], abs=1.5)


def test_the_share_within_the_image_is_that_of_its_pixels(renderer: LabelledImageRenderer) -> None:
    # From so close, the image shows a sliver of the ball, which is narrower than a pixel of a view of the whole ball.
    views = pictured(renderer, compiled(), "look:from=.13/.195/.5,at=.13/2/.5").views
    assert views[1].pixels > 0
    assert views[1].truncated > 0.9
    for view in views:
        assert view.alone is not None
        assert view.silhouette * (1 - view.truncated) == pytest.approx(view.alone.sum())
        assert view.pixels <= view.alone.sum() <= view.silhouette


def test_poses_are_those_of_bodies_seen_from_the_camera(renderer: LabelledImageRenderer) -> None:
    model = compiled()
    image = pictured(renderer, model)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for view in image.views:
        world = image.calibration.pose @ view.pose
        np.testing.assert_allclose(world[:3, 3], data.xpos[view.object.body], atol=1e-12)
        np.testing.assert_allclose(world[:3, :3].ravel(), data.xmat[view.object.body], atol=1e-12)


def test_several_cameras_and_times_are_rendered_in_order(renderer: LabelledImageRenderer) -> None:
    model, data = compiled(), mujoco.MjData(compiled())
    states = list[np.ndarray]()
    for _ in range(2):
        states.append(save(model, data))
        mujoco.mj_step(model, data, 50)
    images = list(renderer.images(model, [CAMERA, "free"], states, [0.0, 0.1]))
    assert [(image.camera, image.time) for image in images] == [
        (name, time) for time in (0.0, 0.1) for name in (CAMERA, "free")
    ]
    np.testing.assert_array_equal(images[2].rgb, render(model, _at(model, states[1]), CAMERA, SIZE))


def _at(model: mujoco.MjModel, state: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return data


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, [("box", "box"), ("ball", "ball"), ("plate", "plate"), ("arm", "arm")]),
        ({"objects": "b*=thing,hand"}, [("box", "thing"), ("ball", "thing"), ("hand", "hand")]),
    ],
)
def test_objects_are_chosen_by_name(options: dict[str, str], expected: list[tuple[str, str]]) -> None:
    objects = labelled_objects(LabelledImageOptions(**options), compiled())  # type: ignore[arg-type]
    assert [(each.name, each.category) for each in objects] == expected


@pytest.mark.parametrize("pattern", ["pinned", "pinned_*", "pinned_4"])
def test_a_flex_is_chosen_by_its_name_or_by_bodies_that_carry_it(pattern: str) -> None:
    objects = labelled_objects(LabelledImageOptions(objects=f"{pattern}=cloth"), mujoco.MjModel.from_xml_string(SOFT))
    assert [(each.name, each.category) for each in objects] == [("pinned", "cloth")]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"objects": "bal"}, UnknownNameError, "no body 'bal' (did you mean 'ball'?)"),
        ({"objects": "arm,hand"}, UsageError, "hand is part of arm"),
        ({"objects": "world"}, UsageError, "the world is not an object"),
        ({"keypoints": "tip"}, UnknownNameError, "no site 'tip'"),
    ],
)
def test_wrong_objects_are_refused(options: dict[str, str], error: type[Exception], message: str) -> None:
    with pytest.raises(error) as caught:
        labelled_objects(LabelledImageOptions(**options), compiled())  # type: ignore[arg-type]
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("objects == 3", True),  # the plate is outside of the image
        ("visible/ball > 0.99 and pixels/ball > 100", True),
        ("pixels/plate > 0", False),
        ("truncated/box > 0", False),
    ],
)
def test_conditions_decide_on_images(renderer: LabelledImageRenderer, condition: str, holds: bool) -> None:
    model = compiled()
    views = pictured(renderer, model).views
    options = LabelledImageOptions(accept=condition)
    assert AcceptanceConditions(options, labelled_objects(options, model)).hold(views) is holds


def test_unknown_names_in_conditions_are_refused() -> None:
    options = LabelledImageOptions(accept="visible/bal > 0")
    with pytest.raises(UnknownNameError, match="visible/ball"):
        AcceptanceConditions(options, labelled_objects(options, compiled()))
