"""Files of outputs: one for each panel, without clashes, with calibrations."""

import json
import warnings
from contextlib import closing
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.camera.script import parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import MjrunWarning, UsageError, spelled
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.camera_panels import CalibrationFile, output_files, panel_files, panels_of, unused_options
from mjrun.outputs.image import Image
from mjrun.outputs.output import ReservedFiles, named_files
from mjrun.outputs.perform import perform
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.compositor import CameraPanel, TextAndLivePlots
from mjrun.rendering.visual import Visual
from mjrun.simulation.simulation import Simulation
from tests.cases import cases

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")

SIZE = (160, 120)


def test_what_numbers_have_no_room_for_is_reported(swing: Path, tmp_path: Path) -> None:
    simulation, heard = Simulation(swing, duration=0.1), r"text, captions, depth_range, plot: ignored, since"
    with pytest.warns(MjrunWarning, match=heard):
        Video(
            simulation,
            f"{tmp_path}/d/",
            size=(32, 24),
            view="depth",
            style="exact",
            text="hi",
            captions=True,
            depth_range=(1, 2),
            plot=["energy"],
        ).run()
    with pytest.warns(MjrunWarning, match=r"text: ignored, since the output is numeric; style color renders colours"):
        Image(simulation, f"{tmp_path}/d.png", size=(32, 24), view="depth", text="hi").run()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Image(simulation, f"{tmp_path}/e.png", size=(32, 24), view=["rgb", "depth"], separate=True, text="hi").run()
        Image(simulation, f"{tmp_path}/f.jpg", size=(32, 24), view="depth", text="hi").run()


@pytest.mark.parametrize(
    ("values", "hidden"),
    [
        (
            {"view": "depth", "ghost": "offset=0/1/0", "trail": "box", "label": "body", "show": "joint,transparent"},
            "trail, ghost, label, show transparent: not shown in images of depth; view rgb shows everything",
        ),
        (
            {"view": ["seg", "depth"], "show": "joint", "frame_axes": "body", "renderer": "filament"},
            "frame_axes, show joint: not shown in images of segmentation and depth; view rgb shows everything",
        ),
        ({"view": "depth", "show": "joint", "frame_axes": "body"}, None),
        ({"view": ["rgb", "depth"], "ghost": "offset=0/1/0", "show": "transparent"}, None),
    ],
)
def test_what_only_colour_images_show_is_reported(values: dict[str, Any], hidden: str | None) -> None:
    assert [spelled(text) for text in unused_options(ViewOptions(**values))] == ([hidden] if hidden else [])


def test_an_image_and_a_video_warn_of_ghosts_that_they_do_not_show(swing: Path, tmp_path: Path) -> None:
    for make, output in ((Image, "d.npy"), (Video, "d.mkv")):
        with pytest.warns(MjrunWarning, match="ghost: not shown in images of depth; view rgb shows everything"):
            make(
                Simulation(swing, duration=0.1), f"{tmp_path}/{output}", size=SIZE, view="depth", ghost="opacity=1"
            ).run()


def test_everything_that_a_video_wrote_is_in_its_result(swing: Path, tmp_path: Path) -> None:
    options = {"size": (32, 24), "calibration": f"{tmp_path}/c.json", "manifest": f"{tmp_path}/m.json"}
    views = {"view": ["rgb", "seg"], "separate": True}
    result = Video(Simulation(swing, duration=0.1), f"{tmp_path}/f.mkv", **options, **views).run()  # type: ignore[arg-type]
    written = {str(path) for path in tmp_path.iterdir()} - {str(swing), f"{tmp_path}/m.json"}
    assert sorted(result.paths) == sorted(written)


