"""Theorems about stepping: bit for bit a bare `mj_step` loop, and the first bad step found as it would be there."""

import copy
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import ContactMemoryError, FailedStepError, SimulationError, UnstableError
from mjrun.physics.stepper import CHUNK, PhysicsStepper

STEPS = 160
LIMIT = 1e10  # mjMAXVAL
BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
FIELDS = ("time", "qpos", "qvel", "act", "ctrl", "qacc_warmstart")
DERIVED = (
    *("qacc", "xpos", "xquat", "geom_xpos", "cvel", "energy", "sensordata", "actuator_force", "subtree_com"),
    *("ncon", "nefc", "efc_force", "qfrc_constraint", "qfrc_passive", "qfrc_bias", "ten_length"),
)
# A box that tumbles onto a plane and against a driven arm: contacts, limits, activations, sensors.
TUMBLE = """<mujoco><option integrator="{}"><flag energy="enable"/></option><worldbody><geom type="plane" size="5 5 1"/>
<body pos="0 0 .3" euler="20 30 0"><freejoint name="box"/><geom name="box" type="box" size=".1 .15 .2"/></body>
<body pos=".3 0 .5"><joint name="arm" axis="0 1 0" range="-60 60" damping=".1"/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/></body>
</worldbody><actuator><position name="servo" joint="arm" kp="20" timeconst=".05"/></actuator>
<sensor><jointpos joint="arm"/><jointactuatorfrc joint="arm"/></sensor>
<keyframe><key name="thrown" qpos="0 0 .25 .9 .1 .2 0 .5" qvel="1 0 2 3 2 1 -4" act=".3" ctrl="1"/></keyframe>
</mujoco>"""
INTEGRATORS = ("Euler", "RK4", "implicitfast")


@cache
def tumble(integrator: str = "Euler") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TUMBLE.format(integrator))


def start(model: mujoco.MjModel, key: int | None) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    return data


def bits(data: mujoco.MjData, fields: Sequence[str] = FIELDS) -> dict[str, bytes]:
    return {field: np.asarray(getattr(data, field)).tobytes() for field in fields}


def state(stepper: PhysicsStepper) -> dict[str, bytes]:
    """The state of a stepper, in an MjData of its own."""
    data = mujoco.MjData(stepper.model)
    mujoco.mj_setState(stepper.model, data, stepper.state(), int(mujoco.mjtState.mjSTATE_INTEGRATION))
    return bits(data)


@cache
def bare(integrator: str = "Euler", key: int | None = None) -> tuple[dict[str, bytes], ...]:
    """The state at every step of a bare loop."""
    model = tumble(integrator)
    data = start(model, key)
    states = [bits(data)]
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        states.append(bits(data))
    return tuple(states)


@pytest.mark.parametrize("key", [None, 0])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_every_step_is_that_of_a_bare_loop_to_the_last_bit(integrator: str, key: int | None) -> None:
    model = tumble(integrator)
    stepper = PhysicsStepper(model, start(model, key))
    for step, expected in enumerate(bare(integrator, key)):
        stepper.advance(step)
        assert stepper.step == step
        assert state(stepper) == expected


@given(st.sampled_from(INTEGRATORS), st.lists(st.integers(0, STEPS), max_size=8), st.booleans())
@settings(max_examples=25, deadline=None)
def test_the_pieces_in_which_it_advances_do_not_matter(integrator: str, stops: list[int], looks: bool) -> None:
    model = tumble(integrator)
    stepper = PhysicsStepper(model, start(model, 0))
    for stop in [*sorted(stops), STEPS]:
        stepper.advance(stop)
        assert state(stepper) == bare(integrator, 0)[stop]
        if looks:
            stepper.instant()
    assert state(stepper) == bare(integrator, 0)[STEPS]


