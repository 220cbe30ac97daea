"""A camera document is the script that it says, exactly, or a list of what is wrong with it, line by line."""

from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.camera.rigs.around import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import CURVES, PathRig, Waypoint
from mjrun.camera.rigs.rig import Rig
from mjrun.camera.script import RIGS, CameraScript, Event, FramedObject, Shot
from mjrun.camera.settings import BLENDS, EASINGS, Blend, EasedNumber, Shake
from mjrun.document.camera_and_ghost_forms import read_camera
from mjrun.errors import DocumentError


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty folder that relative paths mean."""
    monkeypatch.chdir(tmp_path)


def script(text: str) -> CameraScript:
    Path("c.yaml").write_text(text)
    return read_camera("c.yaml")


def problems(text: str) -> list[str]:
    with pytest.raises(DocumentError) as caught:
        script(text)
    assert all(str(problem.place).startswith("c.yaml:") for problem in caught.value.problems)
    return [line.removeprefix("c.yaml:") for line in str(caught.value).splitlines()]


def test_shots_are_what_the_document_says() -> None:
    text = """
    speed: 0.25            # default of all shots
    shots:
      - orbit: {lookat: floor, distance: 0.9, azimuth: {from: 140, to: 240, ease: cosine}, elevation: -30}
        until: {when: speed(box) > 0.02}
      - track: {target: box, distance: 0.08, azimuth: 280, elevation: -10, heading: false, offset: [0,0,0]}
        blend: {shape: sigmoid, width: 0.3}
        speed: 0.5
        duration: 0.1
      - camera: top
    """
    still = EasedNumber.still
    assert script(text) == CameraScript(
        "c",
        [
            Shot(
                OrbitRig("floor", still(0.9), EasedNumber(140, 240, "cosine"), still(-30)),
                until=Event("speed(box) > 0.02"),
                speed=Fraction(1, 4),
            ),
            Shot(
                TrackRig("box", still(0.08), still(280), still(-10)),
                lasting=Fraction(1, 10),
                speed=Fraction(1, 2),
                blend=Blend("sigmoid", 0.3),
            ),
            Shot(ModelRig("top"), speed=Fraction(1, 4)),
        ],
    )


@pytest.mark.parametrize(
    ("text", "rig"),
    [
        ("camera: top", ModelRig("top")),
        ("camera: 2", ModelRig("2")),
        ("camera: '2'", ModelRig("2")),
        ("free:", FreeRig()),
        ("free: {}", FreeRig()),
        ("free: {lookat: [1, -.5, 2e-1]}", FreeRig((1.0, -0.5, 0.2))),
        ("free: {azimuth: 90}", FreeRig(azimuth=EasedNumber(90, 90))),
        ("orbit:", OrbitRig()),
        ("orbit: {ease: out}", OrbitRig(ease="out")),
        ("orbit: {elevation: -90}", OrbitRig(elevation=EasedNumber(-90, -90))),
        ("orbit: {lookat: geom:edge, azimuth: 0}", OrbitRig("geom:edge", azimuth=EasedNumber(0, 0))),
        ("orbit: {azimuth: {from: 0, to: 90}}", OrbitRig(azimuth=EasedNumber(0, 90, "linear"))),
        ("free: {distance: {from: 1, to: 2, ease: out}}", FreeRig(distance=EasedNumber(1, 2, "out"))),
        ("track: {target: box}", TrackRig("box")),
        (
            "track: {target: box, heading: true, offset: [0, 0, 1]}",
            TrackRig("box", heading=True, offset=(0.0, 0.0, 1.0)),
        ),
        ("look: {from: [0, 0, 1], at: box}", LookRig((0.0, 0.0, 1.0), "box")),
        ("look: {from: site:eye, at: [1, 2, 3]}", LookRig("site:eye", (1.0, 2.0, 3.0))),
        (
            "path: {waypoints: [{eye: [0, 0, 1]}, {eye: [1, 0, 1]}]}",
            PathRig([Waypoint((0.0, 0.0, 1.0)), Waypoint((1.0, 0.0, 1.0))]),
        ),
        (
            "path: {waypoints: [{eye: [0, 0, 1], lookat: box}, {eye: [1, 0, 1]}], lookat: [0, 0, 0], ease: in}",
            PathRig([Waypoint((0, 0, 1), lookat="box"), Waypoint((1, 0, 1))], lookat=(0, 0, 0), ease="in"),
        ),
        (
            "path:\n      curve: linear\n      pace: time\n      lookat: box\n      waypoints:\n"
            "        - {distance: 1, azimuth: 2, elevation: 3, at: 0}\n"
            "        - {distance: 4, azimuth: 5, elevation: 6, at: 1.5}\n",
            PathRig(
                [
                    Waypoint(distance=1, azimuth=2, elevation=3, at=0),
                    Waypoint(distance=4, azimuth=5, elevation=6, at=1.5),
                ],
                lookat="box",
                curve="linear",
                pace="time",
            ),
        ),
    ],
)
def test_a_rig_is_what_the_document_says(text: str, rig: Rig) -> None:
    assert script(f"shots:\n  - {text}") == CameraScript("c", [Shot(rig)])


@pytest.mark.parametrize(
    ("text", "shot"),
    [
        ("until: 2.5", Shot(ModelRig("a"), until=Fraction(5, 2))),
        ("until: 1/3", Shot(ModelRig("a"), until=Fraction(1, 3))),
        ("until: 1e-3", Shot(ModelRig("a"), until=Fraction(1, 1000))),
        ("duration: 0.3", Shot(ModelRig("a"), lasting=Fraction(3, 10))),
        ("speed: 0.1", Shot(ModelRig("a"), speed=Fraction(1, 10))),
        ("until: {when: 'ncon > 0'}", Shot(ModelRig("a"), until=Event("ncon > 0"))),
        (
            "until: {when: x < 1, nth: 2, offset: -0.1, else: 2.5}",
            Shot(ModelRig("a"), until=Event("x < 1", 2, Fraction(-1, 10), Fraction(5, 2))),
        ),
        ("until: {when: x < 1, else: end}", Shot(ModelRig("a"), until=Event("x < 1", otherwise="end"))),
        ("until: {when: x < 1, else: 0}", Shot(ModelRig("a"), until=Event("x < 1", otherwise=Fraction(0)))),
        ("roll: -5", Shot(ModelRig("a"), roll=EasedNumber(-5, -5))),
        ("roll: {from: 0, to: 360, ease: smoother}", Shot(ModelRig("a"), roll=EasedNumber(0, 360, "smoother"))),
        ("fovy: 45", Shot(ModelRig("a"), fovy=EasedNumber(45, 45))),
        ("fovy: {from: 45, to: 20}", Shot(ModelRig("a"), fovy=EasedNumber(45, 20))),
        ("shake:", Shot(ModelRig("a"), shake=Shake())),
        ("shake: {angle: 1, frequency: 3, seed: 7}", Shot(ModelRig("a"), shake=Shake(1, 3, 7))),
        ("fit: box", Shot(ModelRig("a"), fit=FramedObject("box"))),
        ("fit: {target: box, margin: 1.5}", Shot(ModelRig("a"), fit=FramedObject("box", 1.5))),
    ],
)
def test_a_shot_is_what_the_document_says(text: str, shot: Shot) -> None:
    assert script(f"shots:\n  - camera: a\n    {text}") == CameraScript("c", [shot])


@pytest.mark.parametrize(
    ("text", "blend"),
    [
        ("linear", Blend("linear")),
        ("0.2", Blend(width=0.2)),
        ("1", Blend(width=1)),
        ("{}", Blend()),
        ("{shape: smooth}", Blend("smooth")),
        ("{width: 0.1, shape: sigmoid}", Blend("sigmoid", 0.1)),
    ],
)
def test_a_blend_is_a_shape_a_width_or_both(text: str, blend: Blend) -> None:
    first, second = script(f"shots: [{{free: {{}}, duration: 1}}, {{free: {{}}, blend: {text}}}]").shots
    assert (first.blend, second.blend) == (None, blend)


def test_the_script_is_called_as_its_file_is() -> None:
    Path("flight 1.v2.yaml").write_text("shots: [{camera: a}]")
    assert read_camera(Path("flight 1.v2.yaml")).name == "flight 1.v2"


@given(st.floats(min_value=0, exclude_min=True, allow_infinity=False))
@settings(max_examples=50, deadline=None)
def test_times_are_the_decimal_numbers_that_are_written(time: float) -> None:
    shot = script(f"shots: [{{free: , until: {time!r}, speed: {time!r}}}]").shots[0]
    assert shot.until == shot.speed == Fraction(repr(time))


def test_easings_blends_curves_and_paces_are_those_that_the_camera_knows() -> None:
    for ease in EASINGS:
        assert script(f"shots: [{{camera: a, roll: {{from: 0, to: 1, ease: {ease}}}}}]").shots[0].roll.ease == ease
    for shape in BLENDS:
        shots = script(f"shots: [{{camera: a, until: 1}}, {{camera: b, blend: {shape}}}]").shots
        assert shots[1].blend == Blend(shape)
    for curve in CURVES:
        path = f"path: {{curve: {curve}, waypoints: [{{eye: [0, 0, 0]}}, {{eye: [1, 0, 0]}}]}}"
        expected = PathRig([Waypoint((0, 0, 0)), Waypoint((1, 0, 0))], curve=curve)
        assert script(f"shots: [{{{path}}}]").shots[0].rig == expected


# --- what is wrong -----------------------------------------------------------------------------------

SHOT_KEYS = "keys: auto, camera, free, look, orbit, path, track, until, duration, speed, blend, roll, fovy, shake, fit"
AROUND_KEYS = "keys: lookat, distance, azimuth, elevation"
TRACK = "target, distance, azimuth, elevation, heading, offset"
NUMBER_OR_RAMP = "expected a number or {from, to, ease}"
SHAPES = "expected 'cosine', 'linear', 'smooth' or 'sigmoid'"
EASES = "expected 'linear', 'cosine', 'smooth', 'smoother', 'in' or 'out'"
TO_SEE = "no point to look at: set lookat here or for the path"
AROUND = "expected eye, or distance, azimuth and elevation"

WRONG = [
    ("{}", ["1:1: 'shots' is missing"]),
    ("shots:", ["1:7: shots: expected a list, got nothing"]),
    ("shots: []", ["1:8: shots: expected at least 1 item, got none"]),
    ("shots: {free: }", ["1:8: shots: expected a list, got a mapping"]),
    ("shots: [free]", ["1:9: shots[0]: expected a mapping, got 'free'"]),
    ("shot: [{free: }]",
     ["1:1: 'shots' is missing", "1:1: unknown key 'shot' (did you mean 'shots'?); keys: speed, shots"]),
    ("speed: 0\nshots: [{free: }]", ["1:8: speed: expected a positive number, got 0"]),
    ("speed: 1/0\nshots: [{free: }]", ["1:8: speed: expected a positive number, got '1/0'"]),
    ("shots:\n- orbti:\n", [f"2:3: shots[0]: unknown key 'orbti' (did you mean 'orbit'?); {SHOT_KEYS}"]),
    ("shots:\n- speed: 1\n", ["2:3: shots[0]: expected one of auto, camera, free, look, orbit, path, track, got none"]),
    ("shots:\n- zoom: 1\n",
     ["2:3: shots[0]: expected one of auto, camera, free, look, orbit, path, track, got none",
      f"2:3: shots[0]: unknown key 'zoom'; {SHOT_KEYS}"]),
    ("shots:\n- free:\n  orbit:\n  camera: a\n",
     ["3:9: shots[0].orbit: a shot has only one rig; this one already has free",
      "4:11: shots[0].camera: a shot has only one rig; this one already has free"]),
    ("shots:\n- camera:\n", ["2:10: shots[0].camera: expected the name or index of a camera, got nothing"]),
    ("shots: [{camera: -1}]", ["1:18: shots[0].camera: expected a number of at least 0, got -1"]),
    ("shots: [{camera: 1.0}]", ["1:18: shots[0].camera: expected a whole number, got 1.0"]),
    ("shots: [{camera: ''}]", ["1:18: shots[0].camera: expected text that is not empty, got ''"]),
    ("shots: [{free: box}]",
     ["1:16: shots[0].free: expected a mapping with lookat, distance, azimuth, elevation, got 'box'"]),
    ("shots: [{free: {target: a}}]", [f"1:17: shots[0].free: unknown key 'target'; {AROUND_KEYS}"]),
    ("shots: [{orbit: {distanse: 2}}]",
     [f"1:18: shots[0].orbit: unknown key 'distanse' (did you mean 'distance'?); {AROUND_KEYS}, ease"]),
    ("shots: [{orbit: {distance: -2}}]", ["1:28: shots[0].orbit.distance: expected a positive number, got -2"]),
    ("shots: [{orbit: {distance: {from: 1, to: 0}}}]",
     ["1:42: shots[0].orbit.distance.to: expected a positive number, got 0"]),
    ("shots: [{orbit: {distance: 1m}}]", [f"1:28: shots[0].orbit.distance: {NUMBER_OR_RAMP}, got '1m'"]),
    ("shots: [{orbit: {azimuth: 140..240}}]", [f"1:27: shots[0].orbit.azimuth: {NUMBER_OR_RAMP}, got '140..240'"]),
    ("shots: [{orbit: {azimuth: [140, 240]}}]", [f"1:27: shots[0].orbit.azimuth: {NUMBER_OR_RAMP}, got a list"]),
    ("shots: [{orbit: {azimuth: {from: 1}}}]", ["1:27: shots[0].orbit.azimuth: 'to' is missing"]),
    ("shots: [{orbit: {azimuth: {from: 1, to: 2, ease: eas}}}]",
     [f"1:50: shots[0].orbit.azimuth.ease: {EASES}, got 'eas'"]),
    ("shots: [{orbit: {azimuth: 3, ease: out}}]",
     ["1:36: shots[0].orbit.ease: set the ease within azimuth: {from, to, ease}"]),
    ("shots: [{orbit: {ease: eas}}]",
     ["1:24: shots[0].orbit.ease: expected 'linear', 'cosine', 'smooth', 'smoother', 'in' or 'out', got 'eas'"]),
    ("shots: [{orbit: {elevation: .inf}}]", ["1:29: shots[0].orbit.elevation: expected a finite number, got .inf"]),
    ("shots: [{orbit: {elevation: true}}]", [f"1:29: shots[0].orbit.elevation: {NUMBER_OR_RAMP}, got true"]),
    ("shots: [{orbit: {lookat: 5}}]",
     ["1:26: shots[0].orbit.lookat: expected an object's name or a point [x, y, z], got 5"]),
    ("shots: [{orbit: {lookat: [1, 2]}}]", ["1:26: shots[0].orbit.lookat: expected 3 numbers, got 2"]),
    ("shots: [{orbit: {lookat: []}}]", ["1:26: shots[0].orbit.lookat: expected 3 numbers, got none"]),
    ("shots: [{orbit: {lookat: [1, x, .nan]}}]",
     ["1:30: shots[0].orbit.lookat[1]: expected a number, got 'x'",
      "1:33: shots[0].orbit.lookat[2]: expected a finite number, got .nan"]),
    ("shots: [{track: {distance: 1}}]", ["1:17: shots[0].track: 'target' is missing"]),
    ("shots: [{track: }]",
     [f"1:16: shots[0].track: expected a mapping with {TRACK}, got nothing"]),
    ("shots: [{track: {target: 5}}]",
     ["1:26: shots[0].track.target: expected text, got 5; to write text, use quotes: '5'"]),
    ("shots: [{track: {target: a, heading: yes}}]",
     ["1:38: shots[0].track.heading: expected true or false, got 'yes'"]),
    ("shots: [{track: {target: a, offset: 1}}]", ["1:37: shots[0].track.offset: expected a list, got 1"]),
    ("shots: [{track: {target: a, offset: [1, 2, 3, 4]}}]", ["1:37: shots[0].track.offset: expected 3 numbers, got 4"]),
    ("shots: [{look: {at: box}}]", ["1:16: shots[0].look: 'from' is missing"]),
    ("shots: [{look: {eye: box, at: box}}]",
     ["1:16: shots[0].look: 'from' is missing", "1:17: shots[0].look: unknown key 'eye'; keys: from, at"]),
    ("shots: [{path: {}}]", ["1:16: shots[0].path: 'waypoints' is missing"]),
    ("shots: [{path: {waypoints: [{eye: [0, 0, 0]}]}}]",
     ["1:28: shots[0].path.waypoints: expected at least 2 items, got 1"]),
    ("shots: [{path: {waypoints: [{eye: [0, 0, 0]}, {}]}}]",
     [f"1:47: shots[0].path.waypoints[1]: {AROUND}, got none of them"]),
    ("shots: [{path: {waypoints: [{eye: [0, 0, 0]}, {distance: 1, azimuth: 1, elevation: 1}], lookat: a}}]",
     ["1:47: shots[0].path.waypoints[1]: either all waypoints have an eye, or all distance, azimuth and elevation"]),
    ("shots: [{path: {waypoints: [{distance: 1, azimuth: 1}, {distance: 0, azimuth: 1, elevation: 1}], lookat: a}}]",
     [f"1:29: shots[0].path.waypoints[0]: {AROUND}, got distance and azimuth",
      "1:67: shots[0].path.waypoints[1].distance: expected a positive number, got 0"]),
    ("shots: [{path: {waypoints: [{eye: [0, 0, 0], azimuth: 1}, {eye: [0, 0, 1]}]}}]",
     ["1:55: shots[0].path.waypoints[0].azimuth: a waypoint with an eye has no azimuth"]),
    ("shots: [{path: {waypoints: [{eye: [0, 0, 0], lookat: a}, {eye: [0, 0, 1]}]}}]",
     [f"1:58: shots[0].path.waypoints[1]: {TO_SEE}"]),
    ("shots: [{path: {waypoints: [{distance: 1, azimuth: 1, elevation: 1}, {distance: 1, azimuth: 2, elevation: 1}]}}]",
     [f"1:29: shots[0].path.waypoints[0]: {TO_SEE}", f"1:70: shots[0].path.waypoints[1]: {TO_SEE}"]),
    ("shots: [{path: {waypoints: [{eye: [0, 0, 0], at: 1}, {eye: [0, 0, 1]}]}}]",
     ["1:50: shots[0].path.waypoints[0].at: at needs pace: time"]),
    ("shots: [{path: {pace: time, waypoints: [{eye: [0, 0, 0], at: 0}, {eye: [0, 0, 1]}]}}]",
     ["1:66: shots[0].path.waypoints[1]: with pace: time each waypoint needs its at [s]"]),
    ("shots: [{path: {pace: time, waypoints: [{eye: [0, 0, 0], at: 1}, {eye: [0, 0, 1], at: 1}], ease: in}}]",
     ["1:87: shots[0].path.waypoints[1].at: expected a time later than 1, that of the previous waypoint",
      "1:98: shots[0].path.ease: ease requires pace: constant; with pace: time the waypoints set the times"]),
    ("shots: [{path: {curve: bezier, pace: tim, waypoints: [{eye: [0, 0, 0]}, {eye: [0, 0, 1]}]}}]",
     ["1:24: shots[0].path.curve: expected 'spline' or 'linear', got 'bezier'",
      "1:38: shots[0].path.pace: expected 'constant' or 'time', got 'tim' (did you mean 'time'?)"]),
    ("shots: [{free: , until: 0}]", ["1:25: shots[0].until: expected a positive number, got 0"]),
    ("shots: [{free: , until: end}]",
     ["1:25: shots[0].until: expected a positive number, got 'end'"]),
    ("shots: [{free: , until: {nth: 1}}]", ["1:25: shots[0].until: 'when' is missing"]),
    ("shots: [{free: , until: {when: a, nth: 0, offset: 'a', else: never}}]",
     ["1:40: shots[0].until.nth: expected a positive number, got 0",
      "1:51: shots[0].until.offset: expected a number, got 'a'",
      "1:62: shots[0].until.else: expected a time [s] of at least 0, or end, got 'never'"]),
    ("shots: [{free: , until: {when: a, nth: true, else: -1}}]",
     ["1:40: shots[0].until.nth: expected a whole number, got true",
      "1:52: shots[0].until.else: expected a time [s] of at least 0, or end, got -1"]),
    ("shots:\n- free:\n  until: 2\n  duration: 1\n",
     ["4:13: shots[0].duration: a shot ends by until or after a duration, not both"]),
    ("shots:\n- free:\n- free:\n",
     ["2:3: shots[0]: the end of this shot is missing: all shots but the last need until or duration"]),
    ("shots:\n- {free: , until: 2}\n- {free: , until: 1}\n- {free: , duration: 1}\n- {free: , until: 3}\n",
     ["3:19: shots[1].until: expected a time later than 2, when the shot begins",
      "5:19: shots[3].until: expected a time later than 3, when the shot begins"]),
    ("shots: [{free: , duration: -1}]", ["1:28: shots[0].duration: expected a positive number, got -1"]),
    ("shots: [{free: , speed: fast}]", ["1:25: shots[0].speed: expected a positive number, got 'fast'"]),
    ("shots: [{free: , blend: 1}]", ["1:25: shots[0].blend: the first shot has no previous shot to blend with"]),
    ("shots: [{free: , until: 1}, {free: , blend: cosin}]",
     [f"1:45: shots[1].blend: {SHAPES}, got 'cosin' (did you mean 'cosine'?)"]),
    ("shots: [{free: , until: 1}, {free: , blend: 0}]", ["1:45: shots[1].blend: expected a positive number, got 0"]),
    ("shots: [{free: , until: 1}, {free: , blend: true}]",
     ["1:45: shots[1].blend: expected a shape, a width [s] or {shape, width}, got true"]),
    ("shots: [{free: , until: 1}, {free: , blend: {form: x}}]",
     ["1:46: shots[1].blend: unknown key 'form'; keys: shape, width"]),
    ("shots: [{free: , roll: {from: a, to: b}}]",
     ["1:31: shots[0].roll.from: expected a number, got 'a'", "1:38: shots[0].roll.to: expected a number, got 'b'"]),
    ("shots: [{free: , fovy: -45}]", ["1:24: shots[0].fovy: expected a positive number, got -45"]),
    ("shots: [{free: , shake: {angle: -1, seed: 1.5}}]",
     ["1:33: shots[0].shake.angle: expected a number of at least 0, got -1",
      "1:43: shots[0].shake.seed: expected a whole number, got 1.5"]),
    ("shots: [{free: , shake: true}]",
     ["1:25: shots[0].shake: expected a mapping with angle, frequency, seed, got true"]),
    ("shots: [{free: , fit: {margin: .5}}]",
     ["1:23: shots[0].fit: 'target' is missing", "1:32: shots[0].fit.margin: expected a number of at least 1, got .5"]),
    ("shots: [{free: , fit: 5}]", ["1:23: shots[0].fit: expected an object's name or {target, margin}, got 5"]),
    ("vars: {}\nshots: [{free: }]", ["1:1: unknown key 'vars'; keys: speed, shots"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), WRONG)
def test_what_is_wrong_is_reported_at_its_line_and_column(text: str, lines: list[str]) -> None:
    assert problems(text) == lines


def test_every_error_of_a_long_document_is_reported_at_once() -> None:
    text = """speed: slow