def test_separate_views_are_files_of_their_own(swing: Path, tmp_path: Path) -> None:
    job = Image(
        Simulation(swing),
        str(tmp_path / "v.png"),
        size=SIZE,
        view=["rgb", "depth", "seg"],
        camera=["side", "free:azimuth=10"],
        separate=True,
    )
    result = job.run()
    assert sorted(path.name for path in tmp_path.glob("v*")) == [
        *(
            f"v-{camera}-{view}"
            for camera in ("free", "side")
            for view in ("depth.png", "rgb.png", "seg.labels.json", "seg.png")
        ),
    ]
    assert sorted(map(str, tmp_path.glob("v*"))) == sorted(result.paths)


CAMERAS = ["side", "free:azimuth=10", "free:azimuth=20"]


@pytest.mark.parametrize(
    ("values", "output", "paths"),
    [
        ({"camera": CAMERAS, "view": ["rgb", "depth"]}, "v.mp4", ["v.mp4"]),
        ({"camera": CAMERAS[:1], "separate": True}, "v.mp4", ["v.mp4"]),
        ({"camera": CAMERAS, "separate": True}, "a/v.mp4", ["a/v-side.mp4", "a/v-free1.mp4", "a/v-free2.mp4"]),
        ({"view": ["rgb", "depth"], "separate": True}, "v/", ["v-rgb/", "v-depth/"]),
        ({"view": ["rgb", "depth"], "separate": True}, "v", ["v-rgb/", "v-depth/"]),
        (
            {"camera": CAMERAS[:2], "view": ["rgb", "seg"], "separate": True},
            "v_%04d.png",
            ["v_%04d-side-rgb.png", "v_%04d-side-seg.png", "v_%04d-free-rgb.png", "v_%04d-free-seg.png"],
        ),
    ],
)
def test_separate_files_are_named_by_what_tells_them_apart(
    values: dict[str, object], output: str, paths: list[str]
) -> None:
    options = ViewOptions(**values)  # type: ignore[arg-type]
    files = panel_files(options, output)
    assert [file.path for file in files] == paths
    expected = [CameraPanel(camera, view) for camera in range(len(options.camera)) for view in options.view]
    assert [panel for file in files for panel in file.panels] == panels_of(options) == expected


def test_names_of_cameras_are_reported_apart_by_number_where_they_are_alike() -> None:
    options = ViewOptions(camera=["a b", "a_b", "c"], separate=True)
    assert [file.path for file in panel_files(options, "x.png")] == ["x-a_b0.png", "x-a_b1.png", "x-c.png"]
    names = ["free:azimuth=1", "free:azimuth=2", "free1"]
    files = [file.path for file in panel_files(ViewOptions(camera=names, separate=True), "x.png")]
    assert files == ["x-free_0.png", "x-free_1.png", "x-free1_2.png"]


@cases("values, exact")
def test_only_panels_of_numbers_are_exact(values: dict[str, object], exact: list[bool]) -> None:
    options = ViewOptions(**values)  # type: ignore[arg-type]
    files = panel_files(options, "v.mkv")
    assert [file.exact for file in files] == exact
    for file in files:
        spec = file.frame_spec(options, TextAndLivePlots(texts=["hello"]))
        assert spec.dtype == (np.uint16 if file.exact else np.uint8)
        assert bool(spec.composition.overlay.texts) != file.exact


def test_numbers_cannot_share_a_frame_and_several_files_not_one_pipe() -> None:
    with pytest.raises(UsageError, match="style exact: numbers cannot share an image; separate writes a file for each"):
        panel_files(ViewOptions(view=["rgb", "depth"], style="exact"), "v.mkv")
    with pytest.raises(UsageError, match="separate writes several files; standard output"):
        panel_files(ViewOptions(view=["rgb", "depth"], separate=True), "-")


def test_every_file_of_a_drawing_is_listed() -> None:
    options = ViewOptions(view=["rgb", "seg"], separate=True, calibration="c.json")
    assert output_files(options, "v.mkv", "m.json") == [
        ("output", "v-rgb.mkv"),
        ("output", "v-seg.mkv"),
        ("output", "v-seg.labels.json"),
        ("calibration", "c.json"),
        ("manifest", "m.json"),
    ]
    assert output_files(ViewOptions(), "-", None) == [("output", "-")]


