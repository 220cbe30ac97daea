"""Panels of a drawing: how many, and in which file each stands."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import MjrunWarning, UsageError
from mjrun.options.view import ViewOptions
from mjrun.outputs.image import Image
from mjrun.outputs.panel_files import output_files, panel_files, panels_of
from mjrun.outputs.video import Video
from mjrun.rendering.compositor import Overlay, Panel
from mjrun.simulation.simulation import Simulation

pytestmark = pytest.mark.filterwarnings("ignore:drawing in software")

SIZE = (96, 64)


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


def test_everything_that_a_film_wrote_is_in_its_result(swing: Path, tmp_path: Path) -> None:
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
    expected = [Panel(camera, view) for camera in range(len(options.camera)) for view in options.view]
    assert [panel for file in files for panel in file.panels] == panels_of(options) == expected


def test_names_of_cameras_are_told_apart_by_number_where_they_are_alike() -> None:
    options = ViewOptions(camera=["a b", "a_b", "c"], separate=True)
    assert [file.path for file in panel_files(options, "x.png")] == ["x-a_b0.png", "x-a_b1.png", "x-c.png"]


@pytest.mark.parametrize(
    ("values", "exact"),
    [
        ({"view": "depth", "style": "exact"}, [True]),
        ({"view": "depth"}, [False]),
        ({"view": "rgb", "style": "exact"}, [False]),
        ({"view": ["rgb", "depth", "seg"], "style": "exact", "separate": True}, [False, True, True]),
    ],
)
def test_only_panels_of_numbers_are_exact(values: dict[str, object], exact: list[bool]) -> None:
    options = ViewOptions(**values)  # type: ignore[arg-type]
    files = panel_files(options, "v.mkv")
    assert [file.exact for file in files] == exact
    for file in files:
        stream = file.stream(options, Overlay(texts=["hello"]))
        assert stream.dtype == (np.uint16 if file.exact else np.uint8)
        assert bool(stream.style.overlay.texts) != file.exact


def test_numbers_cannot_share_a_frame_and_several_files_not_one_pipe() -> None:
    with pytest.raises(UsageError, match="style exact: numbers cannot share a picture; add separate for a file each"):
        panel_files(ViewOptions(view=["rgb", "depth"], style="exact"), "v.mkv")
    with pytest.raises(UsageError, match="separate makes several files; standard output is one"):
        panel_files(ViewOptions(view=["rgb", "depth"], separate=True), "-")


def test_every_file_of_a_drawing_is_listed_and_standard_output_is_none() -> None:
    options = ViewOptions(view=["rgb", "seg"], separate=True, calibration="c.json")
    assert output_files(options, "v.mkv", "m.json") == [
        ("output", "v-rgb.mkv"),
        ("output", "v-seg.mkv"),
        ("output", "v-seg.labels.json"),
        ("calibration", "c.json"),
        ("manifest", "m.json"),
    ]
    assert output_files(ViewOptions(), "-", None) == []