@pytest.mark.parametrize("piece", [1, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK])
def test_pieces_about_the_size_of_a_chunk_do_not_matter(piece: int) -> None:
    stepper = PhysicsStepper(tumble(), start(tumble(), None))
    for stop in range(0, STEPS + 1, piece):
        stepper.advance(stop)
        assert state(stepper) == bare()[stop]


def test_the_oracle_has_contacts_and_moves() -> None:
    model = tumble()
    data = start(model, 0)
    mujoco.mj_step(model, data, STEPS)
    assert data.ncon > 0
    assert bits(data) == bare("Euler", 0)[STEPS] != bare()[STEPS]


def test_it_cannot_go_back() -> None:
    stepper = PhysicsStepper(tumble(), start(tumble(), None))
    stepper.advance(7)
    with pytest.raises(ValueError, match="cannot go back from step 7 to step 6"):
        stepper.advance(6)
    assert (stepper.step, state(stepper)) == (7, bare()[7])


def test_the_callers_model_and_data_are_not_changed() -> None:
    model = copy.copy(tumble())
    data = start(model, 0)
    before = bits(data)
    stepper = PhysicsStepper(model, data)
    stepper.advance(STEPS)
    stepper.instant()
    assert bits(data) == before
    assert model.opt.disableflags == 0
    assert stepper.model.opt.disableflags == int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


def test_what_the_caller_does_to_the_model_afterwards_does_not_matter() -> None:
    model = copy.copy(tumble())
    stepper = PhysicsStepper(model, start(model, None))
    model.opt.gravity = 0
    stepper.advance(STEPS)
    assert state(stepper) == bare()[STEPS]


def test_a_state_is_the_readers_to_keep_and_to_change() -> None:
    stepper = PhysicsStepper(tumble(), start(tumble(), None))
    first = stepper.state()
    kept = first.copy()
    for step in (5, 9):
        stepper.advance(step)
        stepper.state()
        assert np.array_equal(first, kept)
    stepper.state()[:] = 0
    stepper.advance(STEPS)
    assert state(stepper) == bare()[STEPS]


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_an_instant_is_mj_forward_at_the_same_state_of_an_independent_simulation(integrator: str) -> None:
    model = tumble(integrator)
    stepper = PhysicsStepper(model, start(model, 0))
    data = start(model, 0)
    for step in range(STEPS):
        stepper.advance(step)
        forward = copy.copy(data)
        mujoco.mj_forward(model, forward)
        assert bits(stepper.instant(), (*FIELDS, *DERIVED)) == bits(forward, (*FIELDS, *DERIVED))
        assert bits(stepper.instant()) == bits(data)
        mujoco.mj_step(model, data)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_steps_that_are_read_together_are_those_that_are_read_one_by_one(integrator: str) -> None:
    model = tumble(integrator)
    together, alone = (PhysicsStepper(model, start(model, 0)) for _ in range(2))
    for count in (1, 30, 7):
        expected = list[dict[str, bytes]]()
        for _ in range(count):
            expected.append(bits(alone.instant(), (*FIELDS, *DERIVED)))
            alone.advance(alone.step + 1)
        found = list[dict[str, bytes]]()
        assert together.read_steps(count, lambda data: [partial(bits, data, (*FIELDS, *DERIVED))], found)
        assert found == expected
        assert (together.step, state(together)) == (alone.step, state(alone))


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("fall", ["too_fast", "too_far"])
def test_steps_that_are_read_together_are_not_taken_if_one_of_them_fails(fall: str) -> None:
    model = {"too_fast": too_fast, "too_far": too_far}[fall](5)
    first, before = first_bad(model)
    stepper = PhysicsStepper(model, mujoco.MjData(model))
    assert not stepper.read_steps(first + 1, lambda _: (), [])
    assert stepper.step == 0
    with pytest.raises(UnstableError):
        stepper.advance(first + 1)
    assert state(stepper) == before


SLEEPY = mujoco.MjModel.from_xml_string("""<mujoco><option><flag sleep="enable"/></option><worldbody>
<geom type="plane" size="5 5 1"/><body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
<body pos="1 0 .5"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>""")


