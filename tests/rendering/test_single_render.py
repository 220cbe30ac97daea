"""One image of a state, against rays, files of mjrun, and MuJoCo's own cameras."""

import copy
import gc
import os
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import BadValueError, DrawError, UnknownNameError, UsageError
from mjrun.rendering.single_render import CACHED, CACHED_CAMERAS
from mjrun.rendering.visual import SegmentationIds, Visual

SIZE = (48, 32)
XML = """
<mujoco>
  <worldbody>
    <light pos="0 0 4"/>
    <geom name="floor" type="plane" size="2 2 .1" rgba=".3 .4 .5 1"/>
    <camera name="top" pos="0 0 3" fovy="60"/>
    <body name="box" pos="0 0 .5"><freejoint/><geom name="cube" type="box" size=".3 .3 .3" rgba="1 .2 .1 1"/></body>
  </worldbody>
</mujoco>
"""

pytestmark = pytest.mark.gl


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def moved(model: mujoco.MjModel, x: float = 0.4) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[0] = x
    mujoco.mj_forward(model, data)
    return data


def test_depth_and_ids_are_those_of_rays(model: mujoco.MjModel) -> None:
    data, (width, height) = moved(model), SIZE
    depth, ids = (mjrun.render(model, data, "top", SIZE, view) for view in ("depth", "seg"))
    assert (depth.shape, depth.dtype, ids.shape, ids.dtype) == ((32, 48), np.float32, (32, 48), np.int32)
    legend = SegmentationIds(model).legend
    camera, slope = data.camera("top"), np.tan(np.radians(30)) / (height / 2)
    for row, column in [(16, 24), (3, 5), (16, 32), (28, 40), (15, 28)]:
        direction = np.array([(column + 0.5 - width / 2) * slope, (height / 2 - row - 0.5) * slope, -1.0])
        geom = np.zeros(1, np.int32)
        ray = camera.xmat.reshape(3, 3) @ direction
        distance = mujoco.mj_ray(model, data, camera.xpos, ray, None, 1, -1, geom)
        assert depth[row, column] == pytest.approx(distance if distance > 0 else np.inf, rel=1e-3)
        assert ids[row, column] < 0 if distance < 0 else legend[ids[row, column]].name == model.geom(geom[0]).name


def test_colours_are_those_of_an_image_file(model: mujoco.MjModel, tmp_path: Path) -> None:
    path = str(tmp_path / "a.png")
    mjrun.Image(mjrun.Simulation(model, duration=1), path, camera="orbit:lookat=box", size=SIZE).run()
    data = mujoco.MjData(model)
    image = mjrun.render(model, data, "orbit:lookat=box", SIZE)
    assert image.dtype == np.uint8
    assert np.array_equal(image, np.asarray(Image.open(path)))


