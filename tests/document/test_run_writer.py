"""The document printed for jobs or a camera script makes the same again, and says no more than it must."""

import dataclasses
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import mujoco
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mjrun.camera.rigs.around import OrbitRig, TrackRig
from mjrun.camera.rigs.path import PathRig, Waypoint
from mjrun.camera.script import CameraScript, ConditionEvent, FramedObject, Shot
from mjrun.camera.settings import EasedNumber, Shake, ShotBlend
from mjrun.document.camera_and_ghost_forms import DocumentCameraKind
from mjrun.document.run import read_run
from mjrun.document.run_writer import document_text, plain_value
from mjrun.document.yaml_text import yaml_text
from mjrun.errors import UsageError
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from mjrun.options.image import ImageOptions
from mjrun.options.kinds import CameraKind, ReadingContext
from mjrun.options.number_kinds import InstantKind
from mjrun.options.option import Options, requirements_of
from mjrun.options.video import VideoOptions
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.rendering.segmentation import groupings
from mjrun.rendering.text import CORNERS
from mjrun.rendering.visual import flags
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import rational
from tests.document.camera_strategies import events, maybe, names, numbers, positives, scripts, texts
from tests.document.documents import Anything, put, read


def again(jobs: Sequence[Any]) -> list[Any]:
    """The jobs of the document that is printed for `jobs`."""
    Path("d.yaml").write_text(document_text(jobs, "mjrun …\n"), encoding="utf-8")
    return read_run("d.yaml").outputs


# --- one form of what may be said in several ----------------------------------------------------------


def normal(value: Any, name: str = "") -> Any:
    """`value`, a job or a part of it, in one form: exact numbers, tuples, paths, one of something as a list of one."""
    if name in ("qpos", "qvel", "ctrl"):
        return {key: tuple(inner) if isinstance(inner, Sequence) else (inner,) for key, inner in value.items()}
    if isinstance(value, Simulation):
        source = value.source
        settings = [(override.path, override.value) for override in source.overrides]
        bare = dataclasses.replace(value, model=source.text, set=settings, integrator=None, timestep=None)
        return {field.name: normal(getattr(bare, field.name), field.name) for field in dataclasses.fields(bare)}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return type(value).__name__, {key: normal(inner, key) for key, inner in fields.items() if key != "command"}
    if name in ("duration", "fps", "speed", "rate", "time") and isinstance(value, float | str | Fraction | int):
        return rational(value)
    if name in ("camera", "view") and isinstance(value, str):
        return (value,)
    if name in ("ctrl_from", "replay") and value is not None:
        return str(value)
    if isinstance(value, dict):
        return {key: normal(inner) for key, inner in value.items()}
    return tuple(map(normal, value)) if isinstance(value, list | tuple) else value


# --- jobs, drawn by chance ---------------------------------------------------------------------------

exacts = (
    st.fractions(min_value=Fraction(1, 10**6), max_value=10**6)
    | positives
    | positives.map(repr)
    | st.sampled_from(["30000/1001", "1e2", Fraction(2**53 + 1), Fraction(1, 10)])
)


def several(strategy: st.SearchStrategy[Any], most: int = 3) -> st.SearchStrategy[Any]:
    return st.lists(strategy, max_size=most) | st.lists(strategy, max_size=most).map(tuple)


overrides = st.sampled_from(
    ["0,0,-1.6", ".1", "0.1", "true", "True", "elliptic", "1e-3", "4", " 5", "0,up", "1,,2", "0x10", "1.50", "~", "-0"]
)

PUSH = {"force": [1, 2.5, 0], "at": 1, "duration": "1/3"}


@st.composite
def sources(draw: st.DrawFn) -> Any:
    settings = draw(st.dictionaries(names, overrides | texts, max_size=4))
    source = FileSource(Path("m.xml"), overrides=tuple(Override(path, value) for path, value in settings.items()))
    return source if settings else draw(st.sampled_from([source, "m.xml", Path("m.xml")]))


@st.composite
def simulations(draw: st.DrawFn) -> Simulation:
    values = st.dictionaries(names, numbers | st.lists(numbers, min_size=1, max_size=7), max_size=3)
    start: dict[str, Any] = {
        "integrator": maybe(st.just("rk4")),
        "timestep": maybe(exacts),
        "key": maybe(names | st.integers(0, 9)),
        **dict.fromkeys(("qpos", "qvel", "ctrl"), values),
        "ctrl_from": maybe(texts | texts.map(Path)),
        "push": several(st.sampled_from(["torso=0/-1e2/.5@1/3+0.25", {**PUSH, "body": "a"}, {**PUSH, "site": "b"}])),
        "perturb": st.just(0.0) | positives,
        "ctrl_noise": st.just(0.0) | positives,
    }
    if draw(st.booleans()):
        start = {"replay": texts}
    span = draw(st.sampled_from(["duration", "steps", ""]))
    ends = {"duration": exacts, "steps": st.integers(1, 2**60)}
    return Simulation(
        draw(sources()),
        **{name: draw(strategy) for name, strategy in start.items()},
        **({span: draw(ends[span])} if span else {}),
        ctrl_interpolation=draw(st.sampled_from(["hold", "linear"])),
        ctrl_noise_time=draw(st.just(0.0) | positives),
        seed=draw(st.integers(0, 2**70)),
    )