def test_an_instant_of_a_simulation_in_which_bodies_sleep_is_what_the_next_step_computes() -> None:
    stepper = PhysicsStepper(SLEEPY, mujoco.MjData(SLEEPY))
    data = mujoco.MjData(SLEEPY)
    for step in range(400):
        stepper.advance(step)
        mujoco.mj_step(SLEEPY, data)
        if step % 20 == 10:
            assert bits(stepper.instant(), ("ncon", "nefc", "qacc")) == bits(data, ("ncon", "nefc", "qacc"))
    assert (data.tree_asleep >= 0).any()


def resumed(model: mujoco.MjModel, data: mujoco.MjData, step: int, until: int) -> dict[str, bytes]:
    """The state at `until` when only the state at `step` is kept on the way."""
    stepper = PhysicsStepper(model, data)
    stepper.advance(step)
    later = mujoco.MjData(model)
    mujoco.mj_setState(model, later, stepper.state(), int(mujoco.mjtState.mjSTATE_INTEGRATION))
    rest = PhysicsStepper(model, later)
    rest.advance(until - step)
    return state(rest)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("step", [1, 77])
def test_a_state_is_enough_to_go_on_bit_for_bit(integrator: str, step: int) -> None:
    model = tumble(integrator)
    assert resumed(model, start(model, 0), step, STEPS) == bare(integrator, 0)[STEPS]


def test_looking_at_a_simulation_in_which_bodies_sleep_does_not_wake_them() -> None:
    stepper = PhysicsStepper(SLEEPY, mujoco.MjData(SLEEPY))
    data = mujoco.MjData(SLEEPY)
    for step in range(0, 1001, 10):
        stepper.advance(step)
        stepper.instant()
        assert state(stepper) == bits(data)
        mujoco.mj_step(SLEEPY, data, 10)


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory for MuJoCo's log."""
    monkeypatch.chdir(tmp_path)


def first_bad(model: mujoco.MjModel) -> tuple[int, dict[str, bytes]]:
    """The last good step of a bare loop that looks at the warning counters after every step, and its state.

    MuJoCo looks at position and velocity when a step begins and at acceleration in its middle: the state
    that a bad acceleration comes from is good, one that is bad itself is not.
    """
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data = mujoco.MjData(model)
    states = []
    while not any(data.warning[kind].number for kind in BAD):
        states.append(bits(data))
        mujoco.mj_step(model, data)
    bad_itself = any(data.warning[kind].number for kind in BAD[:2])
    good = len(states) - 1 - bad_itself
    return good, states[good]


def falling(acceleration: float, timestep: float) -> mujoco.MjModel:
    """A mass under constant acceleration: v_k = a·dt·k and q_k = a·dt²·k(k+1)/2 after k steps."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
<option timestep="{timestep!r}" gravity="{acceleration!r} 0 0"/>
<worldbody><body name="mass"><joint name="fall" type="slide" axis="1 0 0"/><geom size="1"/></body></worldbody>
</mujoco>""")


def too_fast(step: int) -> mujoco.MjModel:
    """A fall whose velocity, and nothing else, passes the limit at `step` ≥ 2."""
    timestep = 1.5 / step
    return falling(LIMIT / (timestep * (step - 0.5)), timestep)


def too_far(step: int) -> mujoco.MjModel:
    """A fall whose position, and nothing else, passes the limit at `step`."""
    return falling(LIMIT / (50 * step**2), 10.0)


