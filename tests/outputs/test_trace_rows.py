"""Rows of a table: read in blocks, at single instants and from a recording, they are the same to the last bit."""

from collections.abc import Sequence
from contextlib import closing

import mujoco
import numpy as np
import pytest

from mjrun.errors import ContactMemoryError, FailedStepError, UnstableError
from mjrun.outputs.event_detection import EventDetector
from mjrun.outputs.frame_drawing import overlay_probes
from mjrun.outputs.trace_rows import ProbeSampler, blocks
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.simulation_loop import StateBuffer, run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from mjrun.timeline import Timeline, rational

MODEL = """
<mujoco>
  <option integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .12"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
    <body pos="1 0 1"><joint name="h" axis="0 1 0" damping=".3"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
</mujoco>
"""
PROBES = ("qpos", "qvel", "energy", "contact", "speed", "momentum", "xmat")
STEPS = 400


def table_of(integrator: str = "Euler") -> ProbeSampler:
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator=integrator))
    return ProbeSampler(model, PROBES, Timeline.of_steps(rational(model.opt.timestep), STEPS))


def stepper_of(table: ProbeSampler) -> PhysicsStepper:
    return PhysicsStepper(table.model, mujoco.MjData(table.model))


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_single_instant_is_the_row_of_the_whole_table(integrator: str) -> None:
    table = table_of(integrator)
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    drift = [column.name for column in table.columns].index("energy/drift")
    assert whole[0, drift] == 0
    assert whole[-1, drift] < -0.01  # damping takes it
    recorded = stepper_of(table)
    with closing(StateBuffer(table.model)) as states:
        for step in range(STEPS + 1):
            recorded.advance(step)
            states.append(recorded.state())
        for step in (0, 3, 150, STEPS):
            for stepper in (stepper_of(table), ReplayStepper(table.model, states)):
                stepper.advance(step)
                assert table.values(stepper).tobytes() == whole[step, 1:].tobytes()


def test_text_over_one_late_image_says_what_the_trace_says() -> None:
    table = table_of()
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), [0, 150, STEPS])])
    drift = [column.name for column in table.columns].index("energy/drift")
    timeline = Timeline.of_steps(rational(table.model.opt.timestep), STEPS)
    overlay = overlay_probes(table.model, timeline, "{energy/drift:.17g}")
    stepper = PhysicsStepper(overlay.model, mujoco.MjData(overlay.model))
    stepper.advance(150)
    values = overlay.read(stepper)
    assert values.tolist() == [whole[1, drift]]
    assert values[0] < 0


def test_an_event_sees_the_drift_since_the_start() -> None:
    table = table_of()
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    drift = whole[:, [column.name for column in table.columns].index("energy/drift")]
    limit = float(drift[200])
    detector = EventDetector(table.model, Timeline.of_steps(rational("0.002"), STEPS), [f"energy/drift < {limit!r}"])
    run_with_taps(stepper_of(table), detector.taps(STEPS), STEPS)
    (steps,) = detector.event_steps.values()
    assert steps[0] == int(np.argmax(drift < limit)) > 0
    detector.close()


def test_an_event_may_be_about_energy_in_a_model_that_leaves_it_out() -> None:
    table = table_of()
    whole = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    kinetic = whole[:, [column.name for column in table.columns].index("energy/kinetic")]
    limit = float(kinetic[60])
    model = mujoco.MjModel.from_xml_string(MODEL.format(integrator="Euler"))
    detector = EventDetector(model, Timeline.of_steps(rational("0.002"), STEPS), [f"energy/kinetic > {limit!r}"])
    run_with_taps(PhysicsStepper(model, mujoco.MjData(model)), detector.taps(STEPS), STEPS)
    (steps,) = detector.event_steps.values()
    assert steps[0] == int(np.argmax(kinetic > limit)) > 0
    detector.close()


SENSORS = """
<mujoco>
  <option integrator="{integrator}"><flag energy="{energy}"/></option>
  <worldbody><body><joint name="h" axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body></worldbody>
  <sensor><jointpos joint="h"/><e_kinetic name="all"/><e_kinetic name="some" cutoff=".002"/><e_potential/></sensor>
</mujoco>
"""


@pytest.mark.parametrize("probes", [["sensor"], ["sensor[all]", "sensor[some]", "energy", "cacc"]])
@pytest.mark.parametrize("energy", ["enable", "disable"])
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_a_sensor_of_kinetic_energy_belongs_to_the_instant_of_its_row(
    integrator: str, energy: str, probes: Sequence[str]
) -> None:
    model = mujoco.MjModel.from_xml_string(SENSORS.format(integrator=integrator, energy=energy))
    table = ProbeSampler(model, ["qvel", *probes], Timeline.of_steps(rational(model.opt.timestep), STEPS))
    rows = np.concatenate([block().values for block in table.blocks(stepper_of(table), range(STEPS + 1))])
    velocity, whole, limited = (rows[:, table.names.index(name)] for name in ("qvel/h", "sensor/all", "sensor/some"))
    inertia = model.dof_M0[0]  # constant: there is one hinge
    np.testing.assert_allclose(whole, inertia * velocity**2 / 2, rtol=1e-12)
    assert np.array_equal(limited, np.minimum(whole, 0.002))
    assert whole.max() > 0.002


