"""A run document is the jobs that it says, exactly, or a list of what is wrong with it, line by line."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.camera.rigs.around import FreeRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, Event, Shot
from mjrun.camera.settings import EasedNumber
from mjrun.document import run
from mjrun.document.run import read_run
from mjrun.errors import DocumentError, FileError, UsageError, listing
from mjrun.options.run import RunCommandOptions
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.document.run_documents import HEAD, OUT, job, jobs, problems, simulation

MODEL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 .2"><freejoint name="ball"/><geom name="ball" size=".1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that relative paths mean, with one for outputs in it."""
    monkeypatch.chdir(tmp_path)
    Path("out").mkdir()
    return tmp_path


USUAL: dict[str, Any] = {"camera": ("auto",), "view": ("rgb",)}


# --- what is said ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", {}),
        ("integrator: rk4", {"integrator": "rk4"}),
        ("timestep: 1e-3", {"timestep": Fraction(1, 1000)}),
        ("timestep: 1/1000", {"timestep": Fraction(1, 1000)}),
        (
            "timestep: 0.002\nintegrator: euler\n"
            "set: {opt.gravity: [0, 0, -1.6], opt.cone: elliptic, geom/floor.friction: .1, opt.flag.contact: false,"
            " opt.iterations: 4}",
            {
                "set": (
                    ("opt.gravity", "0,0,-1.6"),
                    ("opt.cone", "elliptic"),
                    ("geom/floor.friction", "0.1"),
                    ("opt.flag.contact", "false"),
                    ("opt.iterations", "4"),
                ),
                "integrator": "euler",
                "timestep": Fraction(2, 1000),
            },
        ),
        ("key: spinning", {"key": "spinning"}),
        ("key: 2", {"key": 2}),
        ("qpos: {hip: 0.3, root: [0, 0, 1, 1, 0, 0, 0]}", {"qpos": {"hip": (0.3,), "root": (0, 0, 1, 1, 0, 0, 0)}}),
        ("qvel: {root/wx: 1}\nctrl: {'*': -2}", {"qvel": {"root/wx": (1,)}, "ctrl": {"*": (-2,)}}),
        ("ctrl_from: c.csv\nctrl_interpolation: linear", {"ctrl_from": "c.csv", "ctrl_interpolation": "linear"}),
        (
            "ctrl_noise: 1\nctrl_noise_time: .5\nperturb: 1e-3\nseed: 7",
            {"ctrl_noise": 1, "ctrl_noise_time": 0.5, "perturb": 0.001, "seed": 7},
        ),
        ("replay: run.npz", {"replay": "run.npz"}),
        ("duration: 0.3", {"duration": Fraction(3, 10)}),
        ("duration: 1/3", {"duration": Fraction(1, 3)}),
        ("steps: 1000", {"steps": 1000}),
    ],
)
def test_the_simulation_is_what_the_document_says(text: str, said: dict[str, Any]) -> None:
    assert job(f"{text}\nrecordings: [a.npz]").simulation == simulation(**said)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", {}),
        ("size: 1440x1024", {"size": (1440, 1024)}),
        ("size: [1440, 1024]", {"size": (1440, 1024)}),
        ("fps: 60\n  speed: 0.25", {"fps": 60, "speed": Fraction(1, 4)}),
        ("fps: 30000/1001\n  speed: '1/3'", {"fps": Fraction(30000, 1001), "speed": Fraction(1, 3)}),
        ("camera: top", {"camera": ("top",)}),
        ("camera: 0", {"camera": ("0",)}),
        ("camera: [top, 'orbit:lookat=box,distance=1']", {"camera": ("top", "orbit:lookat=box,distance=1")}),
        ("camera: {shots: [{camera: a}]}", {"camera": (CameraScript("script", [Shot(ModelRig("a"))]),)}),
        (
            "camera: [top, {name: b, speed: 0.5, shots: [{free: {azimuth: 3}}]}]",
            {"camera": ("top", CameraScript("b", [Shot(FreeRig(azimuth=EasedNumber(3, 3)), speed=Fraction(1, 2))]))},
        ),
        (
            "view: [rgb, seg]\n  layout: grid\n  captions: true",
            {"view": ("rgb", "seg"), "layout": "grid", "captions": True},
        ),
        ("view: depth\n  separate: true\n  style: exact", {"view": ("depth",), "separate": True, "style": "exact"}),
        ("depth_range: [0, 2.5]\n  seg_by: body", {"depth_range": (0, 2.5), "seg_by": "body"}),
        (
            "show: contactpoint\n  hide: [shadow, fog]\n  quality: high",
            {"show": ("contactpoint",), "hide": ("shadow", "fog"), "quality": "high"},
        ),
        (
            "geomgroup: [0, 1]\n  sitegroup: all\n  skingroup: none\n  frame_axes: body\n  label: geom",
            {"geomgroup": (0, 1), "sitegroup": range(6), "skingroup": (), "frame_axes": "body", "label": "geom"},
        ),
        ("trail: box\n  trail_span: 0.5", {"trail": ("box",), "trail_span": 0.5}),
        ("trail: [box, 'site:tip']", {"trail": ("box", "site:tip")}),
        ("ghost: offset=0/1/0,opacity=.3", {"ghost": ("offset=0/1/0,opacity=.3",)}),
        ("ghost: {offset: [0, 0.5, 0], opacity: 0.2, key: home}", {"ghost": ("offset=0/0.5/0,opacity=0.2,key=home",)}),
        ("ghost: [{trace: a.csv}, {recording: b.npz}, {}]", {"ghost": ("trace=a.csv", "recording=b.npz", "")}),
        ("text: '{time:.1f} s'\n  text_corner: bottom", {"text": "{time:.1f} s", "text_corner": "bottom"}),
        ("plot: energy\n  plot_side: beside", {"plot": ("energy",), "plot_side": "beside"}),
        ("plot: [energy, 'qpos[left_*],qvel']", {"plot": ("energy", "qpos[left_*],qvel")}),
        (
            "renderer: filament\n  jobs: 2\n  format: mp4\n  codec: av1\n  crf: 30\n  preset: 8",
            {"renderer": "filament", "jobs": 2, "format": "mp4", "codec": "av1", "crf": 30, "preset": "8"},
        ),
        ("jobs: auto\n  preset: fast", {"jobs": "auto", "preset": "fast"}),
        (
            "calibration: c.json\n  calibration_format: ros\n  manifest: m/a.json",
            {"calibration": "out/c.json", "calibration_format": "ros", "manifest": "out/m/a.json"},
        ),
    ],
)
def test_a_video_is_what_the_document_says(text: str, said: dict[str, Any]) -> None:
    assert job(f"videos:\n- output: a.mp4\n  {text}") == Video(simulation(), "out/a.mp4", **{**USUAL, **said})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", {}),
        ("time: 1.5", {"time": Fraction(3, 2)}),
        ("time: 0", {"time": 0}),
        ("time: 1/3", {"time": Fraction(1, 3)}),
        ("step: 10", {"step": 10}),
        ("time: {when: 'contact(ball, floor)'}", {"time": Event("contact(ball, floor)")}),
        (
            "time: {when: a > 1, nth: 2, offset: 0.1, else: end}",
            {"time": Event("a > 1", 2, Fraction(1, 10), "end")},
        ),
        ("legend: false\n  format: palette\n  view: seg", {"legend": False, "format": "palette", "view": ("seg",)}),
        ("pointcloud: a.ply\n  size: 64x48", {"pointcloud": "out/a.ply", "size": (64, 48)}),
    ],
)
def test_a_still_is_what_the_document_says(text: str, said: dict[str, Any]) -> None:
    assert job(f"images:\n- output: a.png\n  {text}") == Image(simulation(), "out/a.png", **{**USUAL, **said})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("traces: [{output: a.csv}]", Trace(simulation(), "out/a.csv")),
        (
            "traces: [{output: b/a, probe: 'qpos,xpos[a,b]', every: 2, format: csv}]",
            Trace(simulation(), "out/b/a", format="csv", probe="qpos,xpos[a,b]", every=2),
        ),
        (
            "traces: [{output: a.csv, probe: [qpos, energy], rate: 100, assert: a < 1, contacts: c.csv}]",
            Trace(
                simulation(), "out/a.csv", probe=("qpos", "energy"), rate=100, assert_=("a < 1",), contacts="out/c.csv"
            ),
        ),
        (
            "traces: [{output: a.csv, assert: [a < 1, b < 2], keep_partial: true, manifest: m.json}]",
            Trace(simulation(), "out/a.csv", assert_=("a < 1", "b < 2"), keep_partial=True, manifest="out/m.json"),
        ),
        ("plots: [{output: a.png, probe: energy}]", Plot(simulation(), "out/a.png", probe=("energy",))),
        (
            "plots: [{output: a.png, probe: [energy, 'qpos,qvel'], size: 640x480, rate: 50, format: png}]",
            Plot(
                simulation(), "out/a.png", probe=("energy", "qpos,qvel"), size=(640, 480), rate=50, format="png"
            ),
        ),
        ("recordings: [a.npz]", Recording(simulation(), "out/a.npz")),
        ("keyframes: [a.xml]", Keyframe(simulation(), "out/a.xml")),
        ("keyframes: [{output: a.xml, name: rest}]", Keyframe(simulation(), "out/a.xml", name="rest")),
        (
            "recordings: [{output: a.npz, manifest: m.json}]",
            Recording(simulation(), "out/a.npz", manifest="out/m.json"),
        ),
    ],
)  # fmt: skip
def test_a_trace_a_plot_and_a_recording_are_what_the_document_says(text: str, expected: object) -> None:
    assert job(text) == expected