def corners(model: mujoco.MjModel, data: mujoco.MjData, geom: str) -> np.ndarray:
    """The eight corners of a box in the world."""
    half, place = model.geom(geom).size, data.geom(geom)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return place.xpos + (signs * half) @ place.xmat.reshape(3, 3).T


@pytest.mark.parametrize("camera", ["side", "free:azimuth=35,elevation=-30,distance=2", "track:box,distance=1"])
def test_projected_corners_of_a_box_land_on_its_pixels(swing: Path, tmp_path: Path, camera: str) -> None:
    Image(
        Simulation(swing),
        f"{tmp_path}/s.npy",
        time=0.3,
        view="seg",
        camera=camera,
        size=SIZE,
        calibration=f"{tmp_path}/c.json",
    ).run()
    ids = np.load(tmp_path / "s.npy")
    labels = json.loads((tmp_path / "s.labels.json").read_text())["labels"]
    box = next(label["id"] for label in labels if label["name"] == "box" and label["type"] == "geom")
    (entry,) = json.loads((tmp_path / "c.json").read_text())["frames"]
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=150)
    mujoco.mj_forward(model, data)
    # The tutorial's camera matrix: K [R | t] on homogeneous points.
    local = np.linalg.inv(entry["world_from_camera"]) @ np.column_stack([corners(model, data, "box"), np.ones(8)]).T
    u, v, w = np.array(entry["K"]) @ local[:3]
    rows, columns = np.nonzero(ids == box)
    assert len(rows) > 100
    # A pixel belongs to the box if its centre, half a pixel in, does; a sharp corner may miss all centres.
    for pixels, edges in ((columns, u / w), (rows, v / w)):
        assert edges.min() - 0.01 < pixels.min() + 0.5 < edges.min() + 1.2
        assert edges.max() - 1.2 < pixels.max() + 0.5 < edges.max() + 0.01


def test_a_video_s_calibration_is_what_its_frames_were_drawn_through(
    swing: Path, tmp_path: Path, backend: WorkingBackend
) -> None:
    orbit = "orbit:lookat=box,azimuth=0..90,distance=1.5"
    video = Video(
        Simulation(swing, duration=0.2),
        f"{tmp_path}/f/",
        camera=["side", orbit],
        separate=True,
        fps=20,
        size=(32, 24),
        calibration=f"{tmp_path}/c.json",
    )
    video.run()
    entries = json.loads((tmp_path / "c.json").read_text())["frames"]
    assert [(entry["camera"], entry["frame"], entry["time"]) for entry in entries] == [
        (camera, k, k / 20) for k in range(4) for camera in ("side", orbit.partition(",")[0])
    ]
    assert all((tmp_path / entry["file"]).exists() for entry in entries)
    model = mujoco.MjModel.from_xml_path(str(swing))
    stepper = Simulation(swing).stepper(model)
    states = []
    for step in (0, 25, 50, 75):
        stepper.advance(step)
        states.append(stepper.state())
    times = [0, 0.05, 0.1, 0.15]
    courses = [BoundCameraScript(parse_camera(text, model), model, (32, 24)) for text in ("side", orbit)]
    with closing(ClassicRenderer(model, (32, 24), backend, Visual())) as renderer:
        for camera, course in enumerate(courses):
            for k, pose in enumerate(course.poses(states, times, times, [(0, 0.2)])):
                renderer.set_state(states[k])
                drawn = renderer.render(pose, ["depth"]).calibration
                assert np.allclose(drawn.pose, entries[2 * k + camera]["world_from_camera"], atol=0)
                assert np.allclose(drawn.matrix, entries[2 * k + camera]["K"], atol=0)