def diverge(model: mujoco.MjModel, until: int = 10**6) -> tuple[PhysicsStepper, UnstableError]:
    stepper = PhysicsStepper(model, mujoco.MjData(model))
    with pytest.raises(UnstableError) as caught:
        stepper.advance(until)
    return stepper, caught.value


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("step", [2, 3, 25, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK - 1, 2 * CHUNK, 2 * CHUNK + 1])
@pytest.mark.parametrize(("fall", "quantity"), [(too_fast, "velocity"), (too_far, "position")])
def test_the_first_bad_step_is_that_of_the_closed_form_wherever_it_lies_in_a_chunk(
    fall: Callable[[int], mujoco.MjModel], quantity: str, step: int
) -> None:
    model = fall(step)
    stepper, error = diverge(model)
    good, expected = first_bad(model)
    assert stepper.step == error.step == good == step - 1
    assert state(stepper) == expected
    assert error.time == pytest.approx((step - 1) * model.opt.timestep)
    assert str(error).splitlines()[0].endswith(f"the {quantity} of joint 'fall' is not finite or too large")


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("until", [2 * CHUNK, 2 * CHUNK + 1, 3 * CHUNK, 10**9])
def test_how_far_it_was_to_go_does_not_matter(until: int) -> None:
    stepper, error = diverge(too_fast(2 * CHUNK), until)
    assert stepper.step == error.step == 2 * CHUNK - 1


@pytest.mark.usefixtures("workplace")
def test_a_run_that_ends_before_the_first_bad_step_is_good() -> None:
    model = too_fast(2 * CHUNK)
    stepper = PhysicsStepper(model, mujoco.MjData(model))
    stepper.advance(2 * CHUNK - 1)
    assert state(stepper) == first_bad(model)[1]


def spring(start: float, joint: str = 'name="spring"', body: str = 'name="mass"') -> mujoco.MjModel:
    """A mass that a negative spring throws away: its acceleration passes the limit first."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option gravity="0 0 0"/><worldbody>
<body><joint name="still" type="slide" axis="0 1 0"/><geom size=".1"/>
<body {body}><joint {joint} type="slide" axis="1 0 0" stiffness="-1e5" springref="{start!r}"/><geom size=".1"/></body>
</body></worldbody></mujoco>""")


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast", "implicit"])
@pytest.mark.parametrize("exponent", range(-40, 9, 12))
def test_the_first_bad_acceleration_is_found_as_a_bare_loop_finds_it(integrator: str, exponent: int) -> None:
    model = spring(10.0**exponent)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    stepper, error = diverge(model)
    good, expected = first_bad(model)
    assert stepper.step == error.step == good
    assert state(stepper) == expected
    assert np.isfinite(stepper.state()).all()
    assert error.time == pytest.approx(good * model.opt.timestep)


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize(
    ("joint", "body", "name"),
    [
        ('name="spring"', 'name="mass"', "joint 'spring'"),
        ("", 'name="mass"', "joint 'joint:1' of body 'mass'"),
        ("", "", "joint 'joint:1' of body 'body:2'"),
    ],
)
def test_the_joint_to_blame_is_named_and_an_unnamed_one_by_its_body(joint: str, body: str, name: str) -> None:
    _, error = diverge(spring(1e-6, joint, body))
    assert error.joint == name
    assert f"the acceleration of {name} is not finite" in str(error)


@pytest.mark.usefixtures("workplace")
def test_the_joint_to_blame_is_found_behind_joints_of_many_coordinates() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0"/><worldbody>
<body><freejoint name="a"/><geom size="1"/></body><body pos="9 0 0"><joint name="b" type="ball"/><geom size="1"/></body>
<body pos="0 9 0"><joint name="c" type="slide"/><geom size="1"/></body></worldbody></mujoco>""")
    for name, address in (("a", 5), ("b", 6), ("b", 8), ("c", 9)):
        data = mujoco.MjData(model)
        data.qfrc_applied[address] = 1e30
        with pytest.raises(UnstableError) as caught:
            PhysicsStepper(model, data).advance(1)
        assert (caught.value.step, caught.value.joint) == (0, f"joint '{name}'")


@pytest.mark.usefixtures("workplace")
def test_time_never_goes_back_and_asking_again_fails_again_at_the_same_step() -> None:
    model = spring(1e-6)
    stepper, first = diverge(model)
    kept = state(stepper)
    for _ in range(3):
        with pytest.raises(UnstableError) as caught:
            stepper.advance(first.step + 60)
        assert (caught.value.step, str(caught.value)) == (first.step, str(first))
        assert (stepper.step, state(stepper)) == (first.step, kept)
    assert stepper.instant().time == pytest.approx(first.step * model.opt.timestep)
    stepper.advance(first.step)


def crowded(memory: str) -> mujoco.MjModel:
    """Boxes that come down one after another, until their contacts need more memory than there is."""
    boxes = "".join(
        f'<body pos="{0.3 * i} 0 {0.2 + 0.05 * i}"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
        for i in range(12)
    )
    return mujoco.MjModel.from_xml_string(f"""<mujoco><size memory="{memory}"/><worldbody>
