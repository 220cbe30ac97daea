"""Pushes against bare loops that set xfrc_applied by hand, and against Newton's and Euler's laws."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.options.simulation import PushKind
from mjrun.physics.control import ControlSources, PeriodicController, PushForces
from mjrun.physics.stepper import PhysicsStepper
from mjrun.timeline import rational
from tests.cases import cases
from tests.physics.driven_arm import by_instants, stepped_in_c

STEPS = 150
FIELDS = (
    *("qpos", "qvel", "act", "qacc", "xfrc_applied", "qfrc_constraint", "sensordata", "energy", "subtree_com", "ncon"),
)
BOX = """<mujoco><option integrator="{integrator}"><flag energy="enable" {flags}/></option><worldbody>
<geom type="plane" size="5 5 1"/>
<body name="box" pos="0 0 .25" euler="20 30 0"><freejoint name="box"/><geom type="box" size=".1 .15 .2"/>
<geom size=".05" pos=".2 0 0"/><site name="corner" pos=".1 .15 .2"/></body>
<body name="arm" pos=".5 0 .5"><joint name="arm" axis="0 1 0" damping=".1"/><geom type="capsule" fromto="0 0 0 0 0 -.4"
size=".03"/><site name="tip" pos="0 0 -.4"/></body>
<body name="post" pos="2 0 0"><geom size=".1"/><site name="top"/></body><site name="ground"/>
</worldbody><actuator><position name="servo" joint="arm" kp="20" timeconst=".05"/></actuator>
<sensor><accelerometer site="corner"/><force site="tip"/></sensor></mujoco>"""
TWO = ("box=0/30/5@0.05+0.1", "site:corner=4/0/-2@0.1+0.15", "tip=3/0/0@0+0.01", "body:arm=0/1/2@0.299+0.2")


def box(integrator: str = "Euler", flags: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(BOX.format(integrator=integrator, flags=flags))


def stepper(
    model: mujoco.MjModel, texts: Sequence[str], own: np.ndarray | None = None, control: ControlSources | None = None
) -> PhysicsStepper:
    data = mujoco.MjData(model)
    if own is not None:
        data.xfrc_applied[:] = own
    return PhysicsStepper(model, data, control, PushForces(model, [*map(PushKind().parse, texts)], step_of(model)))


def step_of(model: mujoco.MjModel) -> Fraction:
    return rational(model.opt.timestep)


def set_by_hand(model: mujoco.MjModel, data: mujoco.MjData, own: np.ndarray, step: int) -> None:
    """The four pushes of `TWO`, as anyone would write them in a loop. The timestep is 2 ms."""
    shown = mujoco.MjData(model)
    shown.qpos[:] = data.qpos
    mujoco.mj_kinematics(model, shown)

    added = np.zeros((model.nbody, 6))
    box, arm = model.body("box").id, model.body("arm").id
    if 25 <= step < 75:
        added[box, :3] += (0, 30, 5)
    if 50 <= step < 125:
        added[box, :3] += (4, 0, -2)
        added[box, 3:] += np.cross(shown.site("corner").xpos - shown.body("box").xipos, (4, 0, -2))
    if step < 5:
        added[arm, :3] += (3, 0, 0)
        added[arm, 3:] += np.cross(shown.site("tip").xpos - shown.body("arm").xipos, (3, 0, 0))
    if step >= 150:  # 149.5, rounded up
        added[arm, :3] += (0, 1, 2)
    data.xfrc_applied[:] = own + added


def bare(model: mujoco.MjModel, own: np.ndarray, act: Callable[[mujoco.MjData, int], None] | None = None):
    """Every instant of a bare loop, by field."""
    data, shown = mujoco.MjData(model), mujoco.MjData(model)
    rows: dict[str, list[np.ndarray]] = {field: [] for field in FIELDS}
    for step in range(STEPS + 1):
        if act:
            act(data, step)
        set_by_hand(model, data, own, step)
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        for field in FIELDS:
            rows[field].append(np.array(getattr(shown, field), float).ravel())
        mujoco.mj_step(model, data)
    return {field: np.stack(values) for field, values in rows.items()}


@pytest.mark.parametrize(
    ("integrator", "flags"), [("Euler", ""), ("Euler", 'sleep="enable"'), ("RK4", ""), ("implicitfast", "")]
)
def test_every_instant_is_that_of_a_loop_with_forces_set_by_hand(integrator: str, flags: str) -> None:
    model = box(integrator, flags)
    own = np.zeros((model.nbody, 6))
    own[1, 2], own[2, 4] = 1.5, -0.25  # forces that are there without the pushes
    expected = bare(model, own)
    for run in (by_instants, stepped_in_c):
        found = run(stepper(model, TWO, own), STEPS, FIELDS)
        for field in FIELDS:
            assert found[field].astype(float).tobytes() == expected[field].tobytes(), (run, field)
    assert expected["ncon"].max() > 0


@pytest.mark.parametrize("run", [by_instants, stepped_in_c])
def test_a_controller_reads_and_writes_applied_forces_without_the_pushes(run) -> None:
    model, read = box(), list[np.ndarray]()

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        read.append(data.xfrc_applied.copy())
        data.xfrc_applied[1, 0] += 0.5

    own = np.zeros((model.nbody, 6))

    def by_hand(data: mujoco.MjData, step: int) -> None:
        if step % 10 == 0:
            own[1, 0] += 0.5

    controller = PeriodicController(act, Fraction(2, 100), step_of(model))
    control = ControlSources(step_of(model), np.zeros(model.nu), controller=controller)
    found, expected = run(stepper(model, TWO, control=control), STEPS, FIELDS), bare(model, own, by_hand)
    for field in FIELDS:
        assert found[field].astype(float).tobytes() == expected[field].tobytes(), field
    assert [forces[1].tolist() for forces in read] == [[0.5 * k, 0, 0, 0, 0, 0] for k in range(len(read))]
    assert len(read) == STEPS // 10 + 1


def test_a_controller_feels_the_push_of_its_instant() -> None:
    model = box(flags='contact="disable"')
    felt: dict[float, np.ndarray] = {}

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        felt[round(data.time / model.opt.timestep)] = data.qacc[:3].copy()

    control = ControlSources(
        step_of(model), np.zeros(1), controller=PeriodicController(act, step_of(model), step_of(model))
    )
    stepper(model, ["box=0/0/900@0.02+0.01"], control=control).advance(30)
    assert [step for step, acceleration in felt.items() if acceleration[2] > 0] == [10, 11, 12, 13, 14]


@pytest.mark.parametrize("at", ["0", "0.1", "1/3", "0.0009", "0.0011"])
@pytest.mark.parametrize("duration", ["0.0032", "0.1", "1/7"])
@pytest.mark.parametrize("timestep", [0.002, 0.003, 1 / 480])
def test_a_free_body_gains_force_times_time_over_mass(at: str, duration: str, timestep: float) -> None:
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep="{timestep!r}"/><worldbody><body name="b"><freejoint/>'
        '<geom type="box" size=".1 .2 .3" mass="2.5" pos=".3 -.2 .1"/></body></worldbody></mujoco>'
    )
    force, dt = np.array([3.0, -1.0, 0.5]), rational(timestep)
    first = math.floor(Fraction(at) / dt + Fraction(1, 2))
    steps = math.floor((Fraction(at) + Fraction(duration)) / dt + Fraction(1, 2)) - first

    run = stepper(model, [f"b=3/-1/.5@{at}+{duration}"])
    run.advance(first)
    assert not run.instant().qvel.any()
    run.advance(first + steps + 10)
    data = run.instant()
    mujoco.mj_subtreeVel(model, data)
    assert data.subtree_linvel[1] == pytest.approx(force * steps * timestep / 2.5, rel=1e-12)
    assert data.qvel[3:] == pytest.approx(0, abs=1e-15)  # at the centre of mass, nothing turns it


def test_a_force_at_a_site_turns_a_ball_by_lever_times_force() -> None:
    mass, radius = 2.0, 0.5
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="b" quat=".8 .6 0 0"><freejoint/>'
        f'<geom size="{radius}" mass="{mass}" pos=".1 .2 .3"/><site name="rim" pos=".1 .2 .8"/></body>'
        "</worldbody></mujoco>"
    )
    force, turn = np.array([1.0, 2.0, 3.0]), np.array([[1, 0, 0], [0, 0.28, -0.96], [0, 0.96, 0.28]])
    run = stepper(model, ["rim=1/2/3@0+0.002"])
    run.advance(1)
    data = run.instant()
    torque = np.cross(turn @ (0, 0, radius), force)
    assert data.cvel[1, :3] == pytest.approx(torque * 0.002 / (0.4 * mass * radius**2), rel=1e-12)
    mujoco.mj_subtreeVel(model, data)
    assert data.subtree_linvel[1] == pytest.approx(force * 0.002 / mass, rel=1e-3)  # the ball has turned a little


def test_a_body_that_is_carried_by_a_mocap_pose_is_pushed_where_it_is() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="hand" mocap="true"><geom size=".1"/><body name="flap"><joint axis="0 1 0"/>'
        '<geom size=".1" pos=".3 0 0"/><site name="edge" pos=".4 0 0"/></body></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.mocap_quat[0] = 0.6, 0, 0, 0.8  # about z: x points to (-.28, .96, 0)
    pushes = PushForces(model, [PushKind()("edge=0/0/2@0+1")], step_of(model))
    assert pushes.on_bodies(data, 0)[2, 3:] == pytest.approx(np.cross((-0.028, 0.096, 0), (0, 0, 2)))


@cases("text, message")
def test_what_cannot_be_pushed_is_refused_with_its_place(text: str, message: str) -> None:
    with pytest.raises((UsageError, UnknownNameError), match=message) as caught:
        stepper(box(), ["box=1/0/0@0+1", text])
    assert caught.value.path == ("push", 1)


def test_pushes_that_do_nothing_are_remarked_on() -> None:
    model = box()
    texts = ["post=1/0/0@0+1", "site:top=1/0/0@0+1", "box=1/0/0@0.2+1", "box=1/0/0@0.198+9"]
    remarks = PushForces(model, [*map(PushKind().parse, texts)], step_of(model)).remarks(100)
    assert [remark.partition(" does nothing: ")[2] for remark in remarks] == [
        "no joint lets the body move",
        "no joint lets the body move",
        "it begins at step 100, and the simulation has 100 steps",
    ]
