"""Stills, against MuJoCo's own renderer and against videos of the same instant."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.errors import BadValueError, MjrunError, UnknownNameError, UsageError
from mjrun.outputs.image import Image
from mjrun.outputs.video import Video
from mjrun.rendering.compositor import layout_size, places
from mjrun.simulation.simulation import Simulation
from tests.conftest import instant

SIZE = (96, 64)
Still = Callable[..., np.ndarray]


def image(swing: Path, output: Path | str, **how: object) -> np.ndarray:
    """The pixels of a still that mjrun made."""
    Image(Simulation(swing), str(output), size=SIZE, **how).run()  # type: ignore[arg-type]
    return np.array(Pillow.open(output))


@pytest.mark.parametrize(
    ("when", "step"), [({}, 0), ({"time": 0.3}, 150), ({"step": 77}, 77), ({"time": "0.1009"}, 50)]
)
def test_a_still_is_the_instant_that_was_asked_for(
    swing: Path, tmp_path: Path, still: Still, when: dict[str, object], step: int
) -> None:
    found = image(swing, tmp_path / "a.png", camera="side", **when)
    assert np.array_equal(found, still(*instant(swing, step), SIZE, "side"))


def test_depth_is_that_of_mujoco_s_renderer(swing: Path, tmp_path: Path) -> None:
    Image(Simulation(swing), str(tmp_path / "d.npy"), size=SIZE, view="depth", camera="side", time=0.2).run()
    found = np.load(tmp_path / "d.npy")
    model, data = instant(swing, 100)
    model.vis.quality.offsamples = 0  # or its edges are averages
    model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
    with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
        renderer.enable_depth_rendering()
        renderer.update_scene(data, "side")
        expected = renderer.render()
    near = expected < 5
    assert near.mean() > 0.3
    assert found[near] == pytest.approx(expected[near], rel=1e-3)
    assert np.isinf(found).any()  # above the horizon


def test_ids_come_with_labels_that_say_what_they_are(swing: Path, tmp_path: Path) -> None:
    found = image(swing, tmp_path / "s.png", view="seg", camera="side")
    said = json.loads((tmp_path / "s.labels.json").read_text())
    names = {thing["id"]: thing["name"] for thing in said["labels"]}
    assert {names[value] for value in np.unique(found) if value} == {"floor", "box", "ball"}


def test_views_of_one_picture_stand_where_the_layout_says(swing: Path, tmp_path: Path) -> None:
    both = image(swing, tmp_path / "b.png", view=["rgb", "depth"], camera=["side", "free"], layout="grid", time=0.1)
    assert both.shape[1::-1] == layout_size(4, SIZE, "grid")
    alone = [
        image(swing, tmp_path / "one.png", view=view, camera=camera, style="color", time=0.1)
        for camera in ("side", "free")
        for view in ("rgb", "depth")
    ]
    for (x, y), part in zip(places(4, SIZE, "grid"), alone, strict=True):
        assert np.array_equal(both[y : y + SIZE[1], x : x + SIZE[0]], part)


@pytest.mark.filterwarnings("ignore:software rendering")
def test_a_still_is_a_frame_of_the_video(swing: Path, tmp_path: Path) -> None:
    options = {
        "size": SIZE,
        "view": ["rgb", "depth", "seg"],
        "depth_range": (0.5, 3.0),
        "captions": True,
        "camera": "side",
    }
    Video(Simulation(swing, duration=0.2), str(tmp_path / "f/"), fps=20, **options).run()  # type: ignore[arg-type]
    frames = sorted((tmp_path / "f").iterdir())
    for index, frame in enumerate(frames):
        output = tmp_path / f"{index}.png"
        Image(Simulation(swing), str(output), time=index / 20, legend=False, **options).run()  # type: ignore[arg-type]
        assert np.array_equal(np.array(Pillow.open(frame)), np.array(Pillow.open(output)))


def test_text_is_written_with_the_values_of_the_instant(swing: Path, tmp_path: Path) -> None:
    plain = image(swing, tmp_path / "p.png", time=0.1)
    texts = {
        text: image(swing, tmp_path / "t.png", time=0.1, text=text)
        for text in ("{time:.3f} s", "0.100 s", "{qpos/hinge:.6f}", "{qpos/ball/z:.3f}")
    }
    _, data = instant(swing, 50)
    assert not np.array_equal(texts["{time:.3f} s"], plain)
    assert np.array_equal(texts["{time:.3f} s"], texts["0.100 s"])
    assert np.array_equal(
        texts["{qpos/hinge:.6f}"], image(swing, tmp_path / "q.png", time=0.1, text=f"{data.qpos[0]:.6f}")
    )
    assert np.array_equal(
        texts["{qpos/ball/z:.3f}"], image(swing, tmp_path / "q.png", time=0.1, text=f"{data.qpos[3]:.3f}")
    )


@pytest.mark.parametrize(
    ("how", "kind", "said"),
    [
        ({"view": "colour"}, UsageError, "view: 'colour' is not one of rgb, depth, seg"),
        ({"view": ["rgb", "rgb"]}, UsageError, "view: give at least one"),
        ({"camera": ["side", "side"]}, UsageError, "camera: give at least one"),
        ({"camera": "sied"}, UnknownNameError, "did you mean 'side'"),
        ({"layout": "pile"}, UsageError, "layout: 'pile' is not one of row, column, grid"),
        ({"seg_by": "colour", "view": "seg"}, UnknownNameError, "no segmentation 'colour'"),
        ({"depth_range": (3, 1)}, BadValueError, "3..1"),
        ({"style": "exact", "view": ["rgb", "depth"]}, UsageError, "separate writes a file for each"),
        ({"time": 1, "step": 2}, UsageError, "exclude each other"),
        ({"time": "soon"}, BadValueError, "'soon' is not a number of at least 0"),
        ({"step": -1}, BadValueError, "at least 0"),
        ({"time": 1e300}, UsageError, r"time: more than 9e\+15 steps"),
        ({"step": 10**17}, UsageError, r"step: more than 9e\+15 steps"),
        ({"text": "{qpos/hing}"}, UnknownNameError, "no value 'qpos/hing'"),
        ({"text": "{time"}, UsageError, "text"),
        ({"text": "{time:.2q}"}, UsageError, "cannot format 'time'"),
        ({"size": (10**6, 8)}, MjrunError, "too large"),
        ({"pointcloud": "c.obj"}, UsageError, "a point cloud is a PLY file"),
    ],
)
def test_what_cannot_be_drawn_is_refused_and_leaves_nothing(
    swing: Path, tmp_path: Path, how: dict[str, object], kind: type, said: str
) -> None:
    with pytest.raises(kind, match=said):
        Image(Simulation(swing), str(tmp_path / "a.png"), **{"size": SIZE, **how}).run()  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def test_a_video_s_suffix_names_the_command_that_makes_videos(swing: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"is a video, .*\n`mjrun video` makes videos"):
        Image(Simulation(swing), f"{tmp_path}/a.mp4").run()


def test_points_of_a_cloud_lie_on_what_was_seen(swing: Path, tmp_path: Path) -> None:
    cloud = tmp_path / "p.ply"
    Image(
        Simulation(swing),
        f"{tmp_path}/a.png",
        camera="side",
        size=(160, 120),
        view=["rgb", "seg"],
        pointcloud=str(cloud),
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


def test_a_still_can_be_piped(mjrun, swing: Path, still: Still) -> None:  # type: ignore[no-untyped-def]
    done = mjrun("image", swing, "-o", "-", "--camera", "side", "--size", "96x64", "-t", ".1", "-q")
    assert (done.returncode, done.stderr) == (0, b"")
    assert np.array_equal(np.array(Pillow.open(io.BytesIO(done.stdout))), still(*instant(swing, 50), SIZE, "side"))
    assert mjrun.files() == []


def test_the_command_says_what_it_made(mjrun, swing: Path) -> None:  # type: ignore[no-untyped-def]
    done = mjrun("image", swing, "--view", "seg", "--size", "64x48", "--json", "--manifest", "m.json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["paths"] == ["swing.png", "swing.labels.json"]
    assert mjrun.files() == ["m.json", "swing.labels.json", "swing.png"]
    assert [output["path"] for output in json.loads((mjrun.folder / "m.json").read_text())["outputs"]] == found["paths"]