@pytest.mark.parametrize("make", [Image, Video])
def test_a_dataset_of_bop_has_depth_in_millimetres_or_none(swing: Path, tmp_path: Path, make: type) -> None:
    simulation = Simulation(swing, duration=0.1)
    output = f"{tmp_path}/d.png" if make is Image else f"{tmp_path}/d/"
    options = {"size": (32, 24), "calibration": f"{tmp_path}/c.json", "calibration_format": "bop"}
    views = {"view": ["rgb", "depth"], "separate": True}
    with pytest.raises(UsageError, match="its depth is in 16-bit PNGs of millimetres; set style to exact"):
        make(simulation, output, **options, **views, style="color").run()
    make(simulation, output, **options, **views, style="exact").run()
    assert json.loads((tmp_path / "c.json").read_text())["0"]["depth_scale"] == 1


def test_every_pixel_shows_what_mj_ray_meets_through_it(swing: Path, tmp_path: Path) -> None:
    options = {"size": (40, 30), "camera": "side", "calibration": f"{tmp_path}/c.json"}
    simulation = Simulation(swing)
    Image(simulation, f"{tmp_path}/v.npy", time=0.3, view=["seg", "depth"], separate=True, **options).run()  # type: ignore[arg-type]
    ids, depth = (np.load(tmp_path / f"v-{view}.npy") for view in ("seg", "depth"))
    entry = json.loads((tmp_path / "c.json").read_text())["frames"][0]
    matrix, world = np.array(entry["K"]), np.array(entry["world_from_camera"])
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=150)
    mujoco.mj_forward(model, data)

    hit = np.zeros(1, np.int32)
    alike, compared = 0, 0
    for row, column in np.ndindex(ids.shape):
        along = world[:3, :3] @ np.linalg.solve(matrix, [column + 0.5, row + 0.5, 1])  # at depth 1
        distance = mujoco.mj_ray(model, data, world[:3, 3], along, None, 1, -1, hit)
        inside = hit[0] >= 0 and distance < 5  # farther away, the drawn floor may end
        if inside and (ids[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] == ids[row, column]).all():
            compared += 1
            alike += ids[row, column] == hit[0] and depth[row, column] == pytest.approx(distance, rel=0.01)
    assert compared > 200
    assert alike == compared


def test_cameras_are_named_apart_in_calibrations(tmp_path: Path) -> None:
    model = tmp_path / "m.xml"
    cameras = "".join(f'<camera name="{name}" pos="0 0 {z}"/>' for name, z in (("top,left", 1), ("top,right", 2)))
    model.write_text(f'<mujoco><worldbody><geom name="box" size=".1"/>{cameras}</worldbody></mujoco>')
    orbits = ["orbit:lookat=box,distance=1", "orbit:lookat=box,distance=2"]
    chosen = ["top,left", "top,right", *orbits, "free:azimuth=10,elevation=0"]
    Image(
        Simulation(model),
        f"{tmp_path}/i.png",
        size=(32, 24),
        camera=chosen,
        calibration=f"{tmp_path}/c.json",
        stage="none",
    ).run()
    entries = json.loads((tmp_path / "c.json").read_text())["frames"]
    assert [entry["camera"] for entry in entries] == [*chosen[:4], "free:azimuth=10"]
    assert [entry["world_from_camera"][2][3] for entry in entries[:2]] == [1, 2]


@pytest.mark.parametrize(
    ("make", "name"),
    [(Image, "100%.png"), (Image, "a%03d.png"), (Video, "5%_%03d.png"), (Video, "50%%_%d.png"), (Video, "10%/")],
)
def test_a_calibration_names_the_files_that_are_written(swing: Path, tmp_path: Path, make: type, name: str) -> None:
    make(Simulation(swing, duration=0.1), f"{tmp_path}/{name}", size=(32, 24), calibration=f"{tmp_path}/c.json").run()
    entries = json.loads((tmp_path / "c.json").read_text())["frames"]
    written = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.glob("**/*.png"))
    assert [entry["file"] for entry in entries] == written


