"""A run document is the jobs that it says, exactly, or a list of what is wrong with it, line by line."""

from fractions import Fraction
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, ConditionEvent, Shot
from mjrun.document import run
from mjrun.document.run import read_run
from mjrun.errors import DocumentError, FileError, ModelNotFoundError, UsageError, listing
from mjrun.options.run import RunCommandOptions
from mjrun.outputs.image import Image
from mjrun.outputs.perform import perform
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.document.run_documents import HEAD, OUT, job, jobs, problems, simulation

MODEL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 .2"><freejoint name="ball"/><geom name="ball" size=".1"/></body>
  </worldbody>
</mujoco>
"""


CAMERA_A = [Shot(ModelRig("a"))]
still = partial(Image, simulation(), "out/a.png")
plot = partial(Plot, simulation(), "out/a.png")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that relative paths mean, with one for outputs in it."""
    monkeypatch.chdir(tmp_path)
    Path("out").mkdir()
    return tmp_path


# --- what is said; test_run_writer.py has every option in the form that Python writes, too --------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("recordings: [a.npz]", Recording(simulation(), "out/a.npz")),
        ("images:\n- {output: a.png, size: 1440x1024}", still(size=(1440, 1024))),
        ("plots:\n- {output: a.png, probe: energy, size: 640x480}", plot(probe=("energy",), size=(640, 480))),
        ("images:\n- {output: a.png, camera: 0}", still(camera=("0",))),
        ("images:\n- output: a.png\n  camera: {shots: [{camera: a}]}", still(camera=CameraScript("script", CAMERA_A))),
        (
            "images:\n- output: a.png\n  camera: [top, {name: b, speed: 0.5, shots: [{camera: a}]}]",
            still(camera=("top", CameraScript("b", [Shot(ModelRig("a"), speed=Fraction(1, 2))]))),
        ),
        (
            "images:\n- output: a.png\n  ghost: {offset: [0, 0.5, 0], opacity: 0.2, key: home}",
            still(ghost=("offset=0/0.5/0,opacity=0.2,key=home",)),
        ),
        (
            "images:\n- output: a.png\n  ghost: [{trace: a.csv}, {recording: b.npz}, {}]",
            still(ghost=("trace=a.csv", "recording=b.npz", "")),
        ),
        ("images:\n- {output: a.png, time: {when: 'contact(a, b)'}}", still(time=ConditionEvent("contact(a, b)"))),
        (
            "images:\n- {output: a.png, time: {when: a > 1, nth: 2, offset: 0.1, else: end}}",
            still(time=ConditionEvent("a > 1", 2, Fraction(1, 10), "end")),
        ),
    ],
)
def test_an_output_is_what_the_document_says(text: str, expected: object) -> None:
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
    assert film == Video(start, "out/a.mp4", speed=Fraction(1, 4), fps=240, text="${n}")


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


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("{}", ["1:1: 'model' is missing", f"1:1: {NOTHING}"]),
        (f"# why\n{HEAD}videos: []", [f"2:1: {NOTHING}"]),
        ("model: 5\nrecordings: [r.npz]", ["1:8: model: expected text, got 5; to write text, use quotes: '5'"]),
    ],
)
def test_a_document_has_a_model_and_outputs(text: str, lines: list[str]) -> None:
    assert problems(text) == lines


@cases("text, lines")
def test_what_is_wrong_is_reported_at_its_line_and_column(text: str, lines: list[str]) -> None:
    assert problems(HEAD + text) == [line.replace("{keys}", RUN_KEYS) for line in lines]


def test_a_number_beyond_all_is_quoted_in_part() -> None:
    lines = [f"2:11: duration: expected a positive number, got 1{'0' * 38}…"]
    assert problems(f"{HEAD}duration: 1{'0' * 308}0\nrecordings: [r.npz]") == lines


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


def test_an_unknown_key_is_suggested_where_an_output_of_the_document_accepts_it() -> None:
    text = f"{HEAD}videos: [{{output: a.mp4}}]\nimages: [a.png]\nexports: [{{output: a.html}}]"
    (message,) = problems(text, "fps=30")
    assert message.startswith("fps=30: unknown key 'fps' (did you mean 'videos[0].fps' or 'exports[0].fps'?); ")


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
    with pytest.raises(FileError, match=r"^d\.yaml:2:34: videos\[0\]\.camera: fly\.yaml: no such file"):
        jobs(f"{HEAD}videos: [{{output: a.mp4, camera: fly.yaml}}]")