<geom type="plane" size="5 5 1"/>{boxes}</worldbody></mujoco>""")


def first_fatal(model: mujoco.MjModel) -> tuple[int, dict[str, bytes]]:
    """The step of a bare loop in which MuJoCo gives up, and the state before it."""
    data = mujoco.MjData(model)
    states = []
    with suppress(mujoco.FatalError):
        while len(states) < 1000:
            states.append(bits(data))
            mujoco.mj_step(model, data)
    return len(states) - 1, states[-1]


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("memory", ["30K", "35K", "40K", "50K"])
def test_the_step_in_which_mujoco_gives_up_is_that_of_a_bare_loop(memory: str) -> None:
    model = crowded(memory)
    stepper = PhysicsStepper(model, mujoco.MjData(model))
    with pytest.raises(FailedStepError) as caught:
        stepper.advance(10**6)
    failed, expected = first_fatal(model)
    assert caught.value.step == stepper.step == failed
    assert state(stepper) == expected
    assert str(caught.value).startswith(f"MuJoCo failed at step {failed}, time {failed * 0.002:.9g} s: ")
    with pytest.raises(FailedStepError) as again:
        stepper.advance(10**6)
    assert again.value.step == failed


def landing(integrator: str) -> mujoco.MjModel:
    """Spheres whose constraints, when they land, need more memory than there is."""
    spheres = "".join(f'<body pos="{x / 8} 0 .06"><freejoint/><geom size=".05"/></body>' for x in range(6))
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option integrator="{integrator}"/><size memory="12K"/>
<worldbody><geom type="plane" size="1 1 1"/>{spheres}</worldbody></mujoco>""")


def first_shortage(model: mujoco.MjModel) -> tuple[int, dict[str, bytes]]:
    """The step of a bare loop in which MuJoCo leaves out constraints, and the state before it."""
    data = mujoco.MjData(model)
    full = data.warning[int(mujoco.mjtWarning.mjWARN_CNSTRFULL)]
    states = []
    while not full.number and len(states) < 1000:
        states.append(bits(data))
        mujoco.mj_step(model, data)
    assert full.number
    return len(states) - 1, states[-1]


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("observed", [False, True])
@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_a_step_without_some_of_its_contacts_is_a_failure_of_the_simulation(integrator: str, observed: bool) -> None:
    model = landing(integrator)
    stepper = PhysicsStepper(model, mujoco.MjData(model))
    failed, expected = first_shortage(model)
    assert failed > 5

    def watch() -> None:
        for step in range(100):
            stepper.advance(step)
            stepper.instant()

    for _ in range(2):
        with pytest.raises(ContactMemoryError) as caught:
            watch() if observed and not stepper.step else stepper.advance(100)
        assert caught.value.step == stepper.step == failed
        assert state(stepper) == expected


@pytest.mark.usefixtures("workplace")
def test_an_instant_in_which_mujoco_gives_up_is_a_failure_of_the_simulation() -> None:
    model = crowded("30K")
    stepper = PhysicsStepper(model, mujoco.MjData(model))
    stepper.advance(first_fatal(model)[0])
    with pytest.raises(SimulationError):
        stepper.instant()