def test_all_jobs_are_of_one_and_the_same_simulation_in_the_order_of_the_sections() -> None:
    text = HEAD + (
        "recordings: [r.npz]\nplots: [{output: p.png, probe: energy}]\ntraces: [{output: a.csv}, {output: b.csv}]\n"
        "images: [{output: s.png}]\nvideos: [{output: f.mp4}]\n"
    )
    found = jobs(text)
    assert [type(one) for one in found] == [Video, Image, Trace, Trace, Plot, Recording]
    assert all(one.simulation is found[0].simulation for one in found)


def test_the_example_in_the_module_is_a_document() -> None:
    example = (run.__doc__ or "").split("```yaml")[1].split("```")[0]
    film, still, trace, plot, exported = jobs(example)
    assert (film.speed, film.camera) == (Fraction(1, 4), ("top", "orbit:lookat=box,distance=1"))
    assert (still.time.when, trace.rate, plot.probe) == ("contact(domino_6, seesaw)", 100, ("energy",))
    assert exported.output == "out/dominos.glb"


# --- around the document -----------------------------------------------------------------------------


def test_files_that_are_read_are_relative_to_the_document_and_outputs_to_the_folder() -> None:
    Path("study/cameras").mkdir(parents=True)
    Path("study/cameras/fly.yaml").write_text("shots: [{camera: a}]")
    text = (
        "model: ../m.xml\nctrl_from: c.csv\n"
        "videos: [{output: a.mp4, camera: cameras/fly.yaml, ghost: ['opacity=.3,trace=g.csv', {recording: h.npz}]}]"
    )
    (film,) = jobs(text, name="study/d.yaml")
    assert film.simulation == Simulation("study/../m.xml", ctrl_from="study/c.csv")
    assert film.camera == (CameraScript("fly", [Shot(ModelRig("a"))]),)
    assert film.ghost == ("opacity=.3,trace=study/g.csv", "recording=study/h.npz")
    assert film.output == "out/a.mp4"
    assert (
        jobs("model: m.xml\nreplay: r.npz\nrecordings: [b.npz]", name="study/d.yaml")[0].simulation.replay
        == "study/r.npz"
    )


