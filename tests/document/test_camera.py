"""A camera document is the script that it says, exactly, or a list of what is wrong with it, line by line."""

from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.camera.rigs.free_camera import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import CURVES, PathRig, Waypoint
from mjrun.camera.rigs.rig import BLENDS, EASINGS, EasedNumber, Rig, Shake, ShotBlend
from mjrun.camera.script import RIGS, CameraScript, ConditionEvent, FramedObject, Shot
from mjrun.document.camera_and_ghost_forms import read_camera
from mjrun.errors import DocumentError
from tests.cases import cases


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
                until=ConditionEvent("speed(box) > 0.02"),
                speed=Fraction(1, 4),
            ),
            Shot(
                TrackRig("box", still(0.08), still(280), still(-10)),
                lasting=Fraction(1, 10),
                speed=Fraction(1, 2),
                blend=ShotBlend("sigmoid", 0.3),
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
        ("until: {when: 'ncon > 0'}", Shot(ModelRig("a"), until=ConditionEvent("ncon > 0"))),
        (
            "until: {when: x < 1, nth: 2, offset: -0.1, else: 2.5}",
            Shot(ModelRig("a"), until=ConditionEvent("x < 1", 2, Fraction(-1, 10), Fraction(5, 2))),
        ),
        ("until: {when: x < 1, else: end}", Shot(ModelRig("a"), until=ConditionEvent("x < 1", otherwise="end"))),
        ("until: {when: x < 1, else: 0}", Shot(ModelRig("a"), until=ConditionEvent("x < 1", otherwise=Fraction(0)))),
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
        ("linear", ShotBlend("linear")),
        ("0.2", ShotBlend(width=0.2)),
        ("1", ShotBlend(width=1)),
        ("{}", ShotBlend()),
        ("{shape: smooth}", ShotBlend("smooth")),
        ("{width: 0.1, shape: sigmoid}", ShotBlend("sigmoid", 0.1)),
    ],
)
def test_a_blend_is_a_shape_a_width_or_both(text: str, blend: ShotBlend) -> None:
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
        assert shots[1].blend == ShotBlend(shape)
    for curve in CURVES:
        path = f"path: {{curve: {curve}, waypoints: [{{eye: [0, 0, 0]}}, {{eye: [1, 0, 0]}}]}}"
        expected = PathRig([Waypoint((0, 0, 0)), Waypoint((1, 0, 0))], curve=curve)
        assert script(f"shots: [{{{path}}}]").shots[0].rig == expected


# --- what is wrong -----------------------------------------------------------------------------------

SHOT_KEYS = "keys: auto, camera, free, look, orbit, path, track, until, duration, speed, blend, roll, fovy, shake, fit"
TRACK = "target, distance, azimuth, elevation, heading, offset"
SHAPES = "expected 'cosine', 'linear', 'smooth' or 'sigmoid'"


@cases("text, lines")
def test_what_is_wrong_is_reported_at_its_line_and_column(text: str, lines: list[str]) -> None:
    assert problems(text) == [line.replace("{keys}", SHOT_KEYS) for line in lines]


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
