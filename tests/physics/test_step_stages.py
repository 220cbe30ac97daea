"""A step that is divided at its instant is bit for bit `mj_step`, whatever is in the model and in the controller."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import ControllerError
from mjrun.model import state
from mjrun.outputs.trace_rows import blocks
from mjrun.physics.control import ControlSources, PeriodicController
from mjrun.physics.stepper import PhysicsStepper
from mjrun.timeline import rational

STEPS = 24
FIELDS = (
    *("qpos", "qvel", "act", "ctrl", "qacc", "qacc_warmstart", "sensordata", "energy", "xpos", "mocap_pos"),
    *("actuator_force", "qfrc_constraint", "ncon", "nefc", "cvel", "solver_niter", "qfrc_bias", "eq_active"),
)
SCENE = """<mujoco>
<option integrator="{integrator}" cone="{cone}" solver="{solver}" timestep="0.004"><flag {flags}/></option>
<size nuserdata="2"/>
<worldbody>
  <geom type="plane" size="5 5 1"/>
  <body name="hand" mocap="true" pos="0 0 .6"><geom size=".02" contype="0" conaffinity="0"/></body>
  <body pos="0 0 .25" euler="20 30 0"><freejoint/><geom type="box" size=".1 .15 .2" condim="{condim}"/></body>
  <body name="arm" pos=".3 0 .5"><joint name="arm" axis="0 1 0" range="-60 60" damping=".1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/><site name="tip" pos="0 0 -.4"/></body>
  <body pos="-.6 0 .5"><joint name="ball" type="ball"/><geom size=".05" pos=".2 0 0"/></body>
</worldbody>
<equality><connect body1="arm" body2="hand" anchor="0 0 -.4" active="false"/></equality>
<tendon><fixed name="both" limited="true" range="-.4 .4"><joint joint="arm" coef="1"/></fixed></tendon>
<actuator>
  <position joint="arm" kp="20" timeconst=".05"/>
  <motor joint="arm" gear=".3" {delay}/>
</actuator>
<sensor><accelerometer site="tip"/><jointvel joint="arm"/><jointpos joint="arm" {delay}/></sensor>
</mujoco>"""


def servo(model, data):
    data.ctrl[:] = [np.sin(40 * data.time) - data.qvel[6], data.qpos[7]]


def measures(model, data):
    force = np.zeros(6)
    if data.ncon:
        mujoco.mj_contactForce(model, data, 0, force)
    return [1e-3 * force[0], 1e-3 * data.sensordata[0]]


def moves_the_hand(model, data):
    data.mocap_pos[0, 0] = 0.1 * np.sin(9 * data.time)
    data.eq_active[0] = int(100 * data.time) % 2
    data.userdata[0] += 1


def moves_the_hand_and_measures(model, data):
    moves_the_hand(model, data)
    return measures(model, data)


def tries_another_pose(model, data):
    qpos = data.qpos.copy()
    data.qpos[7] = 0.5
    mujoco.mj_kinematics(model, data)
    data.ctrl[0] = data.site_xpos[0, 0]
    data.qpos[:] = qpos


def overwrites_what_is_derived(model, data):
    data.xpos[:] = data.qfrc_bias[0]
    data.qfrc_bias[:] = 0
    data.ctrl[1] = data.xpos[1, 0]


def helper(model, data):
    return [0.0, 0.0]


def passes_its_data(model, data):
    return helper(model, data)


def idle(model, data):
    pass


def passes_on(model, data):
    overwrites_what_is_derived(model, data)
    moves_the_hand(model, data)
    return servo(model, data)


def reads_by_name(model, data):
    jacobian, velocity, product = np.zeros((3, model.nv)), np.zeros(6), np.zeros(model.nv)
    mujoco.mj_jacSite(model, data, jacobian, None, 0)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, 2, velocity, 0)
    mujoco.mj_mulM(model, data, product, data.qvel)
    data.actuator(1).ctrl = data.site("tip").xpos[2] - data.joint("arm").qvel
    data.ctrl[0] = jacobian[0, 6] + velocity[1] + product[6]


class Phases:
    """A controller with methods that get the data."""

    def __call__(self, model, data):
        return self.rest(data) if data.time < 0.05 else self.work(model, data)

    def rest(self, data):
        return [data.qpos[7], data.cvel[2, 0]]

    def work(self, model, data):
        moves_the_hand(model, data)
        return self.rest(data)


CONTROLLERS = (
    *(servo, measures, moves_the_hand, moves_the_hand_and_measures, tries_another_pose, overwrites_what_is_derived),
    *(idle, passes_on, reads_by_name, Phases()),
)


@st.composite
def models(draw: st.DrawFn) -> mujoco.MjModel:
    flags = draw(st.lists(st.sampled_from(["energy", "fwdinv", "sleep", "island", "warmstart"]), unique=True))
    toggled = {"island", "warmstart"}  # which are on by default
    integrator = draw(st.sampled_from(["Euler", "RK4", "implicit", "implicitfast", "discrete"]))
    if integrator == "discrete":  # MuJoCo refuses some combinations
        flags = [flag for flag in flags if flag in ("energy", "warmstart")]
    return mujoco.MjModel.from_xml_string(
        SCENE.format(
            integrator=integrator,
            cone=draw(st.sampled_from(["pyramidal", "elliptic"])),
            solver=draw(st.sampled_from(["Newton", "CG", "PGS"])),
            condim=draw(st.sampled_from([1, 3, 4, 6])),
            flags=" ".join(f'{flag}="{"disable" if flag in toggled else "enable"}"' for flag in flags),
            delay=draw(st.sampled_from(["", 'delay="0.01" nsample="4"'])),
        )
    )


def content(data: mujoco.MjData, field: str) -> bytes:
    value = getattr(data, field)
    return (np.int32(value) if isinstance(value, int) else value).tobytes()


def instants(model: mujoco.MjModel, controller: Callable, every: int = 1) -> dict[str, list[bytes]]:
    """Returns every instant of a loop of `mj_step`, whose controller works on a copy, every few steps."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data, shown = mujoco.MjData(model), mujoco.MjData(model)
    rows: dict[str, list[bytes]] = {field: [] for field in FIELDS}
    for step in range(STEPS + 1):
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        controls = None if step % every else controller(model, shown)
        if controls is not None:
            shown.ctrl[:] = controls
        state.restore(model, data, state.save(model, shown, state.INPUTS), state.INPUTS)
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        for field in FIELDS:
            rows[field].append(content(shown, field))
        mujoco.mj_step(model, data)
    return rows


