"""Theorems about the line that is printed for each result."""

from dataclasses import replace

import pytest

from mjrun.cli.simulation_command import SUMMARIES, summary
from mjrun.outputs.export import ExportResult
from mjrun.outputs.image import ImageResult
from mjrun.outputs.keyframe import KeyframeResult
from mjrun.outputs.output import OutputResult
from mjrun.outputs.plot import PlotResult
from mjrun.outputs.recording import RecordingResult
from mjrun.outputs.trace import TraceResult
from mjrun.outputs.video import VideoResult
from mjrun.plotting.table_and_study_plot import TablePlotResult

VIDEO = VideoResult(
    path="a.mp4",
    paths=["a.mp4"],
    format="mp4",
    codec="h264",
    size=(64, 48),
    frames=30,
    fps=29.97,
    duration=1.001,
    simulated=1.0,
    steps=500,
    jobs=1,
    renderer="llvmpipe",
    gl="egl",
    software=True,
    simulation_wall=0.1,
    draw_wall=0.5,
    wall=0.75,
    warnings=[],
)
IMAGE = ImageResult(
    path="a.png",
    paths=["a.png"],
    format="png",
    size=(64, 48),
    time=0.1,
    step=50,
    clipped=0.0,
    renderer="llvmpipe",
    gl="egl",
    software=True,
    wall=0.25,
    warnings=[],
)
EXPORT = ExportResult(
    path="a.glb",
    format="glb",
    frames=30,
    fps=30.0,
    duration=1.0,
    simulated=1.0,
    steps=500,
    size=12_345,
    simulation_wall=0.01,
    wall=0.2,
    assertions=[],
    warnings=[],
)
TRACE = TraceResult(
    path="a.csv",
    format="csv",
    rows=501,
    columns=7,
    contacts=None,
    simulated=1.0,
    steps=500,
    wall=0.123,
    assertions=[],
    warnings=[],
)
PLOT = PlotResult(path="a.svg", size=(640, 480), samples=501, panels=["energy [J]"], curves=1, wall=0.1, warnings=[])
TABLES = TablePlotResult(
    path="a.svg",
    format="svg",
    size=(640, 480),
    tables=["a.csv", "b.csv"],
    rows=[10, 20],
    panels=["qpos [rad]", "energy [J]"],
    curves=3,
    notes=[],
)
RECORDING = RecordingResult(path="a.npz", states=501, size=20, simulated=1.0, wall=0.1, warnings=[])
KEYFRAME = KeyframeResult(path="a.xml", name="rest", time=1.0, step=500, wall=0.1, warnings=[])


@pytest.mark.parametrize(
    ("result", "line"),
    [
        (
            VIDEO,
            "a.mp4: 64x48, 30 frames, 1.001 s at 29.97 fps, h264; made in 0.8 s, 60 frames/s, by llvmpipe (egl)",
        ),
        (IMAGE, "a.png: 64x48 at 0.1 s; made in 0.2 s, by llvmpipe"),
        (TRACE, "a.csv: 501 rows, 7 columns, 1 s in 500 steps; made in 0.12 s"),
        (PLOT, "a.svg: 640x480, 501 samples"),
        (KEYFRAME, "a.xml: keyframe rest of step 500, 1 s"),
        (TABLES, "a.svg: 640x480, 3 curves in 2 panels, 30 rows"),
        (RECORDING, "a.npz: 501 states of 20 numbers, 1 s"),
        (EXPORT, "a.glb: glb, 30 frames, 1 s at 30 fps, 12.1 KiB; made in 0.2 s"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_result_is_one_line(result: OutputResult | TablePlotResult, line: str) -> None:
    assert summary(result) == line


def test_every_kind_of_result_has_its_line() -> None:
    kinds = (VideoResult, ImageResult, TraceResult, PlotResult, TablePlotResult, RecordingResult, KeyframeResult)
    assert set(SUMMARIES) == {kind.__name__ for kind in (*kinds, ExportResult)}


@pytest.mark.parametrize(("fps", "shown"), [(0.125, "0.125"), (29.97, "29.97"), (1000.4, "1000"), (10000.0, "10000")])
def test_a_rate_keeps_what_matters(fps: float, shown: str) -> None:
    assert f" at {shown} fps" in summary(replace(VIDEO, fps=fps))


def test_one_frame_is_no_plural_and_several_processes_are_named() -> None:
    line = summary(replace(VIDEO, frames=1, jobs=4))
    assert ", 1 frame, " in line
    assert line.endswith("by llvmpipe (egl) in 4 processes")


def test_names_from_files_and_drivers_are_cleaned() -> None:
    results = (
        replace(VIDEO, paths=["a\x1b[31m"], renderer="b\n"),
        replace(IMAGE, paths=["a\x1b[31m"], renderer="b\n"),
        *(replace(result, path="a\x1b[31m") for result in (TRACE, PLOT, RECORDING, KEYFRAME)),
    )
    assert not any("\x1b" in summary(result) or "\n" in summary(result) for result in results)


def test_an_image_on_standard_output_has_a_dash_for_a_path() -> None:
    assert summary(replace(IMAGE, path="-", paths=[])).startswith("-: 64x48")


def test_a_plot_without_curves_does_not_count_them() -> None:
    heat_map = TablePlotResult("a.png", "png", (640, 480), ["study"], [9], ["x"], 0, [])
    assert summary(heat_map) == "a.png: 640x480, 1 panel, 9 rows"
