"""What goes with pictures: calibration, point clouds, trails, ghosts and graphs of whole jobs."""

import json
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.camera.argument import parse_camera
from mjrun.camera.motion import CameraMotion
from mjrun.errors import MjrunError, MjrunWarning, UnknownNameError, UsageError
from mjrun.job.image import Image
from mjrun.job.scene_decorations import scene_decorations
from mjrun.job.simulation import Simulation
from mjrun.job.trace import Trace
from mjrun.job.video import Video
from mjrun.options.view import ViewOptions
from mjrun.rendering.backend import Backend
from mjrun.rendering.classic import ClassicRenderer
from mjrun.rendering.graph import graph_size
from mjrun.rendering.visual import Visual

pytestmark = pytest.mark.filterwarnings("ignore:drawing in software")

SIZE = (160, 120)


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
    (entry,) = json.loads((tmp_path / "c.json").read_text())["pictures"]
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


def test_a_film_s_calibration_is_what_its_frames_were_drawn_through(
    swing: Path, tmp_path: Path, backend: Backend
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
    entries = json.loads((tmp_path / "c.json").read_text())["pictures"]
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
    courses = [CameraMotion(parse_camera(text, model), model, (32, 24)) for text in ("side", orbit)]
    with ClassicRenderer(model, (32, 24), backend, Visual()) as renderer:
        for camera, course in enumerate(courses):
            for k, pose in enumerate(course.poses(states, times, times, [(0, 0.2)])):
                renderer.look(states[k])
                drawn = renderer.picture(pose, ["depth"]).calibration
                assert np.allclose(drawn.pose, entries[2 * k + camera]["world_from_camera"], atol=0)
                assert np.allclose(drawn.matrix, entries[2 * k + camera]["K"], atol=0)


def test_points_of_a_cloud_lie_on_what_was_seen(swing: Path, tmp_path: Path) -> None:
    cloud = tmp_path / "p.ply"
    Image(
        Simulation(swing), f"{tmp_path}/a.png", camera="side", size=SIZE, view=["rgb", "seg"], pointcloud=str(cloud)
    ).run()
    head, _, body = cloud.read_bytes().partition(b"end_header\n")
    count = int(next(line for line in head.splitlines() if line.startswith(b"element vertex")).split()[-1])
    kinds = [("xyz", "<f4", 3), ("rgb", "u1", 3), ("label", "<i4")]
    points = np.frombuffer(body, kinds)
    assert len(points) == count > 1000
    model = mujoco.MjModel.from_xml_path(str(swing))
    floor = points[points["label"] == 0]["xyz"]
    near = floor[np.linalg.norm(floor, axis=1) < 3]
    assert len(near) > 100
    assert abs(near[:, 2]).max() < 1e-3
    ball = points[points["label"] == model.geom("ball").id]
    assert np.linalg.norm(ball["xyz"] - [0.6, 0, 0.2], axis=1) == pytest.approx(np.full(len(ball), 0.1), rel=0.03)
    assert (ball["rgb"].argmax(axis=1) == 1).mean() > 0.9  # it is green


def test_a_trail_is_drawn_where_its_object_has_been(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, qvel={"ball/vx": -4})
    options = {"camera": "side", "size": SIZE, "time": 0.2, "calibration": f"{tmp_path}/c.json"}
    plain, trailed = tmp_path / "a.png", tmp_path / "b.png"
    Image(simulation, str(plain), **options).run()  # type: ignore[arg-type]
    Image(simulation, str(trailed), trail=["ball"], **options).run()  # type: ignore[arg-type]
    changed = (np.array(Pillow.open(plain)) != np.array(Pillow.open(trailed))).any(axis=2)
    rows, columns = np.nonzero(changed)
    (entry,) = json.loads((tmp_path / "c.json").read_text())["pictures"]
    stepper = simulation.stepper(simulation.load())
    path = []
    for step in range(101):
        stepper.advance(step)
        path.append([*stepper.instant().body("ball").xpos, 1])
    u, v, w = np.array(entry["K"]) @ (np.linalg.inv(entry["world_from_camera"]) @ np.array(path).T)[:3]
    assert len(rows) > 20
    away = np.hypot(columns[:, None] + 0.5 - u / w, rows[:, None] + 0.5 - v / w).min(axis=1)
    assert away.max() < 4
    assert changed[int(v[0] / w[0]), int(u[0] / w[0])]


def test_segmentation_and_depth_do_not_see_what_is_added(swing: Path, tmp_path: Path) -> None:
    for view in ("seg", "depth"):
        found = []
        for added in ({}, {"trail": ["ball"], "ghost": ["offset=0/0/.5"]}):
            Image(Simulation(swing), f"{tmp_path}/x.npy", view=view, time=0.2, size=SIZE, **added).run()  # type: ignore[arg-type]
            found.append(np.load(tmp_path / "x.npy"))
        assert np.array_equal(*found)


def test_a_ghost_can_stand_in_a_pose_and_move_as_a_trace_says(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>'
        '<keyframe><key name="up" qpos="1.5"/></keyframe></mujoco>'
    )
    Trace(Simulation(model, duration=0.5, qvel={"j": 2}), f"{tmp_path}/t.npz").run()
    found = scene_decorations(ViewOptions(ghost=[f"trace={tmp_path}/t.npz", "key=up,opacity=.5"]), model)
    trace = np.load(tmp_path / "t.npz")
    moving = found.ghosts[0].states(model, [0.0, 0.1001, 0.5, 9.0])
    standing = found.ghosts[1].states(model, [0.0])
    assert moving is not None
    assert standing is not None
    assert [state[1] for state in moving] == [trace["qpos/j"][k] for k in (0, 50, 250, 250)]
    assert standing[0][1] == 1.5
    assert found.ghosts[1].opacity == 0.5


@pytest.mark.parametrize(
    ("what", "kind", "said"),
    [
        ({"trail": ["bal"]}, UnknownNameError, "did you mean 'ball'"),
        ({"trail": ["ball"], "trail_span": 0}, UsageError, "not a positive number"),
        ({"ghost": ["colour=red"]}, UnknownNameError, "no setting 'colour' in ghost"),
        ({"ghost": ["offset=1/2"]}, UsageError, "a displacement x/y/z"),
        ({"ghost": ["opacity=2"]}, UsageError, "a number above 0 and up to 1"),
        ({"ghost": ["key=up"]}, UnknownNameError, "there are no keyframes"),
        ({"ghost": ["trace=no.csv"]}, MjrunError, "no such file"),
        ({"ghost": ["key=a,trace=b"]}, UsageError, "exclude each other"),
        ({"ghost": ["offset"]}, UsageError, "write offset=VALUE"),
        (
            {"calibration": "c.json", "calibration_format": "colmap"},
            UsageError,
            "'colmap' is not one of mjrun",
        ),
        ({"pointcloud": "c.obj"}, UsageError, "a point cloud is a PLY file"),
    ],
)
def test_what_cannot_be_added_is_refused(
    swing: Path, tmp_path: Path, what: dict[str, object], kind: type, said: str
) -> None:
    with pytest.raises(kind, match=said):
        Image(Simulation(swing), f"{tmp_path}/a.png", size=SIZE, **what).run()  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


@pytest.mark.parametrize("side", ["under", "beside"])
def test_graphs_stand_beside_the_film_and_leave_it_as_it_is(swing: Path, tmp_path: Path, side: str) -> None:
    simulation = Simulation(swing, duration=0.1)
    plots = ["energy", "qpos[hinge]"]
    Video(simulation, f"{tmp_path}/p/", size=SIZE).run()
    result = Video(simulation, f"{tmp_path}/g/", size=SIZE, plot=plots, plot_side=side).run()
    width, height = graph_size(SIZE, side)
    assert result.size == ((SIZE[0], SIZE[1] + 2 * height) if side == "under" else (SIZE[0] + 2 * width, SIZE[1]))
    for frame in sorted((tmp_path / "p").iterdir()):
        found = np.array(Pillow.open(tmp_path / "g" / frame.name))
        assert np.array_equal(found[: SIZE[1], : SIZE[0]], np.array(Pillow.open(frame)))


def test_a_plot_of_nothing_and_separate_plots_are_refused(swing: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="this model has none of it"):
        Video(Simulation(swing), f"{tmp_path}/a.mp4", plot=["act"], size=SIZE).run()
    with pytest.raises(UsageError, match="plot and separate exclude each other"):
        Video(Simulation(swing), f"{tmp_path}/a.mp4", plot=["energy"], separate=True)


def test_what_numbers_have_no_room_for_is_told(swing: Path, tmp_path: Path) -> None:
    simulation, heard = Simulation(swing, duration=0.1), r"text, captions, depth_range, plot: numbers have no"
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
    with pytest.warns(MjrunWarning, match=r"text: numbers have no room for it; style color draws pictures"):
        Image(simulation, f"{tmp_path}/d.png", size=(32, 24), view="depth", text="hi").run()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Image(simulation, f"{tmp_path}/e.png", size=(32, 24), view=["rgb", "depth"], separate=True, text="hi").run()
        Image(simulation, f"{tmp_path}/f.jpg", size=(32, 24), view="depth", text="hi").run()


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


def test_everything_that_a_film_wrote_is_in_its_result(swing: Path, tmp_path: Path) -> None:
    options = {"size": (32, 24), "calibration": f"{tmp_path}/c.json", "manifest": f"{tmp_path}/m.json"}
    views = {"view": ["rgb", "seg"], "separate": True}
    result = Video(Simulation(swing, duration=0.1), f"{tmp_path}/f.mkv", **options, **views).run()  # type: ignore[arg-type]
    written = {str(path) for path in tmp_path.iterdir()} - {str(swing), f"{tmp_path}/m.json"}
    assert sorted(result.paths) == sorted(written)