plain = texts.filter(lambda text: Path(text).suffix.lower() not in (".yaml", ".yml"))
sizes = st.tuples(st.integers(1, 9000), st.integers(1, 9000))
groups = st.lists(st.integers(0, 5), max_size=6) | st.sampled_from(["all", "none"])
ghosts = st.sampled_from(["offset=0/1/0,opacity=.3", "key=home", "trace=a.csv", "", "offset=0/0/1,recording=r.npz"])
drawings: dict[str, st.SearchStrategy[Any]] = {
    "camera": st.just("free") | plain | st.lists(plain | scripts(), min_size=1, max_size=3, unique_by=str),
    "view": st.just("rgb") | st.lists(st.sampled_from(["rgb", "depth", "seg"]), min_size=1, max_size=3, unique=True),
    "size": sizes,
    "show": several(st.sampled_from(flags()[:10])),
    "hide": several(st.sampled_from(flags()[10:])),
    "geomgroup": groups,
    "skingroup": groups,
    "frame_axes": st.sampled_from(["none", "body", "mjFRAME_GEOM", "World"]),
    "label": st.sampled_from(["none", "joint", "mjLABEL_BODY"]),
    "quality": st.sampled_from(["model", "draft", "high"]),
    "layout": st.sampled_from(["row", "column", "grid"]),
    "captions": st.booleans(),
    "style": st.sampled_from([None, "color", "exact"]),
    "depth_range": maybe(st.tuples(st.floats(0, 1), st.floats(2, 3))),
    "seg_by": st.sampled_from([*groupings()]),
    "trail": several(texts),
    "trail_span": maybe(exacts),
    "ghost": several(ghosts),
    "text": maybe(texts),
    "text_corner": maybe(st.sampled_from([*CORNERS])),
    "calibration_format": st.sampled_from(["mjrun", "nerfstudio", "bop", "ros"]),
    "renderer": st.sampled_from(["classic", "filament"]),
}
videos = {
    **drawings,
    "fps": maybe(exacts),
    "speed": exacts,
    "format": maybe(texts),
    "codec": maybe(texts),
    "crf": maybe(st.integers(-5, 99)),
    "preset": maybe(texts),
    "plot": several(texts),
    "plot_side": st.sampled_from(["under", "beside"]),
    "jobs": st.just("auto") | st.integers(1, 99),
}
images = {**drawings, "format": maybe(texts), "legend": st.booleans(), "separate": st.booleans()}
probes = texts.filter(lambda text: "," not in text and text.strip())
sampled = {"format": maybe(texts)}
tables = {**sampled, "probe": several(probes), "assert_": several(texts), "keep_partial": st.booleans()}
graphs = {
    **sampled,
    "probe": st.lists(texts, min_size=1, max_size=3),
    "size": st.just((1280, 720)) | st.just((99, 999)),
}


@st.composite
def job_lists(draw: st.DrawFn) -> list[Any]:
    """Jobs of one simulation, in the order of a document's sections."""
    simulation, found = draw(simulations()), []
    folders = st.sampled_from(["", "a/", "b c/d/", "é: #/"])

    def file(suffix: str) -> str:
        return f"{draw(folders)}o{len(found)}{suffix}"

    def some(most: int = 2) -> range:
        return range(draw(st.integers(0, most)))

    def given_as(strategies: dict[str, st.SearchStrategy[Any]]) -> dict[str, Any]:
        return {name: draw(strategy) for name, strategy in strategies.items() if draw(st.booleans())}

    def drawing(cls: type[Options], strategies: dict[str, st.SearchStrategy[Any]], **files: Any) -> dict[str, Any]:
        options = given_as(strategies) | files
        if any(isinstance(options.get(name), list) and len(options[name]) > 1 for name in ("camera", "view")):
            options.pop("style", None)  # exact numbers share no frame
        for each in requirements_of(cls):
            if not each.is_met({name: value or None for name, value in options.items()}):
                options.pop(each.name, None)
        return options

    def when() -> dict[str, Any]:
        return draw(st.sampled_from([{}, {"every": draw(st.integers(1, 9))}, {"rate": draw(exacts)}]))

    for _ in some():
        files: dict[str, Any] = {"calibration": file(".c"), "manifest": file(".m")}
        suffix = draw(st.sampled_from([".mp4", "_%04d.png", "/"]))
        found.append(Video(simulation, file(suffix), **drawing(VideoOptions, videos, **files)))
    for _ in some():
        moments = maybe(exacts | events)
        instant: dict[str, Any] = draw(st.fixed_dictionaries({"time": moments}) | st.just({"step": 7}))
        cloud = draw(maybe(st.just(file(".ply"))))
        found.append(Image(simulation, file(".png"), **drawing(ImageOptions, images), **instant, pointcloud=cloud))
    for _ in some():
        contacts = draw(maybe(st.just(file("c.csv"))))
        found.append(Trace(simulation, file(".csv"), **given_as(tables), **when(), contacts=contacts))
    for _ in some():
        found.append(Plot(simulation, file(".p"), **{"probe": ["energy"], **given_as(graphs)}, **when()))
    for _ in some(1):
        manifest = draw(maybe(st.just(file(".n"))))
        found.append(Recording(simulation, file(".npz"), manifest=manifest, keep_partial=draw(st.booleans())))
    for _ in some(1):
        found.append(Keyframe(simulation, file(".xml"), name=draw(names), time=draw(maybe(exacts))))
    assume(found)
    return found


