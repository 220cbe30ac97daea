"""Recordings against their physics: differences of states and of origins are reported."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import FailedStepError, FileError, UsageError
from mjrun.formats.recording import RecordingWriter
from mjrun.model import state
from mjrun.options.simulation import PushKind
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace_rows import blocks
from mjrun.physics.control import ControlSources, PeriodicController, PushForces
from mjrun.physics.stepper import PhysicsStepper
from mjrun.simulation import verification
from mjrun.simulation.simulation import Simulation
from mjrun.simulation.verification import UNEXPLAINED, first_difference, verify
from mjrun.timeline import rational
from tests.physics.test_recorded_states import DELAYED, PLUGIN, SLEEPY, TUMBLE, Kept, live, recorded, wave

XML = """<mujoco><worldbody>
<body name="box" pos="0 0 1"><freejoint name="root"/><geom type="box" size=".1 .2 .3" mass="{mass}"/></body>
<body pos="1 0 1"><joint name="knee" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body>
</worldbody><actuator><general name="lag" joint="knee" dyntype="filter" dynprm=".1"/></actuator></mujoco>"""
STEPS = 100


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "m.xml"
    path.write_text(XML.format(mass=2))
    return path


@pytest.fixture
def recording(model: Path, tmp_path: Path) -> Path:
    path = tmp_path / "r.npz"
    Recording(
        Simulation(model, steps=STEPS, ctrl={"lag": 3}, ctrl_noise=0.5, push="box=1/2/0@0.05+0.03"), str(path)
    ).run()
    return path


def rewritten(recording: Path, facts: dict[str, Any] | None = None, every: int = 1, **changes: float) -> Path:
    """Rewrites the recording with other facts, fewer states, or `flip` of a bit in (step, number)."""
    with np.load(recording) as file:
        states, old = file["states"], json.loads(str(file["facts"]))
    if changes:
        states[int(changes["step"])].view(np.uint64)[int(changes["number"])] ^= np.uint64(1)
    with RecordingWriter(str(recording), states.shape[1], {**old, **(facts or {})}) as writer:
        for step in range(0, len(states), every):
            writer.write(step, states[step])
        writer.publish()
    return recording


def test_what_was_recorded_here_is_the_same_again(model: Path, recording: Path) -> None:
    result = verify(Simulation(model, replay=recording))
    assert (result.agrees, result.states, result.steps, result.time) == (True, STEPS + 1, STEPS, 0.2)
    assert result.differences == result.origins == []
    part = verify(Simulation(model, replay=recording, steps=30))
    assert (part.agrees, part.states, part.steps) == (True, 31, 30)


def test_one_gram_is_found_as_soon_as_it_changes_anything(model: Path, recording: Path) -> None:
    model.write_text(XML.format(mass=2.001))
    result = verify(Simulation(model, replay=recording))
    assert not result.agrees
    assert result.steps <= 26  # the push of step 25 is the first force that is not its weight
    assert all("/root/" in each.name for each in result.differences)
    assert "the physics of the model is not that of the recording, which was made from" in result.origins[0]


@pytest.mark.parametrize(
    ("number", "field", "name"),
    [(3, "qpos", "qpos/root/z"), (8, "qpos", "qpos/knee"), (13, "qvel", "qvel/root/wy"), (16, "act", "act/lag")],
)
def test_one_bit_is_found_and_named(model: Path, recording: Path, number: int, field: str, name: str) -> None:
    rewritten(recording, step=60, number=number)
    result = verify(Simulation(model, replay=recording))
    assert (result.agrees, result.steps, result.time) == (False, 60, 0.12)
    (difference,) = result.differences
    assert (difference.field, difference.name, difference.count) == (field, name, 1)
    assert difference.stepped is not None
    assert 0 < abs(difference.recorded - difference.stepped) < 1e-12
    assert result.origins == [UNEXPLAINED]


def test_a_damaged_file_is_no_recording(model: Path, recording: Path) -> None:
    content = bytearray(recording.read_bytes())
    content[5000] ^= 1
    recording.write_bytes(content)
    with pytest.raises(FileError):
        verify(Simulation(model, replay=recording))


def test_what_is_not_as_it_was_is_reported_only_where_something_is_not(model: Path, recording: Path) -> None:
    rewritten(recording, {"mjrun": "0.0.1", "mujoco": "3.9.0", "machine": "Plan9 vax\x1b", "physics": "other"})
    messages = verify(Simulation(model, replay=recording)).origins
    assert [text.partition(":")[0] for text in messages[1:]] == ["mjrun", "MuJoCo", "machine"]
    assert messages[2] == f"MuJoCo: recorded with 3.9.0, verified with {mujoco.mj_versionString()}"
    assert messages[3].startswith(r"machine: recorded with Plan9 vax\x1b, verified with ")


def test_overrides_that_differ_are_reported(model: Path, recording: Path) -> None:
    result = verify(Simulation(model, replay=recording, set={"opt.gravity": "0,0,-9"}, integrator="rk4"))
    assert not result.agrees
    assert result.origins[-1] == "overrides: recorded with none, verified with opt.gravity=0,0,-9, integrator=rk4"


@pytest.mark.parametrize(
    "facts", [{}, {"options": 3, "model": [], "sizes": "?"}, {"options": {"simulation": {"set": 1}}}]
)
def test_a_recording_may_say_anything_or_nothing_of_its_making(
    model: Path, recording: Path, facts: dict[str, Any]
) -> None:
    with np.load(recording) as file:
        states = file["states"]
    states[10, 3] += 1
    with RecordingWriter(str(recording), states.shape[1], facts) as writer:
        for step, row in enumerate(states):
            writer.write(step, row)
        writer.publish()
    assert verify(Simulation(model, replay=recording)).steps == 10


def test_a_recording_without_every_step_says_what_it_cannot_know(model: Path, recording: Path) -> None:
    rewritten(recording, every=10)  # noise in the controls between its states is lost
    result = verify(Simulation(model, replay=recording))
    assert (result.agrees, result.steps, result.states) == (False, 10, 2)
    assert "inputs that changed between two of its states are missing" in result.origins[-1]


def test_what_steps_to_infinity_is_reported_without_a_number(model: Path, recording: Path) -> None:
    with np.load(recording) as file:
        states = file["states"][:2]
    numbers = mujoco.MjModel.from_xml_path(str(model))
    states[0, state.fields(state.sizes(numbers))["xfrc_applied"]] = 1e300
    with RecordingWriter(str(recording), states.shape[1], {}) as writer:
        for step, row in enumerate(states):
            writer.write(step, row)
        writer.publish()
    result = verify(Simulation(model, replay=recording))
    assert None in [each.stepped for each in result.differences]
    assert json.dumps(asdict(result), allow_nan=False)


def test_without_a_recording_of_this_model_there_is_nothing_to_verify(
    model: Path, recording: Path, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="verify requires a recording: name it with replay"):
        verify(Simulation(model))
    with pytest.raises(UsageError, match="until does not apply to a verification, verify"):
        verify(Simulation(model, replay=recording, until="time > 0"))
    (tmp_path / "table.csv").write_text("time,qpos/hinge\n0,1\n")
    with pytest.raises(
        UsageError, match=r"requires a recording, and .*table\.csv is not one\nrecording FILE\.npz makes"
    ):
        verify(Simulation(model, replay=tmp_path / "table.csv"))
    with pytest.raises(FileError, match="is not a recording"):
        verify(Simulation(model, replay=model.rename(tmp_path / "m.npz")))
    other = tmp_path / "other.xml"
    other.write_text("<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>")
    with pytest.raises(UsageError, match="the recording was made with another model: it has nq 8, not 1") as caught:
        verify(Simulation(other, replay=recording))
    assert caught.value.path == ("replay",)


MANY = 120
TUMBLER = mujoco.MjModel.from_xml_string(TUMBLE.format("Euler"))


def run(model: mujoco.MjModel, steps: Sequence[int] = range(MANY + 1), driven: bool = False) -> Kept:
    return recorded(live(model, controller=wave if driven else None), steps)[0]


@cache
def driven_run() -> Kept:
    """A read-only recording of a run under changing inputs."""
    return run(TUMBLER, driven=True)


@pytest.mark.parametrize(
    ("source", "driven"),
    [
        *((TUMBLE.format(integrator), True) for integrator in ("Euler", "RK4", "implicit", "implicitfast")),
        (DELAYED, True),
        (PLUGIN, False),
        (SLEEPY, False),
        (SLEEPY, True),
    ],
)
def test_a_run_is_stepped_again_to_the_last_bit(source: str, driven: bool) -> None:
    model = mujoco.MjModel.from_xml_string(source)
    steps = range(700 if source == SLEEPY else MANY + 1)
    assert first_difference(model, run(model, steps, driven), steps[-1]) is None


def test_a_run_that_is_pushed_by_many_and_recorded_in_c_is_stepped_again() -> None:
    model, timestep = TUMBLER, rational(TUMBLER.opt.timestep)
    pushes = PushForces(model, [PushKind()("body:1=0/3/0@0.03+0.1"), PushKind()("site:arm=1/0/0@0.1+0.05")], timestep)
    controller = PeriodicController(wave, Fraction(1, 50), timestep)
    control = ControlSources(timestep, np.zeros(model.nu), controller=controller)
    stepper = PhysicsStepper(model, mujoco.MjData(model), control, pushes)
    rows = [stepper.state()]
    for _ in range(MANY):
        for _ in blocks(stepper, ["qpos"], 1):
            pass
        rows.append(stepper.state())
    kept = Kept(np.arange(MANY + 1), np.stack(rows))
    forces = kept.rows[:, state.fields(state.sizes(model))["xfrc_applied"]]
    assert len(np.unique(forces, axis=0)) > 20
    assert first_difference(model, kept, MANY) is None


@given(st.integers(1, MANY), st.sampled_from(["qpos", "qvel", "act", "time", "qacc_warmstart"]), st.data())
@settings(deadline=None, max_examples=20)
def test_a_bit_that_was_flipped_is_found_in_its_step_and_place(step: int, field: str, data: st.DataObject) -> None:
    kept = driven_run()
    part = state.fields(state.sizes(TUMBLER))[field]
    place, bit = data.draw(st.integers(part.start, part.stop - 1)), data.draw(st.integers(0, 63))
    rows = kept.rows.copy()
    rows.view(np.uint64)[step, place] ^= np.uint64(1) << np.uint64(bit)

    result = first_difference(TUMBLER, replace(kept, rows=rows), MANY)
    assert result
    assert (result.index, result.step) == (step, step)
    assert np.flatnonzero(result.recorded.view(np.uint64) != result.stepped.view(np.uint64)).tolist() == [place]
    assert result.stepped.tobytes() == kept.rows[step].tobytes()
    assert first_difference(TUMBLER, replace(kept, rows=rows), step - 1) is None


def test_controls_that_were_changed_are_found_a_step_later() -> None:
    kept = driven_run()
    rows = kept.rows.copy()
    rows[50, state.controls(TUMBLER)] += 1
    result = first_difference(TUMBLER, replace(kept, rows=rows), MANY)
    assert result
    assert result.step == 51


@pytest.mark.parametrize("every", [1, 2, 7])
def test_a_recording_of_some_steps_is_verified_at_those(every: int) -> None:
    steps = range(0, MANY + 1, every)
    kept = run(TUMBLER, steps)
    assert first_difference(TUMBLER, kept, len(steps) - 1) is None
    rows = kept.rows.copy()
    rows[5, 1] += 1e-15
    result = first_difference(TUMBLER, replace(kept, rows=rows), len(steps) - 1)
    assert result
    assert (result.index, result.step) == (5, 5 * every)


def test_progress_is_reported_and_the_model_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verification, "PROGRESS", 50)
    model, messages = mujoco.MjModel.from_xml_string(TUMBLE.format("Euler")), list[int]()
    flags = model.opt.disableflags
    assert first_difference(model, run(model, range(101)), 100, messages.append) is None
    assert messages == [50, 100]
    assert model.opt.disableflags == flags


def test_physics_that_fails_is_reported_with_its_step() -> None:
    spheres = "".join(f'<body pos="{x / 8} 0 .06"><freejoint/><geom size=".05"/></body>' for x in range(6))
    text = '<mujoco><size memory="{}"/><worldbody><geom type="plane" size="1 1 1"/>{}</worldbody></mujoco>'
    kept = run(mujoco.MjModel.from_xml_string(text.format("1M", spheres)))
    with pytest.raises(FailedStepError) as caught:
        first_difference(mujoco.MjModel.from_xml_string(text.format("20K", spheres)), kept, MANY)
    assert 0 < caught.value.step < MANY
