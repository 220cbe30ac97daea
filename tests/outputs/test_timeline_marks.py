"""Marks on the time line: their instants are those of a bare MuJoCo loop."""

import mujoco
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.outputs.event_detection import EventAndAssertionDetector
from mjrun.physics.simulation_loop import run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from mjrun.timeline import Timeline, rational

BALL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 .5"><freejoint name="ball"/><geom name="ball" size=".1"/></body>
  </worldbody>
</mujoco>
"""
STEPS = 400


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(BALL)


def detected(model: mujoco.MjModel, events: list[str], assertions: list[str]) -> EventAndAssertionDetector:
    """Returns a detector that has observed the whole simulation."""
    detector = EventAndAssertionDetector(
        model, Timeline.of_steps(rational(model.opt.timestep), STEPS), events, assertions
    )
    run_with_taps(PhysicsStepper(model, mujoco.MjData(model)), [detector.tap(STEPS)], STEPS)
    return detector


def test_marks_are_where_a_bare_loop_finds_them(model: mujoco.MjModel) -> None:
    data, touching, low = mujoco.MjData(model), list[bool](), list[bool]()
    for _ in range(STEPS + 1):
        mujoco.mj_forward(model, data)
        touching.append(data.ncon > 0)
        low.append(bool(data.qpos[2] < 0.3))
        mujoco.mj_step(model, data)
    begins = [k for k in range(1, STEPS + 1) if touching[k] and not touching[k - 1]]
    first = low.index(True)

    assertions = ["qpos/ball/z >= 0.3", "max(qpos/ball/z) < 0.3", "qpos/ball/z < 1 and time >= 0"]
    marks, verdicts = detected(model, ["landed=contact(ball, floor) > 0"], assertions).finish()
    assert begins
    assert [mark.time for mark in marks if mark.text == "landed"] == pytest.approx([0.002 * k for k in begins])
    assert [verdict.passed for verdict in verdicts] == [False, False, True]
    outcomes = {mark.text: (mark.kind, mark.time) for mark in marks if mark.kind != "event"}
    assert outcomes == {
        assertions[0]: ("fail", pytest.approx(0.002 * first)),
        assertions[1]: ("fail", None),
        assertions[2]: ("pass", None),
    }
    times = [mark.time for mark in marks if mark.time is not None]
    assert times == sorted(times)


def test_names_are_checked_before_the_first_step(model: mujoco.MjModel) -> None:
    timeline = Timeline.of_steps(rational(model.opt.timestep), STEPS)
    with pytest.raises(UnknownNameError, match="bal"):
        EventAndAssertionDetector(model, timeline, ["contact(bal, floor) > 0"], [])
    with pytest.raises(UsageError, match="qpos"):
        EventAndAssertionDetector(model, timeline, [], ["qpos/ball/z <"])