def perform_document(path: str) -> None:
    request = read_run(path, [], OUT)
    with request.located():
        perform(request.outputs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model: no.xml\ntraces: [a.csv]", "d.yaml:1:8: model: no.xml: no such model file"),
        ("model: scene:no\ntraces: [a.csv]", "d.yaml:1:8: model: scene:no: no such scene"),
        ("model: m.xml\nctrl_from: no.csv\ntraces: [a.csv]", "d.yaml:2:12: ctrl_from: no.csv: no such file"),
        ("model: m.xml\nreplay: no.hdf5:demo_1\ntraces: [a.csv]", "d.yaml:2:9: replay: no.hdf5: no such file"),
        (
            "model: m.xml\ntraces: [{output: a.csv, golden: no.csv}]",
            "d.yaml:2:34: traces[0].golden: no.csv: the golden",
        ),
        (
            "model: m.xml\nimages: [{output: a.png, ghost: {trace: no.csv}}]",
            "d.yaml:2:41: images[0].ghost.trace: no.csv: no such file",
        ),
    ],
)
def test_a_missing_file_is_reported_at_the_line_that_names_it(text: str, message: str) -> None:
    Path("m.xml").write_text(MODEL)
    Path("d.yaml").write_text(text)
    with pytest.raises((FileError, ModelNotFoundError)) as caught:
        perform_document("d.yaml")
    assert str(caught.value).startswith(message)


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
    Path("g.csv").write_text("time,qpos/hinge\n0,0\n")
    Path("d.yaml").write_text(BELOW + text)
    orders = read_run("d.yaml", assignments, OUT)
    with pytest.raises(DocumentError) as caught, orders.located():
        perform(orders.outputs)
    return [str(problem).removeprefix("d.yaml:").split(" (did")[0].split(";")[0] for problem in caught.value.problems]


@cases("text, lines")
def test_what_the_model_has_not_is_reported_where_the_document_names_it(
    folder: Path, text: str, lines: list[str]
) -> None:
    assert [line[: len(expected)] for line, expected in zip(found(text), lines, strict=True)] == lines


@cases("text, lines")
def test_a_name_is_reported_at_its_option_although_it_also_occurs_elsewhere(text: str, lines: list[str]) -> None:
    assert [line[: len(expected)] for line, expected in zip(found(text), lines, strict=True)] == lines


def test_a_recording_that_is_too_short_is_reported_at_replay(folder: Path) -> None:
    Path("m.xml").write_text(HINGED)
    perform([Recording(Simulation("m.xml", steps=5), "r.npz")])
    (problem,) = found("replay: r.npz\ntraces: [u.csv]")
    assert problem.startswith("3:9: replay: ")


def test_an_expression_is_reported_in_one_line_without_a_caret(folder: Path) -> None:
    Path("m.xml").write_text(HINGED)
    Path("d.yaml").write_text(BELOW + "until: time\ntraces: [t.csv]")
    orders = read_run("d.yaml", [], OUT)
    with pytest.raises(DocumentError) as caught, orders.located():
        perform(orders.outputs)
    (problem,) = caught.value.problems
    assert str(problem) == (
        "d.yaml:3:8: until: until, character 1: found a number, expected a comparison (< <= > >= == !=)"
    )


def test_what_the_command_line_set_is_reported_of_it(folder: Path) -> None:
    assert found("videos: [{output: f.mp4}]", "videos[0].camera=sde") == ["videos[0].camera=sde: no camera 'sde'"]


def test_what_goes_wrong_later_is_no_fault_of_the_document(folder: Path) -> None:
    Path("m.xml").write_text(HINGED)
    Path("d.yaml").write_text(BELOW + "traces: [{output: t.csv}]")
    with pytest.raises(UsageError, match="later"), read_run("d.yaml", [], OUT).located():
        raise UsageError("later")
