"""Steps at which conditions begin to hold, against bare loops."""

from contextlib import closing
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.camera.rigs.around import FreeRig, TrackRig
from mjrun.camera.script import CameraScript, Event, Shot
from mjrun.errors import UnknownNameError, UsageError
from mjrun.outputs.event_detection import EventDetector, conditions, time_of
from mjrun.outputs.image import Image, ImageResult
from mjrun.outputs.perform import perform
from mjrun.outputs.video import Video, VideoResult
from mjrun.physics.observe import observe
from mjrun.physics.stepper import PhysicsStepper
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

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


def test_an_event_cuts_stills_and_films_at_the_very_step(swing: Path, tmp_path: Path, backend: object) -> None:
    hit = thrown(swing)
    assert 20 < hit < 200
    simulation = Simulation(swing, duration=0.5)
    event = Event("contact(ball, floor)")
    slow = CameraScript("hit", [Shot(FreeRig(), until=event), Shot(TrackRig("ball"), speed=Fraction(1, 2))])
    film = Video(simulation, f"{tmp_path}/f/", fps=20, size=SIZE, camera=slow, text="{step}")
    still = Image(simulation, f"{tmp_path}/i.png", time=event, size=SIZE)
    video, image = perform([film, still])
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
        observe(stepper, detector.taps(1000), 1000)
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
        (Event("c"), -1, 0),
        (Event("c"), 0, Fraction(1, 5)),
        (Event("c", nth=3), -1, Fraction(1, 2)),
        (Event("c", nth=2, offset=Fraction(-1, 10)), 0, Fraction(2, 5)),
        (Event("c", nth=4, otherwise="end"), -1, 1),
        (Event("c", nth=4, otherwise=Fraction(1, 3)), -1, Fraction(1, 3)),
    ],
)
def test_the_time_of_an_event_is_that_of_its_step(event: Event, after: int, time: Fraction) -> None:
    assert time_of(event, STEPS, TIMELINE, "here", Fraction(after)) == time


@pytest.mark.parametrize(
    ("event", "after", "message"),
    [
        (Event("c"), 0.5, r"here: 'c' never happens in the 1 s of the simulation after 0.5 s\nadd `else: end`"),
        (
            Event("c", nth=4),
            -1,
            r"here: 'c' happens only 3 times, not 4, in the 1 s .*\nadd `else: end`",
        ),
    ],
)
def test_an_event_that_does_not_happen_is_an_error(event: Event, after: float, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        time_of(event, STEPS, TIMELINE, "here", Fraction(after))


def test_a_condition_is_evaluated_once_however_many_wait_for_it(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    events = [Event("time > 1"), Event("qpos(hinge) > 0"), Event("time > 1", nth=2)]
    assert conditions({("camera", i): event for i, event in enumerate(events)}, model) == [
        "time > 1",
        "qpos(hinge) > 0",
    ]
    with pytest.raises(UnknownNameError, match="nobody") as caught:
        conditions({("time", "when"): Event("speed(nobody) > 1")}, model)
    assert caught.value.path == ("time", "when")
    assert caught.value.__notes__ == ["in 'speed(nobody) > 1'"]
