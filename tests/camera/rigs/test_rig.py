"""What all rigs refuse."""

import math

import pytest

from mjrun.camera.easing import Ramp
from mjrun.camera.rigs.around import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import PathRig, Waypoint
from mjrun.camera.rigs.rig import Rig
from mjrun.camera.targets import Place
from mjrun.errors import MjrunError
from tests.camera.rigs.posed_model import CAMERAS_OF_MODEL

SQUARE = tuple(Waypoint(eye=eye) for eye in ((0.0, 0.0, 0.0), (2.0, 0.0, 0.5), (2.0, 3.0, 0.0), (0.0, 3.0, 1.0)))


def orbit(*points: tuple[float, float, float], lookat: Place | None = None) -> list[Waypoint]:
    return [Waypoint(distance=d, azimuth=a, elevation=e, lookat=lookat) for d, a, e in points]


TWO = SQUARE[:2]


TIMED = [Waypoint(eye=(0.0, 0.0, 0.0), at=1.0), Waypoint(eye=(1.0, 0.0, 0.0), at=1.0)]


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        (ModelRig("fixde"), "no camera 'fixde' (did you mean 'fixed'?)"),
        (FreeRig("bxo"), "no object 'bxo' (did you mean 'box'?)"),
        (FreeRig(distance=Ramp(1, 0)), "camera a: distance: '0' is not a positive number of metres"),
        (FreeRig(distance=Ramp(1, 2, "quick")), "no ease 'quick' in camera a: distance\neases: linear, cosine"),
        (FreeRig(elevation=Ramp(1, math.nan)), "camera a: elevation: 'nan' is not finite"),
        (OrbitRig(azimuth=Ramp(1, 2), ease="in"), "camera a: ease: set the ease within azimuth: {from, to, ease}"),
        (OrbitRig(ease="quick"), "no ease 'quick' in camera a\neases: linear, cosine"),
        (FreeRig((1.0, 2.0, math.inf)), "is not a point"),
        (LookRig("box", "box"), "camera a: at: the camera cannot look at where it is"),
        (LookRig("box", "bxo"), "no object 'bxo'"),
        (PathRig(TWO[:1]), "camera a: waypoints: at least 2 are needed, not 1"),
        (PathRig(TWO, curve="bezier"), "no curve 'bezier' in camera a\ncurves: spline, linear"),
        (PathRig(TWO, pace="slow"), "no pace 'slow' in camera a\npaces: constant, time"),
        (PathRig(TWO, ease="slow"), "no ease 'slow' in camera a\neases: linear"),
        (PathRig(TIMED, pace="time", ease="in"), "camera a: ease: ease is for pace: constant"),
        (PathRig(TIMED, pace="time"), "camera a: waypoint 2: at: expected a time later than 1"),
        (PathRig(TIMED), "camera a: waypoint 1: at: at needs pace: time"),
        (
            PathRig([TIMED[0], TWO[1]], pace="time"),
            "camera a: waypoint 2: with pace: time each waypoint needs its at [s]",
        ),
        (
            PathRig([TWO[0], *orbit((1, 2, 3))], "box"),
            "camera a: waypoint 2: waypoints are all given by eye, or all by",
        ),
        (PathRig([TWO[0], TWO[0]], "box"), "camera a: waypoints 1 and 2 are at the same place"),
        (PathRig(orbit((1, 0, 90), (1, 90, 90)), "box"), "camera a: waypoints 1 and 2 are at the same place"),
        (PathRig(orbit((1, 2, 3), (2, 3, 4))), "camera a: waypoint 1: what is looked at from here?"),
        (PathRig([TWO[0], Waypoint(eye=(1.0, 1.0, 1.0), lookat="box")]), "waypoint 1: what is looked at from here?"),
        (PathRig(orbit((1, 2, 3), (0, 3, 4)), "box"), "camera a: waypoint 2: distance: '0' is not a positive number"),
        (
            PathRig([TWO[0], Waypoint()]),
            "camera a: waypoint 2: expected eye, or distance, azimuth and elevation, got none",
        ),
        (
            PathRig([TWO[0], Waypoint(eye=(0.0, 0.0, 0.0), azimuth=3.0)]),
            "camera a: waypoint 2: azimuth: an eye has no azimuth beside it",
        ),
        (
            PathRig([TWO[0], Waypoint(eye=(0.0, 0.0, math.nan))]),
            "waypoint 2: eye: '0, 0, nan' is not made of finite numbers",
        ),
        (PathRig([Waypoint(eye=(0, 0, 0), at=t) for t in (0, 1)], pace="time"), "what does the camera look at?"),
        (PathRig(TWO, lookat="bxo"), "no object 'bxo'"),
        (PathRig(orbit((1, 2, math.inf), (2, 3, 4)), "box"), "camera a: waypoint 1: elevation: 'inf' is not finite"),
        (
            PathRig([Waypoint(eye=(0, 0, t), at=t) for t in (-1, 1)], pace="time"),
            "waypoint 1: at: '-1' is not 0 or more",
        ),
        (TrackRig("box", offset=(0, 0, math.nan)), "camera a: offset: '0, 0, nan' is not made of finite numbers"),
    ],
)
def test_a_wrong_rig_is_refused_with_what_is_right(rig: Rig, message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        rig.bind(CAMERAS_OF_MODEL, "camera a")
    assert caught.value.exit_code == 2
    assert message in str(caught.value)
