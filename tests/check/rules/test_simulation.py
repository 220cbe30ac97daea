"""Theorems about simulating a model."""

from pathlib import Path

import mujoco
import pytest

from mjrun.check.context import DEFAULTS, CheckContext
from mjrun.check.rule_catalogue import Thresholds
from mjrun.check.rule_runner import RULES
from mjrun.check.rules import simulation
from mjrun.model.xml_source import read_xml
from tests.check.models import PASSIVE, write

# A ball half a metre below a site of the world.
HUNG = """<mujoco><worldbody><site name="w" pos="0 0 3"/><body pos="0 0 2.5"><freejoint/><geom size=".05"/>
<site name="s"/></body></worldbody>{}</mujoco>"""


def moved(text: str, steps: int = 200, thresholds: Thresholds = DEFAULTS) -> dict[str, str]:
    """Codes and messages of what motion shows."""
    path = Path(write("moved.xml", text))
    findings = simulation.simulate(CheckContext.load(path, read_xml(path), thresholds), steps)
    return {finding.code: finding.message for finding in findings}


def swinging(joint: str = "", option: str = "", world: str = "") -> str:
    """A pendulum."""
    text = PASSIVE.format(joint).replace("<mujoco>", f"<mujoco><option {option}/>")
    return text.replace("</worldbody>", f"{world}</worldbody>")


UNSTABLE = swinging('axis="0 1 0" stiffness="1e7"', 'timestep=".01"')


def test_an_unstable_simulation_is_an_error_at_the_step_that_a_bare_loop_finds() -> None:
    model = mujoco.MjModel.from_xml_string(UNSTABLE)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data, steps = mujoco.MjData(model), 0
    while steps < 200:
        mujoco.mj_step(model, data)
        bad = any(data.warning[kind].number for kind in (3, 4, 5))  # QPOS, QVEL, QACC
        if bad or max(abs(data.qpos[0]), abs(data.qvel[0])) > mujoco.mjMAXVAL:
            break
        steps += 1
    messages = moved(UNSTABLE)
    assert list(messages) == ["MJ701"]
    assert f"became unstable at step {steps}, " in messages["MJ701"]
    assert RULES["MJ701"].severity == "error"


@pytest.mark.parametrize(
    ("text", "gains"),
    [
        (swinging('axis="0 1 0"'), False),
        (swinging('axis="0 1 0" damping=".1"'), False),
        (swinging('axis="0 1 0" damping="-20"'), True),
        (swinging('type="slide" axis="0 0 1"', world='<geom name="in" size=".5" pos="1 0 -.2"/>'), False),
        (HUNG.format('<tendon><spatial range="0 .3"><site site="w"/><site site="s"/></spatial></tendon>'), False),
        (HUNG.format('<equality><connect site1="w" site2="s"/></equality>'), False),
        (HUNG.format("").replace("<freejoint/>", '<joint type="slide" damping="-20"/>'), True),
        (swinging('axis="0 1 0" damping="-20"').replace('name="b"', 'name="b" gravcomp="1"'), False),
        (swinging('axis="0 1 0" damping="-20"', 'wind="1 0 0"'), False),
    ],
    ids=[
        *("free", "damped", "driven by damping", "pushed out, which MJ501 reports", "pulled by a tendon"),
        *("pulled by an equality", "hung, and driven by damping", "with gravcomp", "in wind"),
    ],
)
def test_energy_that_grows_with_nothing_to_drive_it_is_reported(text: str, gains: bool) -> None:
    assert ("MJ702" in moved(text)) == gains


def test_a_gain_below_the_threshold_is_not_reported() -> None:
    assert "MJ702" not in moved(swinging('axis="0 1 0" damping="-20"'), thresholds=Thresholds(energy_gain=1e9))


def test_energy_is_that_of_a_bare_loop() -> None:
    text = swinging('axis="0 1 0" damping="-20"', 'timestep=".001"').replace(
        "/>", '><flag energy="enable"/></option>', 1
    )
    model = mujoco.MjModel.from_xml_string(text)
    data, totals = mujoco.MjData(model), []
    for _ in range(200):
        mujoco.mj_forward(model, data)
        totals.append(sum(data.energy))
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    totals.append(sum(data.energy))
    expected = max(totals[i] for i in range(0, 201, 4)) - totals[0]
    assert f"its energy grows by {expected:.3g} J" in moved(text)["MJ702"]


def test_a_motor_at_work_makes_a_model_no_passive_one() -> None:
    motor = '<actuator><general name="m" joint="j" biastype="affine" biasprm="500 0 0"/></actuator>'
    text = swinging('axis="0 1 0"').replace("</worldbody>", f"</worldbody>{motor}")
    assert moved(text) == {}
    assert "MJ702" in moved(text.replace("500 0 0", "0 0 0").replace('axis="0 1 0"', 'axis="0 1 0" damping="-20"'))


def test_warnings_of_mujoco_are_told() -> None:
    balls = "".join(f'<body pos="{i * 0.01} 0 0"><freejoint/><geom size=".1"/></body>' for i in range(12))
    text = f'<mujoco><size memory="60K"/><worldbody>{balls}</worldbody></mujoco>'
    messages = moved(text, 5)
    assert set(messages) & {"MJ703", "MJ704"}


def test_without_steps_nothing_moves() -> None:
    assert moved(UNSTABLE, 0) == {}
