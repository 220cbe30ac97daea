"""Camera scripts drawn by chance, and the values in them."""

import dataclasses
from fractions import Fraction
from typing import Any

from hypothesis import strategies as st

from mjrun.camera.rigs.free_camera import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.path import PathRig, Waypoint
from mjrun.camera.rigs.rig import BLENDS, EASINGS, EasedNumber, Shake, ShotBlend
from mjrun.camera.script import CameraScript, ConditionEvent, FramedObject, Shot
from mjrun.timeline import rational

ODD = "aé0 .-_:/#'\"\\,[]{}&*!|>%@`~=?$\n\t\r\x07\x85\u2028\ufeff🚗"

texts = (
    st.text(ODD, min_size=1, max_size=8)
    | st.sampled_from(
        [
            "true",
            "null",
            "~",
            "1e-3",
            "0x1F",
            "12",
            "-.inf",
            "${x}",
            "$${x}",
            "<<",
            "- a",
            "a: b",
            "a #b",
            "---",
            "…",
            "no",
        ]
    )
    | st.just("max(abs(energy/drift)) < 1e-3 and " * 5)
)

names = st.text("aé0 .:/#'\"{}[]<>=~*", min_size=1, max_size=6) | st.sampled_from(["1", "true", "<<", "a" * 200])

numbers = st.floats(-1e6, 1e6) | st.integers(-5, 5).map(float) | st.sampled_from([1e-300, 1e300, 5e-324, 0.1])

positives = st.floats(1e-9, 1e9) | st.integers(1, 9).map(float)

decimals = positives.map(rational)

times = decimals | st.just(Fraction(1, 3))  # which no decimal number is

vectors = st.tuples(numbers, numbers, numbers)

places = names | vectors

ramps = st.builds(EasedNumber, numbers, numbers, st.sampled_from([*EASINGS])) | numbers.map(EasedNumber.still)

distances = st.builds(EasedNumber, positives, positives) | positives.map(EasedNumber.still)


def maybe(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | strategy


around = {"distance": maybe(distances), "azimuth": maybe(ramps), "elevation": maybe(ramps)}

waypoints = st.lists(st.builds(Waypoint, eye=vectors, lookat=maybe(places)), min_size=2, max_size=4)

orbits = st.lists(st.builds(Waypoint, st.none(), positives, numbers, numbers, maybe(places)), min_size=2, max_size=3)


@st.composite
def timed(draw: st.DrawFn) -> PathRig:
    """A path whose waypoints have times."""
    points = draw(waypoints)
    times = sorted(draw(st.lists(positives, min_size=len(points), max_size=len(points), unique=True)))
    rising = [dataclasses.replace(point, at=time) for point, time in zip(points, times, strict=True)]
    return PathRig(rising, draw(places), draw(st.sampled_from(["spline", "linear"])), "time")


rigs = st.one_of(
    st.builds(ModelRig, names),
    st.builds(FreeRig, maybe(places), **around),
    st.builds(OrbitRig, maybe(places), **around),
    st.builds(OrbitRig, maybe(places), maybe(distances), st.none(), maybe(ramps), st.sampled_from(sorted(EASINGS))),
    st.builds(TrackRig, names, **around, heading=st.booleans(), offset=vectors),
    st.tuples(places, places).filter(lambda pair: pair[0] != pair[1]).map(lambda pair: LookRig(*pair)),
    st.builds(
        PathRig, waypoints | orbits, places, st.sampled_from(["spline", "linear"]), ease=st.sampled_from([*EASINGS])
    ),
    timed(),
)

events = st.builds(
    ConditionEvent,
    texts,
    st.integers(1, 9),
    numbers.map(rational),
    maybe(decimals) | st.just("end") | st.just(Fraction(0)),
)


@st.composite
def scripts(draw: st.DrawFn) -> CameraScript:
    shots = []
    for last in [*[False] * draw(st.integers(0, 2)), True]:
        span = draw(st.sampled_from(["until", "lasting"])) if not last or draw(st.booleans()) else ""
        ends = {"until": draw(events), "lasting": draw(times)}
        shots.append(
            Shot(
                draw(rigs),
                **({span: ends[span]} if span else {}),
                speed=draw(maybe(decimals)),
                blend=draw(maybe(st.builds(ShotBlend, st.sampled_from([*BLENDS]), positives))) if shots else None,
                roll=draw(ramps),
                fovy=draw(maybe(distances)),
                shake=draw(maybe(st.builds(Shake, positives, positives, st.integers(0, 10**18 - 1)))),
                fit=draw(maybe(st.builds(FramedObject, names, st.floats(1, 9)))),
            )
        )
    if len(shots) == 1 and draw(st.booleans()):
        shots = [dataclasses.replace(shots[0], until=draw(times), lasting=None)]
    return CameraScript(draw(st.just("script") | names), shots)
