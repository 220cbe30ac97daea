"""What all rigs refuse."""

import math
from collections.abc import Callable

import pytest

from mjrun.camera.easing import Ramp
from mjrun.camera.rigs import RIGS
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
    ("make", "message"),
    [
        (lambda: ModelRig("fixde"), "no camera 'fixde' (did you mean 'fixed'?)"),
        (lambda: FreeRig("bxo"), "no object 'bxo' (did you mean 'box'?)"),
        (lambda: FreeRig(distance=Ramp(1, 0)), "distance: '0' is not a positive number of metres"),
        (lambda: FreeRig(distance=-1), "distance: '-1' is not a positive number of metres"),
        (lambda: FreeRig(distance=Ramp(1, 2, "smoth")), "distance: 'smoth' is not one of linear, cosine, smooth,"),
        (lambda: FreeRig(distance=Ramp(1, 2, "smoth")), "(did you mean 'smooth' or 'smoother'?)"),
        (lambda: FreeRig(elevation=Ramp(1, math.nan)), "elevation: 'nan' is not finite"),
        (lambda: OrbitRig(azimuth=Ramp(1, 2), ease="in"), "ease: set the ease within azimuth: {from, to, ease}"),
        (lambda: OrbitRig(ease="quick"), "ease: 'quick' is not one of linear, cosine"),
        (lambda: FreeRig((1.0, 2.0, math.inf)), "lookat: '1, 2, inf' is not made of finite numbers"),
        (lambda: LookRig("box", "box"), "at: the camera cannot look at its own position"),
        (lambda: LookRig("box", "bxo"), "no object 'bxo'"),
        (lambda: PathRig(TWO[:1]), "waypoints: '1' is not at least 2"),
        (lambda: PathRig(TWO, curve="bezier"), "curve: 'bezier' is not one of spline, linear"),
        (lambda: PathRig(TWO, pace="slow"), "pace: 'slow' is not one of constant, time"),
        (lambda: PathRig(TWO, ease="slow"), "ease: 'slow' is not one of linear"),
        (lambda: PathRig(TIMED, pace="time", ease="in"), "ease: ease requires pace: constant"),
        (lambda: PathRig(TIMED, pace="time"), "waypoint 2: at: expected a time later than 1"),
        (lambda: PathRig(TIMED), "waypoint 1: at: at needs pace: time"),
        (
            lambda: PathRig([TIMED[0], TWO[1]], pace="time"),
            "waypoint 2: with pace: time each waypoint needs its at",
        ),
        (
            lambda: PathRig([TWO[0], *orbit((1, 2, 3))], "box"),
            "waypoint 2: either all waypoints have an eye, or all",
        ),
        (lambda: PathRig([TWO[0], TWO[0]], "box"), "camera a: waypoints 1 and 2 coincide"),
        (
            lambda: PathRig(orbit((1, 0, 90), (1, 90, 90)), "box"),
            "camera a: waypoints 1 and 2 coincide",
        ),
        (lambda: PathRig(orbit((1, 2, 3), (2, 3, 4))), "waypoint 1: no point to look at"),
        (lambda: PathRig([TWO[0], Waypoint((1, 1, 1), lookat="box")]), "waypoint 1: no point to look at"),
        (lambda: Waypoint(distance=0, azimuth=3, elevation=4), "distance: '0' is not a positive number"),
        (Waypoint, "expected eye, or distance, azimuth and elevation, got none"),
        (lambda: Waypoint((0, 0, 0), azimuth=3), "azimuth: a waypoint with an eye has no azimuth"),
        (lambda: Waypoint((0, 0, math.nan)), "eye: '0, 0, nan' is not made of finite numbers"),
        (lambda: PathRig([Waypoint((0, 0, 0), at=t) for t in (0, 1)], pace="time"), "no direction of view"),
        (lambda: PathRig(TWO, lookat="bxo"), "no object 'bxo'"),
        (lambda: Waypoint(distance=1, azimuth=2, elevation=math.inf), "elevation: 'inf' is not a finite number"),
        (lambda: Waypoint((0, 0, 0), at=-1), "at: '-1' is not a number from 0 on"),
        (lambda: TrackRig("box", offset=(0, 0, math.nan)), "offset: '0, 0, nan' is not made of finite numbers"),
    ],
)
def test_a_wrong_rig_is_refused_with_what_is_right(make: Callable[[], Rig], message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        make().bind(CAMERAS_OF_MODEL, "camera a")
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_rigs_are_found_by_the_names_that_documents_have_for_them() -> None:
    assert list(RIGS) == ["camera", "free", "orbit", "track", "look", "path"]
    assert all(kind == rig.kind for kind, rig in RIGS.items())