@pytest.mark.slow
@given(job_lists())
@settings(max_examples=15, deadline=None)
def test_the_printed_document_makes_the_same_jobs(jobs: list[Any]) -> None:
    assert [normal(job) for job in again(jobs)] == [normal(job) for job in jobs]


# --- what is printed ---------------------------------------------------------------------------------


def printed(*jobs: Any) -> str:
    """The document without the line of its model."""
    text = document_text(jobs)
    assert text.startswith("model: m.xml\n")
    return text.removeprefix("model: m.xml\n")


def start(**settings: Any) -> Simulation:
    return Simulation("m.xml", **settings)


def test_a_document_says_nothing_that_is_as_usual() -> None:
    simulation = start()
    assert document_text([Video(simulation, "a.mp4")], "mjrun video m.xml") == (
        "# mjrun video m.xml\nmodel: m.xml\nvideos: [a.mp4]\n"
    )
    assert printed(Image(simulation, "a.png")) == "images: [a.png]\n"
    assert printed(Trace(simulation, "a.csv")) == "traces: [a.csv]\n"
    assert printed(Plot(simulation, "a.png", probe=["energy"])) == "plots:\n- {output: a.png, probe: energy}\n"
    assert printed(Recording(simulation, "a.npz")) == "recordings: [a.npz]\n"
    assert printed(Recording(simulation, "a.npz", manifest="m.json")) == (
        "recordings:\n- {output: a.npz, manifest: m.json}\n"
    )


def test_lists_of_the_usual_are_as_usual_and_lists_of_one_are_that_one() -> None:
    assert printed(Video(start(), "a.mp4", camera=["auto"], view=("rgb",), trail=[], gl="egl", require_gpu=True)) == (
        "videos: [a.mp4]\n"
    )
    assert printed(Video(start(), "a.mp4", camera=["top"], view=["depth"])) == (
        "videos:\n- {output: a.mp4, camera: top, view: depth}\n"
    )


def test_the_document_reads_as_a_person_would_write_it() -> None:
    settings = {"opt.gravity": [0, 0, -1.6], "opt.cone": "elliptic", "opt.flag.contact": True}
    simulation = Simulation(
        "m.xml",
        set=settings,
        integrator="rk4",
        timestep=0.001,
        key="home",
        qpos={"hip": (0.3,), "root": [0, 0, 1.0]},
        duration=Fraction(3),
    )
    script = CameraScript(
        "fly",
        [
            Shot(
                OrbitRig("floor", EasedNumber(0.9, 0.9), EasedNumber(140, 240, "cosine"), EasedNumber(-30, -30)),
                until=ConditionEvent("speed(box) > 0.02", otherwise="end"),
                speed=Fraction(1, 4),
            ),
            Shot(
                TrackRig("box", EasedNumber(0.08, 0.08), heading=True),
                lasting=Fraction(1, 3),
                blend=ShotBlend("sigmoid", 0.3),
                fit=FramedObject("box"),
            ),
            Shot(PathRig([Waypoint((0, 0, 1)), Waypoint((1, 0, 1))], "box"), shake=Shake()),
        ],
    )
    film = Video(simulation, "a.mp4", camera=["top", script], fps=Fraction(30000, 1001), speed=Fraction(1, 4))
    still = Image(simulation, "a.png", show="joint", geomgroup=[0, 1], quality="high", time=ConditionEvent("a > 1", 2))
    assert (
        document_text([film, still])
        == """\
model: m.xml
key: home
qpos:
  hip: 0.3
  root: [0, 0, 1]
duration: 3
integrator: rk4
timestep: 0.001
set:
  opt.gravity: [0, 0, -1.6]
  opt.cone: elliptic
  opt.flag.contact: true
videos:
- output: a.mp4
  fps: 30000/1001
  speed: 0.25
  camera:
  - top
  - name: fly
    shots:
    - orbit:
        lookat: floor
        distance: 0.9
        azimuth: {from: 140, to: 240, ease: cosine}
        elevation: -30
      until: {when: speed(box) > 0.02, else: end}
      speed: 0.25
    - track: {target: box, distance: 0.08, heading: true}
      duration: 1/3
      blend: {shape: sigmoid, width: 0.3}
      fit: box
    - path:
        waypoints:
        - eye: [0, 0, 1]
        - eye: [1, 0, 1]
        lookat: box
      shake: {}
images:
- output: a.png
  time: {when: a > 1, nth: 2}
  show: joint
  geomgroup: [0, 1]
  quality: high
"""
    )