@cases("output, file")
def test_a_calibration_names_the_file_of_each_frame_as_seen_from_its_folder(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: str, file: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c").mkdir()
    model = mujoco.MjModel.from_xml_path(str(swing))
    options = ViewOptions(camera="side", calibration="c/c.json", size=(32, 24))
    motion = BoundCameraScript(parse_camera("side", model), model, (32, 24))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    (pose,) = motion.poses([Simulation(swing).stepper(model).state()], [0.0], [0.0], [(0, 1)])
    calibration = CalibrationFile(options, [motion], panel_files(options, output), numbers=False, is_numbered=True)
    with calibration.writer as writer:
        calibration.write([pose], 3, 0.25)
        writer.publish()
    (entry,) = json.loads((tmp_path / "c/c.json").read_text())["frames"]
    assert (entry["camera"], entry["frame"], entry["time"]) == ("side", 3, 0.25)
    assert (entry.get("file") or "") == file
    # The pose is MuJoCo's own, and its axes x right, y down, z forward.
    x, y, z = data.camera("side").xmat.reshape(3, 3).T
    expected = np.column_stack([x, -y, -z, data.camera("side").xpos])
    assert np.allclose(np.array(entry["world_from_camera"])[:3], expected, atol=1e-6)


def test_a_format_that_nobody_knows_is_refused(swing: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="'colmap' is not one of mjrun"):
        Image(Simulation(swing), f"{tmp_path}/a.png", calibration="c.json", calibration_format="colmap")


def test_no_file_is_written_twice_or_read_and_written(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1)
    at = f"{tmp_path}/"
    before = swing.read_bytes()
    for jobs, said in [
        ([Image(simulation, f"{at}a.json", view="seg", calibration=f"{at}a.json")], "a.json clashes with the output"),
        ([Image(simulation, f"{at}a.png", manifest=f"{at}a.png")], "a.png clashes with the output"),
        ([Image(simulation, f"{at}a.png", view="seg", calibration=f"{at}a.labels.json")], "a.labels.json clashes"),
        (
            [Image(simulation, f"{at}a.png", calibration=f"{at}c.json", manifest=f"{at}c.json")],
            "c.json clashes with the",
        ),
        (
            [Video(simulation, f"{at}a.mkv", view=["rgb", "seg"], separate=True, calibration=f"{at}a-seg.labels.json")],
            "a-seg.labels.json clashes with the output",
        ),
        (
            [Video(simulation, f"{at}f/", calibration=f"{at}f/transforms.json")],
            "transforms.json clashes with the output",
        ),
        ([Trace(simulation, f"{at}t.npz"), Recording(simulation, f"{at}t.npz")], "t.npz clashes with the output"),
    ]:
        with pytest.raises(UsageError, match=f"{said}.*; each output needs a separate file"):
            perform(jobs)
        assert [*tmp_path.iterdir()] == [swing]
    assert swing.read_bytes() == before


def test_files_that_are_not_asked_for_have_no_name() -> None:
    assert named_files(output="a", contacts=None, manifest="-") == [("output", "a"), ("manifest", "-")]


@cases("first, second")
def test_two_names_of_one_file_clash(tmp_path: Path, first: str, second: str) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    reserved = ReservedFiles()
    reserved.reserve(f"{tmp_path}/{first}", "the first")
    with pytest.raises(UsageError, match=r"clashes with the first; each output needs a separate file"):
        reserved.reserve(f"{tmp_path}/{second}", "the second")


@cases("paths")
def test_files_apart_do_not_clash(tmp_path: Path, paths: tuple[str, ...]) -> None:
    reserved = ReservedFiles()
    for path in paths:
        reserved.reserve(path if path == "-" else tmp_path / path, "another")


def test_a_file_may_be_read_under_two_names_but_is_not_written(swing: Path, tmp_path: Path) -> None:
    (tmp_path / "link.xml").symlink_to(swing)
    reserved = ReservedFiles()
    for path in (swing, tmp_path / "link.xml"):
        reserved.reserve_input(path, "the model, which is read")
    with pytest.raises(UsageError, match="clashes with the model"):
        reserved.reserve(tmp_path / "link.xml", "the output")
