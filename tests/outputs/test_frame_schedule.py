"""Shots of cameras as stretches of a film."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, Event, Shot
from mjrun.errors import UsageError
from mjrun.outputs.frame_schedule import video_schedule
from mjrun.timeline import Timeline

STEP = Fraction(1, 500)
LINE = Timeline.lasting(STEP, Fraction(2))
FPS = Fraction(30)


def shots(*ends: dict) -> CameraScript:
    return CameraScript("film", [Shot(ModelRig("0"), **end) for end in ends])


def paced(*scripts: CameraScript, speed: int | Fraction = 1, **happened: list[int]):  # type: ignore[no-untyped-def]
    return video_schedule(scripts, LINE, FPS, Fraction(speed), {"hit": happened.get("hit", [])})


def test_shots_without_a_word_about_time_are_the_whole_film() -> None:
    found = paced(shots({}))
    assert list(found.steps) == LINE.frames(FPS)
    assert found.spans == [[(0, 2)]]
    assert list(found.speeds) == [1] * 60


@pytest.mark.parametrize(
    ("fps", "speed", "script"),
    [
        (Fraction(10) ** 300, 1, shots({})),
        (FPS, Fraction("1e-12"), shots({})),
        (FPS, 1, shots({"until": Fraction(1)}, {"speed": Fraction("1e-300")})),
    ],
    ids=["fps", "speed", "speed of a shot"],
)
def test_a_video_that_would_never_end_is_refused(fps: Fraction, speed: Fraction, script: CameraScript) -> None:
    with pytest.raises(UsageError, match=r"frames; the maximum is 2,000,000"):
        video_schedule([script], LINE, fps, Fraction(speed), {})


speeds = st.fractions(Fraction(1, 8), 4, max_denominator=8)
ends = st.lists(st.fractions(0, 2, max_denominator=50), min_size=1, max_size=4, unique=True).map(sorted)


@given(st.data())
def test_frame_k_shows_what_the_film_has_reached_at_k_over_fps(data: st.DataObject) -> None:
    """Against simulated time as the integral of speed over the time of the film, frame by frame."""
    until = data.draw(ends)
    pace = [data.draw(speeds) for _ in until]
    found = paced(shots(*({"until": end, "speed": s} for end, s in zip(until, pace, strict=True))))

    def reached(film: Fraction) -> Fraction:
        at = Fraction(0)
        for end, s in zip(until, pace, strict=True):
            if film <= (end - at) / s:
                return at + film * s
            film, at = film - (end - at) / s, end
        return at

    lasts = sum((end - start) / s for start, end, s in zip([0, *until], until, pace, strict=False))
    assert len(found.steps) == -(-lasts // (1 / FPS))
    for k, step in enumerate(found.steps):
        assert abs(reached(k / FPS) - step * STEP) <= STEP / 2
        assert found.times[k] == float(k / FPS)


def test_a_shot_ends_when_an_event_happens_and_later_ones_count_from_there() -> None:
    twice = shots({"until": Event("hit")}, {"until": Event("hit", nth=2, offset=Fraction(-1, 10))}, {})
    assert paced(twice, hit=[0, 100, 200, 500]).spans == [[(0, 0), (0, 0.3), (0.3, 2)]]
    assert paced(twice, hit=[50, 100, 200]).spans == [[(0, 0.1), (0.1, 0.3), (0.3, 2)]]


@pytest.mark.parametrize(
    ("event", "hit", "message"),
    [
        (Event("hit"), [], r"^film: shots\[0\]: 'hit' never happens in the 2 s of the simulation\nadd `else: end` or"),
        (Event("hit", nth=3), [4, 9], r"^film: shots\[0\]: 'hit' happens only 2 times, not 3, in the 2 s"),
        (Event("hit", offset=Fraction(-1)), [100], r"^film: shots\[0\] would end at -0\.8 s, before it begins at 0 s$"),
    ],
)
def test_an_event_that_cannot_end_a_shot_is_an_error_that_says_so(event: Event, hit: list[int], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        paced(shots({"until": event}, {}), hit=hit)


def test_what_counts_when_an_event_never_happens_can_be_said() -> None:
    assert paced(shots({"until": Event("hit", otherwise="end")}, {})).spans == [[(0, 2), (2, 2)]]
    assert paced(shots({"until": Event("hit", otherwise=Fraction(1, 2))}, {})).spans == [[(0, 0.5), (0.5, 2)]]


def test_the_last_shot_may_end_the_film_early_but_none_goes_on_after_the_simulation() -> None:
    assert len(paced(shots({"until": Fraction(1)})).steps) == 30
    late = paced(shots({"until": Fraction(1)}, {"lasting": Fraction(5)}, {}))
    assert len(late.steps) == 60
    assert late.spans == [[(0, 1), (1, 6), (6, 6)]]


def test_a_shot_that_nobody_sees_is_told() -> None:
    found = paced(shots({"until": Fraction(3)}, {"lasting": Fraction(1)}))
    assert found.warnings == ["film: shots[1] is not seen: the simulation ends at 2 s"]


def test_cameras_may_share_a_pace_but_not_have_two() -> None:
    slow = shots({"until": Fraction(1), "speed": Fraction(1, 2)}, {})
    found = paced(slow, shots({}), speed=2)
    assert len(found.steps) == 2 * 30 + 15
    assert list(found.speeds) == [0.5] * 60 + [2.0] * 15
    with pytest.raises(UsageError, match="different speeds"):
        paced(slow, shots({"until": Fraction(1), "speed": Fraction(1, 4)}, {}))