def test_the_command_is_a_comment_whatever_is_in_it() -> None:
    text = document_text([Recording(start(), "a.npz")], "mjrun \n\x1b[0m model: \u2028x")
    assert text.splitlines()[0] == r"# mjrun \n\x1b[0m model: \u2028x"
    assert text.splitlines()[1] == "model: m.xml"


# --- what no document says ---------------------------------------------------------------------------

XML = "<mujoco/>"


def overridden(*settings: Override) -> Any:
    return Recording(Simulation(FileSource(Path("m.xml"), overrides=settings)), "a.npz")


@pytest.mark.parametrize(
    ("job", "message"),
    [
        (
            Recording(start(controller=lambda model, data: None), "a.npz"),
            "controller: a document cannot contain code",
        ),
        (
            Recording(Simulation(mujoco.MjModel.from_xml_string(XML)), "a.npz"),
            "a document cannot contain a compiled model",
        ),
        (Trace(start()), "a document cannot write to standard output (-); give a path relative to a folder"),
        (Recording(start(), "/a.npz"), "'/a.npz' is not a path inside the folder of outputs; give a path relative"),
        (Recording(start(), "../a.npz"), "'../a.npz' leaves the folder of outputs"),
        (Trace(start(), "a.csv", contacts="/c.csv"), "'/c.csv' is not a path inside"),
        (Video(start(), "a.mp4", manifest="~/m.json"), "'~/m.json' is not a path inside"),
        (
            overridden(Override("opt.cone", "a"), Override("opt.cone", "b")),
            "opt.cone is set twice; a document can set it",
        ),
        (Recording(start(qpos={"a\nb": 1}), "a.npz"), r"'a\nb': a key in a document cannot contain control characters"),
        (
            Recording(start(qpos={"a": float("inf")}), "a.npz"),
            "a document cannot contain the number inf; numbers must be finite",
        ),
        (Recording(start(), "\udce9.npz"), r"'\udce9.npz' is not valid UTF-8, which a document requires"),
    ],
)
def test_what_no_document_can_say_is_refused(job: Any, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        document_text([job])
    assert str(caught.value).startswith(message)


def test_jobs_of_several_simulations_are_no_document() -> None:
    for jobs in ([], [Recording(start(), "a.npz"), Trace(start(), "a.csv")]):
        with pytest.raises(UsageError, match=r"^a run document requires outputs of a single simulation$"):
            document_text(jobs)


@pytest.mark.parametrize(
    "settings",
    [
        (Override("opt.integrator", "RK4", "integrator"),),
        (Override("opt.timestep", "1e-3", "timestep"),),
        (Override("opt.timestep", "0.001", "timestep"), Override("opt.cone", "elliptic")),
        (Override("opt.timestep", "0.001", "timestep"), Override("opt.integrator", "rk4", "integrator")),
    ],
)
def test_overrides_in_another_form_than_the_documents_own_keep_their_text_and_order(settings: Any) -> None:
    (job,) = again([overridden(*settings)])
    assert [(s.path, s.value) for s in job.simulation.source.overrides] == [(s.path, s.value) for s in settings]


@pytest.mark.slow
@given(scripts())
@settings(max_examples=15, deadline=None)
def test_a_script_is_read_back_as_it_was(script: CameraScript) -> None:
    written = read(put(yaml_text({"a": plain_value(CameraKind(), script)})), Anything).a
    assert DocumentCameraKind().read(written, ReadingContext()) == script


@given(events)
def test_an_event_says_what_is_not_the_default(event: ConditionEvent) -> None:
    document = cast("dict[str, object]", plain_value(InstantKind(), event))
    assert document["when"] == event.when
    assert ("nth" in document, "offset" in document, "else" in document) == (
        event.nth != 1,
        event.offset != 0,
        event.otherwise is not None,
    )