def test_the_data_stays_as_it_is(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3  # without mj_forward: xpos is that of before
    before = {name: np.array(getattr(data, name)) for name in ("qpos", "qvel", "xpos", "geom_xpos", "qacc", "cvel")}
    image = mjrun.render(model, data, "top", SIZE)
    assert all(np.array_equal(value, getattr(data, name)) for name, value in before.items())
    assert np.array_equal(image, mjrun.render(model, moved(model, 0.3), "top", SIZE))


@pytest.mark.parametrize(("camera", "same"), [(0, "top"), ("camera:0", "top"), (mujoco.MjvCamera(), "free")])
def test_a_camera_may_be_a_name_an_index_or_mujoco_s(model: mujoco.MjModel, camera: object, same: str) -> None:
    data = moved(model)
    if isinstance(camera, mujoco.MjvCamera):
        mujoco.mjv_defaultFreeCamera(model, camera)
    one, other = (mjrun.render(model, data, each, SIZE).astype(int) for each in (camera, same))  # type: ignore[arg-type]
    assert np.abs(one - other).max() <= 2  # of float32


def test_renderers_of_several_models_and_sizes_do_not_disturb_each_other(model: mujoco.MjModel) -> None:
    others = [mujoco.MjModel.from_xml_string(XML.replace("1 .2 .1", f".1 .{k} 1")) for k in range(CACHED + 1)]
    expected = mjrun.render(model, moved(model), "top", SIZE)
    colours = [mjrun.render(other, moved(other), "top", SIZE)[16, 30] for other in others]
    assert len({tuple(colour) for colour in colours}) == len(others)
    assert mjrun.render(model, moved(model), "top", (20, 30)).shape == (30, 20, 3)
    assert np.array_equal(mjrun.render(model, moved(model), "top", SIZE), expected)


@pytest.mark.parametrize("camera", ["free", "track:box", "orbit:lookat=box,distance=2"])
def test_a_changed_free_camera_takes_effect(camera: str) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    before = mjrun.render(model, moved(model), camera, SIZE)
    model.vis.global_.azimuth, model.vis.global_.fovy, model.stat.extent = 20, 30, 1
    changed = mjrun.render(model, moved(model), camera, SIZE)
    other = copy.copy(model)
    assert not np.array_equal(changed, before)
    np.testing.assert_array_equal(changed, mjrun.render(other, moved(other), camera, SIZE))


@pytest.mark.parametrize("setting", ["znear", "zfar"])
def test_changed_clipping_planes_take_effect(setting: str) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    before = mjrun.render(model, moved(model), "free", SIZE, "depth")
    setattr(model.vis.map, setting, {"znear": 1.0, "zfar": 1.3}[setting])
    changed = mjrun.render(model, moved(model), "free", SIZE, "depth")
    other = copy.copy(model)
    assert not np.array_equal(changed, before)
    np.testing.assert_array_equal(changed, mjrun.render(other, moved(other), "free", SIZE, "depth"))


@pytest.mark.parametrize("setting", ["fogend", "shadowscale", "castshadow", "numslices"])
def test_changed_visual_settings_take_effect_also_where_opengl_keeps_them(setting: str) -> None:
    text = XML.replace('pos="0 0 4"', 'pos="1 1 4" dir="-.2 -.2 -1" castshadow="false"').replace(
        'box" size', 'ellipsoid" size'
    )
    model = mujoco.MjModel.from_xml_string(text)
    model.vis.quality.shadowsize, model.vis.map.fogstart = 256, 0.1
    model.light_castshadow[:] = setting == "shadowscale"
    fog = Visual(show=("fog",))
    before = mjrun.render(model, moved(model), "top", SIZE, visual=fog)
    match setting:
        case "fogend":
            model.vis.map.fogend = 1
        case "shadowscale":
            model.vis.map.shadowscale = 0.1
        case "castshadow":
            model.light_castshadow[:] = True
        case _:
            model.vis.quality.numslices = model.vis.quality.numstacks = 4
    changed = mjrun.render(model, moved(model), "top", SIZE, visual=fog)
    other = copy.copy(model)
    assert not np.array_equal(changed, before)
    np.testing.assert_array_equal(changed, mjrun.render(other, moved(other), "top", SIZE, visual=fog))


@pytest.mark.parametrize(
    ("setting", "is_infinite"), [("size", False), ("size", True), ("extent", True), ("texture", False)]
)
def test_changed_planes_and_materials_take_effect(setting: str, is_infinite: bool) -> None:
    textured = '<asset><texture name="t" type="2d" builtin="checker" width="8" height="8" rgb1="1 0 0"/>'
    textured += '<material name="m" texture="t"/></asset><worldbody>'
    text = XML.replace("<worldbody>", textured).replace('rgba=".3 .4 .5 1"', 'material="m"')
    model = mujoco.MjModel.from_xml_string(text.replace("2 2 .1", "0 0 .1") if is_infinite else text)
    camera = "free:azimuth=90,elevation=-30,distance=6"
    before = mjrun.render(model, moved(model), camera, SIZE)
    match setting:
        case "size":
            model.geom_size[0, :2] = 0.5
        case "extent":
            model.stat.extent *= 0.2
        case _:
            model.mat_texid[:] = -1
    changed = mjrun.render(model, moved(model), camera, SIZE)
    other = copy.copy(model)
    assert not np.array_equal(changed, before)
    np.testing.assert_array_equal(changed, mjrun.render(other, moved(other), camera, SIZE))


def test_cameras_of_earlier_calls_do_not_fill_the_memory(model: mujoco.MjModel) -> None:
    cameras = set[int]()
    for azimuth in range(3 * CACHED_CAMERAS):
        mjrun.render(model, moved(model), f"orbit:lookat=box,distance=2,azimuth={azimuth}", SIZE)
        gc.collect()
        cameras.add(sum(isinstance(each, BoundCameraScript) for each in gc.get_objects()))
    assert max(cameras) - min(cameras) <= CACHED_CAMERAS


@pytest.mark.parametrize("size", [SIZE, (16, 16)])
def test_a_fork_of_a_process_that_has_rendered_refuses_instead_of_hanging(
    model: mujoco.MjModel, size: tuple[int, int], tmp_path: Path
) -> None:
    mjrun.render(model, moved(model), size=SIZE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks of processes with threads
        child = os.fork()
    if child == 0:
        try:
            mjrun.render(model, moved(model), size=size)
        except DrawError as error:
            (tmp_path / "error").write_text(str(error))
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    assert "fork of one that has used OpenGL" in (tmp_path / "error").read_text()


def test_renderers_of_threads_that_have_ended_are_freed(model: mujoco.MjModel) -> None:
    """Threads that live at the same time have different numbers, so that none of them reuses the renderer of another.

    A renderer holds a reference to the model, and so does the caller.
    """
    image = mjrun.render(model, moved(model), "top", SIZE)
    references, images, together = sys.getrefcount(model), list[np.ndarray](), threading.Barrier(6)

    def work() -> None:
        data = moved(model)
        together.wait()
        images.append(mjrun.render(model, data, "top", SIZE))
        together.wait()

    for _ in range(2):
        threads = [threading.Thread(target=work) for _ in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    gc.collect()
    assert sys.getrefcount(model) <= references
    assert len(images) == 12
    assert all(np.array_equal(each, image) for each in images)


def test_what_is_not_there_is_refused(model: mujoco.MjModel) -> None:
    with pytest.raises(UnknownNameError, match="no camera 'tpo'") as caught:
        mjrun.render(model, moved(model), "tpo", SIZE)
    assert caught.value.path == ("camera",)
    with pytest.raises(UsageError, match="no view 'ids'\nviews: rgb, depth, seg"):
        mjrun.render(model, moved(model), "top", SIZE, "ids")


def test_nothing_is_printed_when_the_interpreter_ends() -> None:
    code = f"import mujoco, mjrun; m = mujoco.MjModel.from_xml_string({XML!r}); d = mujoco.MjData(m)"
    code += "; print(mjrun.render(m, d, 'top').shape, mjrun.render(m, d, 'top', (8, 8), 'depth').shape)"
    code += "; import mjrun.rendering.single_render as s; s.close_renderers()"
    code += "; [setattr(s, name, None) for name in [*vars(s)]]"  # which Python may do before it ends the thread
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout, done.stderr) == (0, "(480, 640, 3) (8, 8)\n", "")


@pytest.mark.parametrize("size", [3, None, (3,), (0, 4), (-1, 4), ("a", "b"), (1.5, 2), (8, 8, 8), "8x8"])
def test_sizes_are_two_positive_integers(model: mujoco.MjModel, size: object) -> None:
    with pytest.raises(BadValueError, match=r"^size: .* is not a width and a height in pixels"):
        mjrun.render(model, moved(model), size=size)  # type: ignore[arg-type]


def test_arguments_of_other_types_are_refused_by_name(model: mujoco.MjModel) -> None:
    data = moved(model)
    with pytest.raises(BadValueError, match=r"^model: 'box\.xml' is not an MjModel; mjrun\.load returns"):
        mjrun.render("box.xml", data)  # type: ignore[arg-type]
    with pytest.raises(BadValueError, match=r"^data: 'None' is not an MjData"):
        mjrun.render(model, None)  # type: ignore[arg-type]
    with pytest.raises(BadValueError, match=r"^visual: '3' is not an mjrun\.Visual"):
        mjrun.render(model, data, visual=3)  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"^no view '3'"):
        mjrun.render(model, data, view=3)  # type: ignore[arg-type]


def test_the_state_of_another_model_is_not_drawn_as_one_of_this(model: mujoco.MjModel) -> None:
    other = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>")
    with pytest.raises(UsageError, match=r"^data: it belongs to another model, with nq 0 instead of 7$"):
        mjrun.render(model, mujoco.MjData(other), size=SIZE)
    variant = copy.copy(model)
    assert np.array_equal(mjrun.render(variant, moved(model), size=SIZE), mjrun.render(model, moved(model), size=SIZE))