shots:
  - orbit: {lookat: floor, distance: -1, azimuth: {from: 140, too: 240}}
    until: {when: speed(box) > 0.02
           , nth: none}
  - track: {targt: box}
    speed: 0.5
    speed: 1
  - camera: *top
    blend: sigmoidal
"""
    assert problems(text) == [
        "1:8: speed: expected a positive number, got 'slow'",
        "3:38: shots[0].orbit.distance: expected a positive number, got -1",
        "3:51: shots[0].orbit.azimuth: 'to' is missing",
        "3:63: shots[0].orbit.azimuth: unknown key 'too' (did you mean 'to'?); keys: from, to, ease",
        "5:19: shots[0].until.nth: expected a whole number, got 'none'",
        "6:5: shots[1]: the end of this shot is missing: all shots but the last need until or duration",
        "6:12: shots[1].track: 'target' is missing",
        f"6:13: shots[1].track: unknown key 'targt' (did you mean 'target'?); keys: {TRACK}",
        "8:5: shots[1]: 'speed' is given twice; first in line 7",
        "9:13: shots[2].camera: anchors (&) and aliases (*) are not supported; put such text in quotes",
        f"10:12: shots[2].blend: {SHAPES}, got 'sigmoidal' (did you mean 'sigmoid'?)",
    ]


LEAVES = ["1", "-1", "0.5", "box", "true", "", ".nan", "end", "cosine", "time", "[1, 2, 3]", "[]", "{}"]
KEYS = ["from", "to", "ease", "lookat", "distance", "azimuth", "elevation", "target", "heading", "offset", "at", "eye"]
KEYS += ["waypoints", "curve", "pace", "until", "duration", "speed", "blend", "roll", "fovy", "shake", "fit", "when"]
KEYS += ["nth", "else", "shape", "width", *RIGS]
trees = st.recursive(
    st.sampled_from(LEAVES),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda parts: f"[{', '.join(part or '~' for part in parts)}]")
        | st.dictionaries(st.sampled_from(KEYS), inner, max_size=5).map(
            lambda d: "{" + ", ".join(f"{k}: {v}" for k, v in d.items()) + "}"
        )
    ),
    max_leaves=20,
)


@given(st.lists(trees, max_size=4))
@settings(max_examples=60, deadline=None)
def test_no_shots_do_anything_but_be_read_or_be_told_what_is_wrong_with_them(shots: list[str]) -> None:
    Path("c.yaml").write_text("shots:\n" + "".join(f"  - {shot}\n" for shot in shots))
    try:
        assert len(read_camera("c.yaml").shots) == len(shots) > 0
    except DocumentError as error:
        places = [tuple(map(int, problem.place.split(":")[1:])) for problem in error.problems]
        if places != sorted(places):
            raise
