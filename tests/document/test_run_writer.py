"""The document printed for jobs or a camera script makes the same again, and says no more than it must."""

import dataclasses
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, cast

import mujoco
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mjrun.camera.rigs.free_camera import OrbitRig, TrackRig
from mjrun.camera.rigs.path import PathRig, Waypoint
from mjrun.camera.rigs.rig import EasedNumber, Shake, ShotBlend
from mjrun.camera.script import CameraScript, ConditionEvent, FramedObject, Shot
from mjrun.document.camera_and_ghost_forms import DocumentCameraKind
from mjrun.document.json_schema import json_schema
from mjrun.document.run import OUTPUTS, read_run
from mjrun.document.run_writer import document_text, plain_value
from mjrun.document.yaml_text import yaml_text
from mjrun.errors import DocumentError, UsageError
from mjrun.model.override import Override
from mjrun.model.sources.file import FileSource
from mjrun.options.kinds import CameraKind, ReadingContext
from mjrun.options.number_kinds import InstantKind
from mjrun.options.run import RunCommandOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.outputs.image import Image
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.document.camera_strategies import events, names, scripts, texts
from tests.document.documents import Anything, put, read
from tests.document.option_strategies import in_python, in_quotes, options_in_documents
from tests.document.schema_oracle import fits

SCHEMA = json_schema("run")


def again(jobs: Sequence[Any]) -> list[Any]:
    """The jobs of the document that is printed for `jobs`."""
    Path("d.yaml").write_text(document_text(jobs, "mjrun …\n"), encoding="utf-8")
    return read_run("d.yaml").outputs


# --- all options, drawn by chance ---------------------------------------------------------------------

FILES = {
    "videos": "a.mp4",
    "images": "a.png",
    "traces": "a.csv",
    "plots": "a.png",
    "recordings": "a.npz",
    "keyframes": "a.xml",
    "exports": "a.glb",
}


def test_every_output_has_a_file_here() -> None:
    assert FILES.keys() == OUTPUTS.keys()


@pytest.mark.parametrize("key", FILES)
@given(data=st.data(), simulation=options_in_documents(SimulationOptions))
@settings(max_examples=20)
def test_a_document_fits_the_schema_and_makes_the_jobs_of_python_and_so_does_the_one_printed_for_them(
    key: str, data: st.DataObject, simulation: dict[str, Any]
) -> None:
    """An option that is wrong with others is refused by documents at once, by Python perhaps later."""
    cls, needed = OUTPUTS[key], {"probe": "energy"} if key == "plots" else {}
    outputs = [
        {"output": f"{number}/{FILES[key]}", **needed, **data.draw(options_in_documents(cls, f"{number}/"))}
        for number in range(2)
    ]
    document = {"model": "m.xml", **simulation, key: outputs}
    try:
        jobs = read_run(put(in_quotes(document)), options=RunCommandOptions(output="out")).outputs
    except DocumentError:
        assume(False)
    assert fits(document, SCHEMA, SCHEMA)
    shared = Simulation("m.xml", **in_python(SimulationOptions, simulation))
    make = resolve_name(f"mjrun.outputs.{key[:-1]}:{key[:-1].title()}")
    assert jobs == [make(shared, **in_python(cls, options, "out/")) for options in outputs]
    assert [dataclasses.replace(job, command="") for job in again(jobs)] == jobs


OVERRIDES = ["0,0,-1.6", ".1", "0.1", "true", "True", "elliptic", "1e-3", "4", " 5", "0,up", "1,,2", "0x10", "1.50"]


@given(st.dictionaries(names, st.sampled_from([*OVERRIDES, "~", "-0"]) | texts, max_size=4))
def test_overrides_keep_their_text(settings: dict[str, str]) -> None:
    (job,) = again([overridden(*(Override(path, value) for path, value in settings.items()))])
    assert [(each.path, each.value) for each in job.simulation.source.overrides] == [*settings.items()]


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
