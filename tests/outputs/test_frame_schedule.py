"""The frames of a video: shots, speeds and events."""

from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Pillow

from mjrun.camera.rigs.free_camera import FreeRig, TrackRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.script import CameraScript, ConditionEvent, Shot
from mjrun.errors import UnknownNameError, UsageError
from mjrun.outputs.event_detection import EventDetector, conditions, time_of
from mjrun.outputs.image import Image, ImageResult
from mjrun.outputs.perform import perform
from mjrun.outputs.recorded_scene import video_schedule
from mjrun.outputs.video import Video, VideoResult
from mjrun.physics.simulation_loop import run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

STEP = Fraction(1, 500)
LINE = Timeline.lasting(STEP, Fraction(2))
FPS = Fraction(30)


def shots(*ends: dict) -> CameraScript:
    return CameraScript("intro", [Shot(ModelRig("0"), **end) for end in ends])


def paced(*scripts: CameraScript, speed: int | Fraction = 1, **happened: list[int]):  # type: ignore[no-untyped-def]
    return video_schedule(scripts, LINE, {"hit": happened.get("hit", [])}, fps=FPS, speed=Fraction(speed))


def test_shots_without_a_word_about_time_are_the_whole_video() -> None:
    found = paced(shots({}))
    assert list(found.steps) == LINE.frame_steps(FPS)
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
        video_schedule([script], LINE, {}, fps=fps, speed=Fraction(speed))


speeds = st.fractions(Fraction(1, 8), 4, max_denominator=8)
ends = st.lists(st.fractions(0, 2, max_denominator=50), min_size=1, max_size=4, unique=True).map(sorted)