def stepper(model: mujoco.MjModel, controller: Callable, every: int = 1) -> PhysicsStepper:
    timestep = rational(model.opt.timestep)
    periodic = PeriodicController(controller, every * timestep, timestep)
    sources = ControlSources(timestep, np.zeros(model.nu), controller=periodic)
    return PhysicsStepper(model, mujoco.MjData(model), sources)


@settings(max_examples=20, deadline=None)
@given(models(), st.sampled_from(CONTROLLERS), st.sampled_from([1, 2, 3, 5, 8]))
def test_every_instant_and_every_step_are_those_of_a_bare_loop(
    model: mujoco.MjModel, controller: Callable, every: int
) -> None:
    expected = instants(model, controller, every)
    found: dict[str, list[bytes]] = {field: [] for field in FIELDS}
    for _, _, fields in blocks(stepper(model, controller, every), FIELDS, STEPS, 7):
        for field in FIELDS:
            found[field] += [row.tobytes() for row in fields[field][0]]
    assert found == expected


@settings(max_examples=20, deadline=None)
@given(models(), st.sampled_from(CONTROLLERS), st.lists(st.integers(0, STEPS), unique=True), st.integers(1, 9))
def test_looking_at_some_instants_does_not_change_the_motion(
    model: mujoco.MjModel, controller: Callable, looks: list[int], every: int
) -> None:
    watched, alone = stepper(model, controller, every), stepper(model, controller, every)
    for step in sorted(looks):
        watched.advance(step)
        watched.instant()
    for each in (watched, alone):
        each.advance(STEPS)
    assert watched.state().tobytes() == alone.state().tobytes()


class Locates:
    """A controller that notes where the data is."""

    def __init__(self) -> None:
        self.places: set[int] = set()

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.note(data)
        overwrites_what_is_derived(model, data)

    def note(self, data: mujoco.MjData) -> None:
        self.places.add(data.qpos.ctypes.data)


def test_functions_that_get_the_data_work_on_the_data_of_the_step() -> None:
    controller = Locates()
    run = stepper(scene(), controller)
    run.advance(3)
    assert controller.places == {run.instant().qpos.ctypes.data}


def test_a_function_that_is_replaced_meanwhile_may_read_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    model = scene()
    expected = instants(model, lambda model, data: measures(model, data) if data.time else helper(model, data))
    found: dict[str, list[bytes]] = {field: [] for field in FIELDS}
    run = stepper(model, passes_its_data)  # which calls it at step 0
    monkeypatch.setitem(globals(), "helper", measures)
    for step in range(1, STEPS):
        run.advance(step)
        for field in FIELDS:
            found[field].append(content(run.instant(), field))
    assert found == {field: rows[1:STEPS] for field, rows in expected.items()}


def scene(**options: str) -> mujoco.MjModel:
    defaults = {"integrator": "Euler", "cone": "pyramidal", "solver": "Newton", "condim": "3"}
    return mujoco.MjModel.from_xml_string(SCENE.format(**{**defaults, "flags": "", "delay": "", **options}))


def changes_the_state_late(model, data):
    if data.time > 0.03:
        data.qvel[6] = 1


def changes_the_state_of_a_copy(model, data):
    if data.time > 0.03:
        mujoco.mju_zero(data.qpos)
        str(data)


@pytest.mark.parametrize("controller", [changes_the_state_late, changes_the_state_of_a_copy])
def test_a_controller_that_changes_the_state_is_named_with_its_step(controller: Callable) -> None:
    with pytest.raises(ControllerError, match=f"controller {controller.__name__} changed the state at step 8"):
        stepper(scene(), controller).advance(STEPS)


@pytest.mark.parametrize("controller", [servo, measures, moves_the_hand])
def test_warnings_are_counted_once_per_step(controller: Callable) -> None:
    model = scene()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    model.body_inertia[:] = 1e-20  # a warning at every step
    model.dof_armature[:] = 0
    run, data = stepper(model, controller), mujoco.MjData(model)
    mujoco.mj_step(model, data, 4)
    mujoco.mj_forward(model, data)
    run.advance(4)
    assert run.instant().warning.number.tolist() == data.warning.number.tolist()
    assert data.warning.number.any()