def test_absolute_inputs_stay_as_they_are() -> None:
    assert jobs("model: /models/m.xml\nrecordings: [a.npz]")[0].simulation.model == "/models/m.xml"


def test_settings_of_the_command_line_count_above_the_document() -> None:
    film = job(
        "duration: 3\nvideos: [{output: a.mp4, fps: 60}]",
        "videos[0].fps=10",
        "duration=1",
        "set.opt.cone=elliptic",
        "qpos.root/z=2",
    )
    assert (film.fps, film.simulation.duration) == (10, 1)
    assert film.simulation.set == (("opt.cone", "elliptic"),)
    assert film.simulation.qpos == {"root/z": (2,)}


def test_variables_and_defaults_make_the_same_jobs() -> None:
    Path("common.yaml").write_text(
        "vars: {fast: 240}\nmodel: m.xml\nduration: 2\nqpos: {a: 1}\nvideos: [{output: x.mp4}]"
    )
    text = "vars: {slow: 0.25, n: a}\ndefaults: common.yaml\nqpos: {b: 2}\nduration: 1/2\n"
    (film,) = jobs(text + 'videos: [{output: "${n}.mp4", speed: "${slow}", fps: "${fast}", text: "$${n}"}]')
    start = simulation(duration=Fraction(1, 2), qpos={"a": (1,), "b": (2,)})
    assert film == Video(start, "out/a.mp4", **USUAL, speed=Fraction(1, 4), fps=240, text="${n}")


def test_an_empty_list_takes_the_outputs_of_the_defaults_away() -> None:
    Path("common.yaml").write_text("model: m.xml\nvideos: [{output: x.mp4}]\nrecordings: [r.npz]")
    assert [type(one) for one in jobs("defaults: common.yaml\nvideos: []")] == [Recording]


def test_the_machine_says_who_drives_and_who_draws() -> None:
    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None: ...

    Path("d.yaml").write_text(
        HEAD + "videos: [{output: a.mp4, quality: high, jobs: 1}]\nimages: [{output: a.png}]\n"
        "traces: [{output: a.csv}]\nplots: [{output: p.png, probe: energy}]\nrecordings: [a.npz]"
    )
    options = RunCommandOptions(controller=act, control_dt=0.02, gl="egl", require_gpu=True, quality="draft", jobs=3)
    found = read_run("d.yaml", options=options, command="mjrun run d.yaml").outputs
    film, still = found[:2]
    assert isinstance(film, Video)
    assert isinstance(still, Image)
    assert film.simulation == simulation(controller=act, control_dt=Fraction(1, 50))
    assert film.quality == still.quality == "draft"
    assert (film.gl, film.require_gpu, still.gl, still.require_gpu) == ("egl", True, "egl", True)
    assert film.jobs == 3
    assert [one.command for one in found] == ["mjrun run d.yaml"] * 5


def test_what_the_machine_does_not_say_stays_as_the_document_says() -> None:
    film = job("videos: [{output: a.mp4, quality: high, jobs: 1}]")
    assert (film.quality, film.jobs, film.gl, film.require_gpu) == ("high", 1, None, False)