@given(st.data())
def test_frame_k_shows_what_the_video_has_reached_at_k_over_fps(data: st.DataObject) -> None:
    """Against simulated time as the integral of speed over the time of the video, frame by frame."""
    until = data.draw(ends)
    pace = [data.draw(speeds) for _ in until]
    found = paced(shots(*({"until": end, "speed": s} for end, s in zip(until, pace, strict=True))))

    def reached(time: Fraction) -> Fraction:
        at = Fraction(0)
        for end, s in zip(until, pace, strict=True):
            if time <= (end - at) / s:
                return at + time * s
            time, at = time - (end - at) / s, end
        return at

    lasts = sum((end - start) / s for start, end, s in zip([0, *until], until, pace, strict=False))
    assert len(found.steps) == max(1, -(-lasts // (1 / FPS)))
    for k, step in enumerate(found.steps):
        assert abs(reached(k / FPS) - step * STEP) <= STEP / 2
        assert found.times[k] == float(k / FPS)


def test_a_shot_ends_when_an_event_happens_and_later_ones_count_from_there() -> None:
    twice = shots(
        {"until": ConditionEvent("hit")}, {"until": ConditionEvent("hit", nth=2, offset=Fraction(-1, 10))}, {}
    )
    assert paced(twice, hit=[0, 100, 200, 500]).spans == [[(0, 0), (0, 0.3), (0.3, 2)]]
    assert paced(twice, hit=[50, 100, 200]).spans == [[(0, 0.1), (0.1, 0.3), (0.3, 2)]]


@pytest.mark.parametrize(
    ("event", "hit", "message"),
    [
        (
            ConditionEvent("hit"),
            [],
            r"^intro: shots\[0\]: 'hit' never happens in the 2 s of the simulation\nadd `else: end` or",
        ),
        (ConditionEvent("hit", nth=3), [4, 9], r"^intro: shots\[0\]: 'hit' happens only 2 times, not 3, in the 2 s"),
        (
            ConditionEvent("hit", offset=Fraction(-1)),
            [100],
            r"^intro: shots\[0\] would end at -0\.8 s, before it begins at 0 s$",
        ),
    ],
)
def test_an_event_that_cannot_end_a_shot_is_an_error_that_says_so(
    event: ConditionEvent, hit: list[int], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        paced(shots({"until": event}, {}), hit=hit)


def test_what_counts_when_an_event_never_happens_can_be_said() -> None:
    assert paced(shots({"until": ConditionEvent("hit", otherwise="end")}, {})).spans == [[(0, 2), (2, 2)]]
    assert paced(shots({"until": ConditionEvent("hit", otherwise=Fraction(1, 2))}, {})).spans == [[(0, 0.5), (0.5, 2)]]


def test_the_last_shot_may_end_the_video_early_but_none_continues_after_the_simulation() -> None:
    assert len(paced(shots({"until": Fraction(1)})).steps) == 30
    assert list(paced(shots({"until": ConditionEvent("hit")}), hit=[0]).steps) == [0]  # one frame at least
    late = paced(shots({"until": Fraction(1)}, {"lasting": Fraction(5)}, {}))
    assert len(late.steps) == 60
    assert late.spans == [[(0, 1), (1, 6), (6, 6)]]


def test_a_shot_that_nobody_sees_is_reported() -> None:
    found = paced(shots({"until": Fraction(3)}, {"lasting": Fraction(1)}))
    assert found.warnings == ["intro: shots[1] is not seen: the simulation ends at 2 s"]


def test_cameras_may_share_a_pace_but_not_have_two() -> None:
    slow = shots({"until": Fraction(1), "speed": Fraction(1, 2)}, {})
    found = paced(slow, shots({}), speed=2)
    assert len(found.steps) == 2 * 30 + 15
    assert list(found.speeds) == [0.5] * 60 + [2.0] * 15
    with pytest.raises(UsageError, match="different speeds"):
        paced(slow, shots({"until": Fraction(1), "speed": Fraction(1, 4)}, {}))


pytestmark = pytest.mark.filterwarnings("ignore:software rendering")

SIZE = (64, 48)


def thrown(path: Path) -> int:
    """The first step at which the ball of `swing` touches the floor, by a bare loop."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    ball, floor = model.geom("ball").id, model.geom("floor").id
    for step in range(500):
        mujoco.mj_forward(model, data)
        if any({*contact.geom} == {ball, floor} for contact in data.contact):
            return step
        mujoco.mj_step(model, data)
    raise AssertionError("it never does")


def test_an_event_cuts_stills_and_videos_at_the_very_step(swing: Path, tmp_path: Path, backend: object) -> None:
    hit = thrown(swing)
    assert 20 < hit < 200
    simulation = Simulation(swing, duration=0.5)
    event = ConditionEvent("contact(ball, floor)")
    slow = CameraScript("hit", [Shot(FreeRig(), until=event), Shot(TrackRig("ball"), speed=Fraction(1, 2))])
    slow_video = Video(simulation, f"{tmp_path}/f/", fps=20, size=SIZE, camera=slow, text="{step}")
    still = Image(simulation, f"{tmp_path}/i.png", time=event, size=SIZE)
    video, image = perform([slow_video, still])
    assert isinstance(video, VideoResult)
    assert isinstance(image, ImageResult)
    timestep = Fraction(1, 500)
    lasts = hit * timestep + 2 * (Fraction(1, 2) - hit * timestep)
    assert video.frames == -(-lasts // Fraction(1, 20))
    assert image.step == hit
    again = perform([replace(still, output=f"{tmp_path}/j.png", time=None, step=hit)])
    assert again[0].step == hit
    assert np.array_equal(np.array(Pillow.open(tmp_path / "i.png")), np.array(Pillow.open(tmp_path / "j.png")))


CONDITIONS = ["qvel(hinge) < -1", "qpos(ball).z < 0.15", "time > 9"]


def test_conditions_begin_where_a_bare_loop_first_meets_them_after_it_did_not(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    data.qvel[0] = 3
    stepper = PhysicsStepper(model, data)
    truths: list[tuple[bool, ...]] = []
    states: list[np.ndarray] = []
    for _ in range(1001):
        truths.append((data.qvel[0] < -1, data.qpos[3] < 0.15, data.time > 9))
        states.append(data.qpos.copy())
        mujoco.mj_step(model, data)
    held = np.array([(False,) * 3, *truths])

    detector = EventDetector(model, Timeline.of_steps(Fraction(1, 500), 1000), CONDITIONS)
    with closing(detector):
        run_with_taps(stepper, detector.taps(1000), 1000)
        expected = {text: np.flatnonzero(held[1:, k] & ~held[:-1, k]).tolist() for k, text in enumerate(CONDITIONS)}
        assert detector.event_steps == expected
        assert len(expected[CONDITIONS[0]]) > 1  # it swings
        replay = detector.replay(model)
        for step in (0, 500, 1000):
            replay.advance(step)
            assert np.array_equal(replay.instant().qpos, states[step])


TIMELINE = Timeline.of_steps(Fraction(1, 500), 500)
STEPS = [0, 100, 250]  # 0, 0.2 and 0.5 s


@pytest.mark.parametrize(
    ("event", "after", "time"),
    [
        (ConditionEvent("c"), -1, 0),
        (ConditionEvent("c"), 0, Fraction(1, 5)),
        (ConditionEvent("c", nth=3), -1, Fraction(1, 2)),
        (ConditionEvent("c", nth=2, offset=Fraction(-1, 10)), 0, Fraction(2, 5)),
        (ConditionEvent("c", nth=4, otherwise="end"), -1, 1),
        (ConditionEvent("c", nth=4, otherwise=Fraction(1, 3)), -1, Fraction(1, 3)),
    ],
)
def test_the_time_of_an_event_is_that_of_its_step(event: ConditionEvent, after: int, time: Fraction) -> None:
    assert time_of(event, STEPS, TIMELINE, "here", Fraction(after)) == time


@pytest.mark.parametrize(
    ("event", "after", "message"),
    [
        (
            ConditionEvent("c"),
            0.5,
            r"here: 'c' never happens in the 1 s of the simulation after 0.5 s\nadd `else: end`",
        ),
        (
            ConditionEvent("c", nth=4),
            -1,
            r"here: 'c' happens only 3 times, not 4, in the 1 s .*\nadd `else: end`",
        ),
    ],
)
def test_an_event_that_does_not_happen_is_an_error(event: ConditionEvent, after: float, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        time_of(event, STEPS, TIMELINE, "here", Fraction(after))


def test_a_condition_is_evaluated_once_however_many_wait_for_it(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    events = [ConditionEvent("time > 1"), ConditionEvent("qpos(hinge) > 0"), ConditionEvent("time > 1", nth=2)]
    assert conditions({("camera", i): event for i, event in enumerate(events)}, model) == [
        "time > 1",
        "qpos(hinge) > 0",
    ]
    with pytest.raises(UnknownNameError, match="nobody") as caught:
        conditions({("time", "when"): ConditionEvent("speed(nobody) > 1")}, model)
    assert caught.value.path == ("time", "when")
    assert caught.value.__notes__ == ["in 'speed(nobody) > 1'"]
