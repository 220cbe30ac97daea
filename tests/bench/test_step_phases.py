"""Phases of a step, against MuJoCo's own timers."""

from collections.abc import Iterator

import mujoco
import pytest

from mjrun.bench.rollout_timing import RolloutInputs, phases
from mjrun.bench.testspeed_noise import controls

MODEL = """
<mujoco>
  <option integrator="{integrator}"><flag sleep="{sleep}"/></option>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .09"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 1"><joint name="h" axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
  <actuator><motor name="m" joint="h"/></actuator>
</mujoco>
"""


def run_of(noise: bool = True, integrator: str = "Euler", sleep: str = "disable") -> RolloutInputs:
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator=integrator, sleep=sleep))
    return RolloutInputs.of(model, mujoco.MjData(model), controls(model, 400, 0.5) if noise else None)


def bare(run: RolloutInputs, steps: int) -> mujoco.MjData:
    data = run.data()
    for step in range(steps):
        if run.controls is not None:
            data.ctrl[:] = run.controls[step]
        mujoco.mj_step(run.model, data)
    return data


@pytest.fixture
def ticking() -> Iterator[None]:
    """A clock for MuJoCo's timers that goes on by one at every look."""
    count = iter(range(10**9))
    mujoco.set_mjcb_time(lambda: float(next(count)))
    yield
    mujoco.set_mjcb_time(None)


@pytest.mark.usefixtures("ticking")
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_phases_are_mujocos_timers_per_step_and_the_parts_make_up_the_whole(integrator: str) -> None:
    run = run_of(integrator=integrator)
    data = bare(run, 25)
    found, timer = phases(data), {name: data.timer[int(i)] for name, i in mujoco.mjtTimer.__members__.items()
                                  if name != "mjNTIMER"}  # fmt: skip
    assert found is not None
    assert found.seconds == timer["mjTIMER_STEP"].duration / 25
    tops = {part.name: part for part in found.parts}
    assert list(tops) == ["position", "velocity", "actuation", "constraint", "advance", "other"]
    for name in ("position", "velocity", "actuation", "constraint", "advance"):
        assert tops[name].seconds == timer[f"mjTIMER_{name.upper()}"].duration / 25
    for whole in (found, tops["position"]):
        assert sum(part.seconds for part in whole.parts) == pytest.approx(whole.seconds)
        assert sum(part.share for part in whole.parts) == pytest.approx(whole.share)
    position = {part.name: part for part in tops["position"].parts}
    assert list(position) == ["kinematics", "inertia", "collision", "make", "project", "other"]
    assert [part.name for part in position["collision"].parts] == ["broad", "narrow", "other"]
    assert position["collision"].seconds == timer["mjTIMER_POS_COLLISION"].duration / 25


def test_without_a_step_there_are_no_phases() -> None:
    assert phases(run_of().data()) is None