def test_folders_and_patterns_of_frames_stay_what_they_are() -> None:
    text = HEAD + "videos: [{output: frames/}, {output: more/}, {output: a/frame_%04d.png}]"
    assert [film.output for film in jobs(text)] == ["out/frames/", "out/more/", "out/a/frame_%04d.png"]


# --- what is wrong -----------------------------------------------------------------------------------

RUN_KEYS = f"keys: {listing([*run.RUN.keys, 'vars', 'defaults'])}"
NOTHING = "the document has no outputs; add one of videos, images, traces, plots, recordings, keyframes, exports"
SIZE = "expected width and height in pixels, as in 1280x720 or [1280, 720]"
SETTING = "expected a finite number, text, true or false, or a list of finite numbers"
TAIL = "recordings: [r.npz]\n"

WRONG = [
    ("{}", ["1:1: 'model' is missing", f"1:1: {NOTHING}"]),
    (f"# why\n{HEAD}videos: []", [f"2:1: {NOTHING}"]),
    (f"{HEAD}films: [a.mp4]", ["2:1: unknown key 'films': it was renamed to videos"]),
    (f"{HEAD}traces: run.csv", ["2:9: traces: expected a list, got 'run.csv'"]),
    (f"{HEAD}traces: [{{}}]", ["2:10: traces[0]: 'output' is missing"]),
    (f"model: 5\n{TAIL}", ["1:8: model: expected text, got 5; to write text, use quotes: '5'"]),
    (f"{HEAD}duraton: 3\n{TAIL}", [f"2:1: unknown key 'duraton' (did you mean 'duration'?); {RUN_KEYS}"]),
    (f"{HEAD}controller: policy.py:act\n{TAIL}", [f"2:1: unknown key 'controller'; {RUN_KEYS}"]),
    (f"{HEAD}duration: 0\n{TAIL}", ["2:11: duration: expected a positive number, got 0"]),
    (f"{HEAD}duration: soon\n{TAIL}", ["2:11: duration: expected a positive number, got 'soon'"]),
    (f"{HEAD}duration: 1/0\n{TAIL}", ["2:11: duration: expected a positive number, got '1/0'"]),
    (f"{HEAD}duration: true\n{TAIL}", ["2:11: duration: expected a positive number, got true"]),
    (f"{HEAD}duration: 1{'0' * 308}0\n{TAIL}",
     [f"2:11: duration: expected a positive number, got 1{'0' * 38}…"]),
    (f"{HEAD}duration: 1\nsteps: 10\n{TAIL}",
     ["3:8: steps: duration and steps exclude each other: both set the length"]),
    (f"{HEAD}steps: 1.5\n{TAIL}", ["2:8: steps: expected a whole number, got 1.5"]),
    (f"{HEAD}set: opt.gravity\n{TAIL}", ["2:6: set: expected a mapping, got 'opt.gravity'"]),
    (f"{HEAD}set: {{a: , b: [0, up], c: .inf, d: []}}\n{TAIL}",
     [f"2:9: set.a: {SETTING}, got nothing", f"2:15: set.b: {SETTING}, got a list",
      f"2:27: set.c: {SETTING}, got .inf", f"2:36: set.d: {SETTING}, got a list"]),
    (f"{HEAD}integrator: rk5\ntimestep: -1\n{TAIL}",
     ["2:13: integrator: expected 'euler', 'rk4', 'implicit', 'implicitfast' or 'discrete', got 'rk5'"
      " (did you mean 'rk4'?)", "3:11: timestep: expected a positive number, got -1"]),
    (f"{HEAD}key: -1\n{TAIL}", ["2:6: key: expected a number of at least 0, got -1"]),
    (f"{HEAD}key: [a]\n{TAIL}", ["2:6: key: expected the name or index of a keyframe, got a list"]),
    (f"{HEAD}qpos: {{hip: up, knee: [], toe: [1, x]}}\n{TAIL}",
     ["2:13: qpos.hip: expected a number or a list of numbers, which may have units: deg, rad, mm, cm, m, got 'up'",
      "2:23: qpos.knee: expected at least 1 item, got none",
      "2:36: qpos.toe[1]: expected a number, which may have units: deg, rad, mm, cm, m, got 'x'"]),
    (f"{HEAD}ctrl_interpolation: cubic\nctrl_noise: -1\nseed: -1\n{TAIL}",
     ["2:21: ctrl_interpolation: expected 'hold' or 'linear', got 'cubic'",
      "3:13: ctrl_noise: expected a number of at least 0, got -1",
      "4:7: seed: expected a number of at least 0, got -1"]),
    (f"{HEAD}replay: a.npz\nctrl_from: a.csv\nctrl_noise: 1\n{TAIL}",
     ["3:12: ctrl_from: replay and ctrl_from exclude each other: the replayed file drives the simulation",
      "4:13: ctrl_noise: replay and ctrl_noise exclude each other: a replay of states does not compute physics"]),
    (f"{HEAD}replay: a.npz\nreplay_mode: controls\nctrl_from: a.csv\nctrl_noise: 1\n{TAIL}",
     ["4:12: ctrl_from: replay and ctrl_from exclude each other: the replayed file drives the simulation"]),
    (f"{HEAD}replay: a.csv\nmap: {{qpos/hip: [a]}}\n{TAIL}",
     ["3:17: map.qpos/hip: expected an expression or a number, got a list"]),
    (f"{HEAD}replay: a.csv\nmap: [time]\n{TAIL}",
     ["3:6: map: 'time' is not COLUMN=EXPRESSION, as in qpos/knee=knee_deg*pi/180, or @FILE"]),
    (f"{HEAD}videos:\n- output: a.mp4\n  size: 640\n"
     f"- {{output: b.mp4, size: [640, 0]}}\n- {{output: c.mp4, size: 640x}}",
     [f"4:9: videos[0].size: {SIZE}, got 640", f"5:25: videos[1].size: {SIZE}, got a list",
      f"6:25: videos[2].size: {SIZE}, got '640x'"]),
    (f"{HEAD}videos:\n- output: a.mp4\n  fps: fast\n  speed: -1/2\n  crf: low\n  jobs: 0\n"
     "- {output: b.mp4, jobs: all}",
     ["4:8: videos[0].fps: expected a positive number, got 'fast'",
      "5:10: videos[0].speed: expected a positive number, got '-1/2'",
      "6:8: videos[0].crf: expected a whole number, got 'low'",
       "7:9: videos[0].jobs: expected a positive number, got 0",
      "8:25: videos[1].jobs: expected 'auto', got 'all'"]),
    (f"{HEAD}videos: [{{output: a.mp4, camera: {{shots: []}}}}]",
     ["2:42: videos[0].camera.shots: expected at least 1 item, got none"]),
    (f"{HEAD}videos: [{{output: a.mp4, camera: [top, {{shots: [{{track: {{}}}}]}}, true]}}]",
     ["2:57: videos[0].camera[1].shots[0].track: 'target' is missing",
      "2:64: videos[0].camera[2]: expected a camera as text, by index, or as {name, speed, shots}, got true"]),
    (f"{HEAD}videos: [{{output: a.mp4, camera: [top, top]}}, {{output: b.mp4, camera: []}}]",
     ["2:34: videos[0].camera: give at least one, and each only once",
      "2:71: videos[1].camera: give at least one, and each only once"]),
    (f"{HEAD}videos: [{{output: a.mp4, view: dept}}, {{output: b.mp4, view: [rgb, 5]}}]",
     ["2:32: videos[0].view: expected 'rgb', 'depth' or 'seg', got 'dept' (did you mean 'depth'?)",
      "2:67: videos[1].view[1]: expected 'rgb', 'depth' or 'seg', got 5"]),
    (f"{HEAD}videos: [{{output: a.mp4, layout: heap, style: 3}}]",
     ["2:34: videos[0].layout: expected 'row', 'column' or 'grid', got 'heap'",
      "2:47: videos[0].style: expected 'color' or 'exact', got 3"]),
    (f"{HEAD}videos: [{{output: a.mp4, depth_range: [1]}}]",
     ["2:39: videos[0].depth_range: expected 2 numbers, got 1"]),
    (f"{HEAD}videos: [{{output: a.mp4, depth_range: [2, 1]}}]",
     ["2:39: videos[0].depth_range: '2, 1' is not two depths in metres, the nearer first"]),
    (f"{HEAD}videos: [{{output: a.mp4, show: shadow, hide: [fog, shadow]}}]",
     ["2:32: videos[0].show: show and hide: 'shadow' is not to be in both"]),
    (f"{HEAD}videos: [{{output: a.mp4, geomgroup: [6], sitegroup: some, groups: {{geom: [1]}}}}]",
     ["2:38: videos[0].geomgroup[0]: expected a number of at most 5, got 6",
      "2:53: videos[0].sitegroup: expected 'all' or 'none', got 'some'",
      "2:59: videos[0]: unknown key 'groups': it was renamed to geomgroup, sitegroup, jointgroup, …"]),
    (f"{HEAD}videos: [{{output: a.mp4, frame_axes: bdy, label: 1}}]",
     ["2:38: videos[0].frame_axes: no frame 'bdy' (did you mean 'body'?); "
      "frames: none, body, geom, site, camera, light, contact, world",
      "2:50: videos[0].label: expected text, got 1; to write text, use quotes: '1'"]),
    (f"{HEAD}videos: [{{output: a.mp4, trail_span: 0, text: '', trail: [a, '']}}]",
     ["2:38: videos[0].trail_span: expected a positive number, got 0",
      "2:47: videos[0].text: expected text that is not empty, got ''",
      "2:62: videos[0].trail[1]: expected text that is not empty, got ''"]),
    (f"{HEAD}videos: [{{output: a.mp4, ghost: {{offset: [1, 2], opacity: 2}}}}]",
     ["2:42: videos[0].ghost.offset: expected 3 numbers, got 2",
      "2:59: videos[0].ghost.opacity: expected a number of at most 1, got 2"]),
    (f"{HEAD}videos: [{{output: a.mp4, ghost: [{{key: home, trace: a.csv}}, {{key: 'a,b'}}, 5]}}]",
     ["2:53: videos[0].ghost[0].trace: key and trace exclude each other: each sets the motion of the ghost",
      "2:67: videos[0].ghost[1].key: the keyframe and files of a ghost cannot contain a comma",
      "2:75: videos[0].ghost[2]: expected text as in offset=0/1/0,opacity=0.3 or "
      "{offset, opacity, key, trace, map, recording}, got 5"]),
    (f"{HEAD}videos: [{{output: a.mp4, plot: energy, separate: true, plot_side: over}}]",
     ["2:50: videos[0].separate: plot and separate exclude each other: separate views make several "
     "frames, and a plot belongs to one",
      "2:67: videos[0].plot_side: expected 'under' or 'beside', got 'over'"]),
    (f"{HEAD}videos: [{{output: a.mp4, quality: best, renderer: blender, calibration_format: cv}}]",
     ["2:35: videos[0].quality: expected 'draft', 'model' or 'high', got 'best'",
      "2:51: videos[0].renderer: expected 'classic' or 'filament', got 'blender'",
      "2:80: videos[0].calibration_format: expected 'mjrun', 'nerfstudio', 'bop' or 'ros', got 'cv'"]),
    (f"{HEAD}images: [{{output: a.png, time: 1, step: 5}}]",
     ["2:41: images[0].step: time and step exclude each other: both set the instant"]),
    (f"{HEAD}images: [{{output: a.png, time: -1}}, {{output: b.png, time: soon}}, {{output: c.png, time: {{nth: 1}}}}]",
     ["2:32: images[0].time: expected a number of at least 0, got -1",
      "2:59: images[1].time: expected a number of at least 0, got 'soon'", "2:88: images[2].time: 'when' is missing"]),
    (f"{HEAD}images: [{{output: a.png, time: [1]}}, {{output: d.png, step: -1, legend: no}}]",
     ["2:32: images[0].time: expected a time [s] or {when, nth, offset, else}, got a list",
      "2:60: images[1].step: expected a number of at least 0, got -1",
      "2:72: images[1].legend: expected true or false, got 'no'"]),
    (f"{HEAD}traces: [{{output: a.csv, every: 2, rate: 10}}, "
     "{output: b.csv, every: 0}, {output: c.csv, probes: q}]",
     ["2:42: traces[0].rate: every and rate exclude each other: both set the sampling rate",
      "2:70: traces[1].every: expected a positive number, got 0",
      "2:90: traces[2]: unknown key 'probes' (did you mean 'probe'?); "
      "keys: output, probe, assert, units, keep_partial, contacts, every, rate, format, manifest, golden, atol, rtol, "
      "tol"]),
    (f"{HEAD}plots: [{{probe: energy}}]", ["2:9: plots[0]: 'output' is missing"]),
    (f"{HEAD}recordings: [[a.npz]]", ["2:14: recordings[0]: expected a file, or a mapping with an output, got a list"]),
    (f"{HEAD}recordings: [{{}}]", ["2:14: recordings[0]: 'output' is missing"]),
    (f"{HEAD}vars: {{n: 2}}\nvideos: [{{output: a.mp4, fps: '${{m}}', crf: '${{n}}.5'}}]",
     ["3:31: videos[0].fps: no variable 'm'; vars: n", "3:44: videos[0].crf: expected a whole number, got '2.5'"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), WRONG)
def test_what_is_wrong_is_reported_at_its_line_and_column(text: str, lines: list[str]) -> None:
    assert problems(text) == lines


def test_a_page_is_inside_the_folder_of_outputs_is_called_one_and_is_no_other_output() -> None:
    for page, wrong in (
        ("../a.html", "leaves the folder of outputs"),
        ("a.png", "a file that ends with .html"),
    ):
        (message,) = problems(f"{HEAD}traces: [a.csv]\nhtml: {page}\n")
        assert message.startswith("3:7: html: ")
        assert wrong in message
    assert "clashes with html at d.yaml:2:7" in problems(f"{HEAD}html: a.html\nkeyframes: [a.html]\n")[0]


def test_visual_flags_that_there_are_not_are_reported_with_those_that_are_like_them() -> None:
    first, second = problems(f"{HEAD}videos: [{{output: a.mp4, show: contactpont, hide: [shadow, skybx]}}]")
    assert first.startswith("2:32: videos[0].show: no visual flag 'contactpont' (did you mean 'contactpoint' or ")
    assert second.startswith(
        "2:60: videos[0].hide[1]: no visual flag 'skybx' (did you mean 'skybox'?); visual flags: act"
    )


def test_what_is_wrong_in_a_setting_is_reported_at_the_setting() -> None:
    assert problems(f"{HEAD}videos: [{{output: a.mp4}}]", "videos[0].fps=fast", "duration=1", "steps=2") == [
        "videos[0].fps=fast: expected a positive number, got 'fast'",
        "steps=2: duration and steps exclude each other: both set the length",
    ]


def test_what_is_wrong_in_camera_documents_is_reported_after_what_is_wrong_here() -> None:
    Path("c.yaml").write_text("shots: [{track: {}}]")
    text = f"{HEAD}videos: [{{output: a.mp4, camera: c.yaml}}, {{output: b.mp4, camera: []}}]"
    assert problems(text) == [
        "2:67: videos[1].camera: give at least one, and each only once",
        "c.yaml:1:17: shots[0].track: 'target' is missing",
    ]


def test_a_camera_document_that_is_not_there_is_a_missing_file() -> None:
    with pytest.raises(FileError, match=r"^fly\.yaml: no such file"):
        jobs(f"{HEAD}videos: [{{output: a.mp4, camera: fly.yaml}}]")


def test_a_controller_and_a_table_of_controls_exclude_each_other() -> None:
    with pytest.raises(DocumentError, match=r"^d\.yaml:2:12: ctrl_from: controller and ctrl_from exclude each other"):
        job("ctrl_from: c.csv\nrecordings: [a.npz]", options=RunCommandOptions(controller=lambda model, data: None))


# --- done --------------------------------------------------------------------------------------------


def test_a_trace_a_plot_and_a_recording_are_made_in_one_pass() -> None:
    Path("m.xml").write_text(MODEL)
    text = HEAD + (
        "set: {opt.gravity: [0, 0, -2]}\ntimestep: 0.01\nqpos: {ball/z: 1}\nduration: 0.5\n"
        "traces: [{output: run.csv, probe: 'qpos/ball/z', rate: 10, assert: time < 1}]\n"
        "plots: [{output: fall.png, probe: [qpos/ball/z, energy], size: 160x200}]\nrecordings: [run.npz]\n"
    )
    trace, plot, kept = perform(jobs(text))
    table = np.genfromtxt("out/run.csv", delimiter=",", names=True)
    times = table["time"]
    assert np.allclose(times, np.arange(6) / 10, atol=0)
    # Semi-implicit Euler: after n steps of h the fall is g h² n (n + 1) / 2.
    steps = np.round(times / 0.01)
    assert np.allclose(table["qposballz"], 1 - 2 * 0.01**2 * steps * (steps + 1) / 2, atol=1e-12)
    assert (trace.rows, plot.size, kept.states) == (6, (160, 200), 51)
    assert sorted(path.name for path in Path("out").iterdir()) == ["fall.png", "run.csv", "run.npz"]


# --- what only the model can tell is wrong ----------------------------------------------------------

HINGED = """
<mujoco>
  <worldbody>
    <camera name="side" pos="0 -2 .8" xyaxes="1 0 0 0 .3 1"/>
    <body name="box"><joint name="hinge"/><geom size=".1"/></body>
  </worldbody>
</mujoco>
"""
BELOW = "model: m.xml\nduration: 0.1\n"


def found(text: str, *assignments: str) -> list[str]:
    """What is wrong, each cut after the name that is not there."""
    Path("m.xml").write_text(HINGED)
    Path("c.csv").write_text("time,ctrl/motr\n0,1\n")
    Path("d.yaml").write_text(BELOW + text)
    orders = read_run("d.yaml", assignments, OUT)
    with pytest.raises(DocumentError) as caught, orders.located():
        preview(orders.outputs)
    return [str(problem).removeprefix("d.yaml:").split(" (did")[0].split(";")[0] for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("videos: [{output: f.mp4, camera: sde}]", ["3:34: videos[0].camera: no camera 'sde'"]),
        ("videos: [{output: f.mp4, camera: [side, tp]}]", ["3:41: videos[0].camera[1]: no camera 'tp'"]),
        ("videos: [{output: f.mp4, camera: 'track:bx'}]", ["3:34: videos[0].camera: no object 'bx'"]),
        (
            "videos:\n- output: f.mp4\n  camera:\n    shots:\n    - orbit: {lookat: bx}",
            ["7:23: videos[0].camera.shots[0].orbit.lookat: no object 'bx'"],
        ),
        ("videos: [{output: f.mp4, trail: [box, bx]}]", ["3:39: videos[0].trail[1]: no object 'bx'"]),
        (
            "videos:\n- output: f.mp4\n  camera: {shots: [{free: , until: {when: speed(bx) > 1}}, {camera: side}]}",
            ["5:43: videos[0].camera.shots[0].until.when: no object 'bx'"],
        ),
        (
            "qpos: {hing: 1}\ntraces:\n- {output: t.csv, probe: [qpos, enrgy]}\n- {output: u.csv}",
            ["3:8: qpos.hing: no joint 'hing'", "5:33: traces[0].probe[1]: no probe 'enrgy'"],
        ),
        ("key: home\ntraces: [{output: t.csv}]", ["3:6: key: no keyframe 'home'"]),
        ("traces: [{output: t.csv, probe: ['qpos,energy', 'ctrl,enrgy']}]", ["3:49: traces[0].probe[1]: no probe"]),
        ("traces: [{output: t.csv, assert: [time < 1, bx < 1]}]", ["3:45: traces[0].assert[1]: no column 'bx'"]),
        ("qvel: {hing: 1}\nctrl: {motr: 1}\ntraces: [t.csv]", ["3:8: qvel.hing: no joint 'hing'"]),
        ("ctrl: {motr: 1}\ntraces: [t.csv]", ["3:8: ctrl.motr: no actuator 'motr'"]),
        ("qpos: {hinge: [1, 2]}\ntraces: [t.csv]", ["3:8: qpos.hinge: "]),
        ("set: {opt.cone: elliptic, opt.cne: elliptic}\ntraces: [t.csv]", ["3:27: set.opt.cne: "]),
        ("ctrl_from: c.csv\ntraces: [u.csv]", ["3:12: ctrl_from: no actuator 'motr'"]),
        ("videos: [{output: f.mp4, ghost: ['', 'key=home']}]", ["3:38: videos[0].ghost[1]: no keyframe 'home'"]),
        ("videos: [{output: f.mp4, ghost: {key: home}}]", ["3:33: videos[0].ghost: no keyframe 'home'"]),
        ("videos: [{output: f.mp4, text: '{qpos/bx}'}]", ["3:32: videos[0].text: no value 'qpos/bx'"]),
        ("videos: [{output: f.mp4, plot: [qpos, enrgy]}]", ["3:39: videos[0].plot[1]: no probe 'enrgy'"]),
        ("plots: [{output: p.png, probe: [qpos, enrgy]}]", ["3:39: plots[0].probe[1]: no probe 'enrgy'"]),
        ("images: [{output: i.png, time: {when: speed(bx) > 1}}]", ["3:39: images[0].time.when: no object 'bx'"]),
        ("videos: [{output: a.mp4, camera: sde}]\nimages: [{output: a.png, camera: sde}]",
         ["3:34: videos[0].camera: no camera 'sde'", "4:34: images[0].camera: no camera 'sde'"]),
    ],
)  # fmt: skip
def test_what_the_model_has_not_is_reported_where_the_document_names_it(
    folder: Path, text: str, lines: list[str]
) -> None:
    assert [line[: len(expected)] for line, expected in zip(found(text), lines, strict=True)] == lines


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("videos: [{output: top.mp4, camera: 'orbit:lookat=top'}]", ["3:36: videos[0].camera: no object 'top'"]),
        ("videos: [{output: tp.mp4, text: tp, camera: [side, tp]}]", ["3:52: videos[0].camera[1]: no camera 'tp'"]),
        ("traces: [{output: bx.csv, probe: ['xpos[box]', 'xpos[bx]']}]", ["3:48: traces[0].probe[1]: no object 'bx'"]),
        (
            "videos:\n- output: bx.mp4\n  trail: box\n  camera: {name: bx, shots: [{track: {target: bx}}]}",
            ["6:47: videos[0].camera.shots[0].track.target: no object 'bx'"],
        ),
        (
            "videos:\n- output: bx.mp4\n  camera:\n    shots:\n    - {look: {from: box, at: bx}, until: 1}\n"
            "    - path: {waypoints: [{eye: [0, 0, 1], lookat: box}, {eye: [0, 1, 1], lookat: bx}]}",
            ["7:30: videos[0].camera.shots[0].look.at: no object 'bx'"],
        ),
        (
            "videos:\n- output: bx.mp4\n  camera:\n    shots:\n"
            "    - path: {waypoints: [{eye: [0, 0, 1], lookat: box}, {eye: [0, 1, 1], lookat: bx}]}",
            ["7:82: videos[0].camera.shots[0].path.waypoints[1].lookat: no object 'bx'"],
        ),
        (
            "videos:\n- output: bx.mp4\n  camera: {name: bx, shots: [{free: , fit: {target: bx}}]}",
            ["5:53: videos[0].camera.shots[0].fit.target: no object 'bx'"],
        ),
    ],
)
def test_a_name_is_reported_at_its_option_although_it_also_occurs_elsewhere(text: str, lines: list[str]) -> None:
    assert [line[: len(expected)] for line, expected in zip(found(text), lines, strict=True)] == lines


def test_a_recording_that_is_too_short_is_reported_at_replay(folder: Path) -> None:
    Path("m.xml").write_text(HINGED)
    perform([Recording(Simulation("m.xml", steps=5), "r.npz")])
    (problem,) = found("replay: r.npz\ntraces: [u.csv]")
    assert problem.startswith("3:9: replay: ")


def test_what_the_command_line_set_is_reported_of_it(folder: Path) -> None:
    assert found("videos: [{output: f.mp4}]", "videos[0].camera=sde") == ["videos[0].camera=sde: no camera 'sde'"]


def test_what_goes_wrong_later_is_no_fault_of_the_document(folder: Path) -> None:
    Path("m.xml").write_text(HINGED)
    Path("d.yaml").write_text(BELOW + "traces: [{output: t.csv}]")
    with pytest.raises(UsageError, match="later"), read_run("d.yaml", [], OUT).located():
        raise UsageError("later")