FIELDS = ("qpos", "qvel", "act", "ctrl", "qacc", "energy", "sensordata", "xpos", "cvel", "ncon", "qfrc_constraint")
BODY = """
<mujoco>
  <option integrator="{integrator}"><flag energy="enable" {flags}/></option>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .3"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/><site name="s"/></body>
    <body pos="1 0 1"><joint name="h" axis="0 1 0" damping=".1"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
  <actuator><general name="g" joint="h" dyntype="filter" dynprm=".1"/></actuator>
  <sensor><accelerometer site="s"/><jointvel joint="h"/></sensor>
  <keyframe><key qvel="0 0 0 1 2 3 0" ctrl=".5"/></keyframe>
</mujoco>
"""


def start(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def bare(model: mujoco.MjModel, data: mujoco.MjData, fields: Sequence[str], steps: int) -> dict[str, np.ndarray]:
    """Every instant of a loop that anyone would write, were it not so slow."""
    rows: dict[str, list[np.ndarray]] = {field: [] for field in fields}
    for _ in range(steps + 1):
        shown = mujoco.MjData(model)
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        for field in fields:
            rows[field].append(np.array(getattr(shown, field)).ravel())
        mujoco.mj_step(model, data)
    return {field: np.stack(values) for field, values in rows.items()}


def streamed(stepper: PhysicsStepper, fields: Sequence[str], steps: int, chunk: int) -> dict[str, np.ndarray]:
    found: dict[str, list[np.ndarray]] = {field: [] for field in fields}
    expected = stepper.step
    for first, _, block in blocks(stepper, fields, steps, chunk):
        assert first == expected
        for field in fields:
            found[field].append(block[field][0].reshape(block[field].shape[1], -1))
        expected += len(found[fields[0]][-1])
    return {field: np.concatenate(parts) for field, parts in found.items()}


@pytest.mark.parametrize(
    ("integrator", "chunk"),
    [("Euler", 1), ("Euler", 100), ("RK4", 7), ("RK4", 1000), ("implicit", 1000), ("implicitfast", 7)],
)
def test_every_row_is_one_instant_to_the_last_bit(integrator: str, chunk: int) -> None:
    model, data = start(BODY.format(integrator=integrator, flags=""))
    stepper = PhysicsStepper(model, data)
    found, expected = streamed(stepper, FIELDS, 200, chunk), bare(model, data, FIELDS, 200)
    assert expected["ncon"].max() > 0
    for field in FIELDS:
        assert found[field].tobytes() == expected[field].astype(found[field].dtype).tobytes(), field
    assert stepper.step == 200


def test_bodies_that_sleep_are_measured_as_they_are() -> None:
    model, data = start(BODY.format(integrator="Euler", flags='sleep="enable"'))
    data.qvel[:] = 0
    found = streamed(PhysicsStepper(model, data), FIELDS, 150, 50)
    expected = bare(model, data, FIELDS, 150)
    assert all(found[field].tobytes() == expected[field].astype(found[field].dtype).tobytes() for field in FIELDS)


def test_a_warning_that_is_no_failure_does_not_stop_the_rows() -> None:
    text = """<mujoco><worldbody><body><joint name="j"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""
    model, data = start(text)
    data.ctrl[0] = np.nan  # for which MuJoCo substitutes zero
    again = mujoco.MjData(model)
    again.ctrl[0] = np.nan
    found = streamed(PhysicsStepper(model, data), ("qpos", "qvel"), 60, 20)
    mujoco.mj_step(model, again, nstep=60)
    assert again.warning[int(mujoco.mjtWarning.mjWARN_BADCTRL)].number
    assert found["qpos"].shape == (61, model.nq)
    assert np.array_equal(found["qpos"][-1], again.qpos)


def test_rows_before_an_instability_are_all_there_and_good() -> None:
    text = '<mujoco><worldbody><body><joint type="slide"/><geom size="1"/></body></worldbody></mujoco>'
    model, data = start(text)
    data.qvel[0] = 1e10 - 1
    model.opt.gravity[2] = 1000
    rows: list[float] = []

    def collect() -> None:
        for _, _, block in blocks(PhysicsStepper(model, data), ("qvel",), 500, 64):
            rows.extend(np.asarray(block["qvel"]).reshape(-1))

    with pytest.raises(UnstableError) as caught:
        collect()
    assert len(rows) == caught.value.step + 1
    assert np.abs(rows).max() < mujoco.mjMAXVAL


def test_a_velocity_that_leaves_the_limits_in_the_very_last_step_is_an_instability() -> None:
    text = '<mujoco><worldbody><body><joint type="slide"/><geom size="1"/></body></worldbody></mujoco>'
    model, data = start(text)
    model.opt.gravity[2] = -1000
    data.qvel[0] = -1e10 + 5  # loses 2 in a step, so the third leaves
    with pytest.raises(UnstableError) as caught:
        streamed(PhysicsStepper(model, data), ("qvel",), 3, 64)
    assert caught.value.step == 2


@pytest.mark.parametrize(
    ("memory", "height", "error"), [("20K", 0.06, FailedStepError), ("12K", 0.04, ContactMemoryError)]
)
def test_rows_end_before_a_step_for_which_memory_runs_out(memory: str, height: float, error: type[Exception]) -> None:
    spheres = "".join(f'<body pos="{x / 8} 0 {height}"><freejoint/><geom size=".05"/></body>' for x in range(6))
    text = (
        f'<mujoco><size memory="{memory}"/><worldbody><geom type="plane" size="1 1 1"/>{spheres}</worldbody></mujoco>'
    )
    model, data = start(text)
    with pytest.raises(error):
        streamed(PhysicsStepper(model, data), ("qpos",), 100, 64)
