"""Theorems about replaying: the states are those that were recorded, and every instant is that of the live run."""

import copy
import json
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import FailedStepError, UsageError
from mjrun.formats.recording import RecordingReader, RecordingWriter
from mjrun.model import state
from mjrun.physics.control import Controller, ControlSources, PeriodicController
from mjrun.physics.recorded_states import require_model, states_at
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import PhysicsStepper, Stepper
from mjrun.timeline import rational
from tests.physics.tumbler import Kept

SCENES = Path(__file__).parents[2] / "scenes"
# Not of an instant: what only integration computes, where memory is, how much was used, and slots without contents.
FOREIGN = {"qH", "qHDiagInv", "qDeriv", "qLU", "plugin_data", "solver_nnz", "signature", "wrap_obj", "wrap_xpos"}
SPARSE = ("maxuse", "efc_J_", "moment_")
CONTACT = ("dist", "pos", "frame", "geom", "efc_address", "dim", "friction", "solref", "solimp")

TUMBLE = """<mujoco><option integrator="{}"><flag energy="enable"/></option><worldbody><geom type="plane" size="5 5 1"/>
<body pos="0 0 .25" euler="20 30 0"><freejoint name="box"/><geom name="box" type="box" size=".1 .15 .2"/></body>
<body pos=".3 0 .5"><joint name="arm" axis="0 1 0" range="-60 60" damping=".1"/><site name="arm"/>
<geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/></body>
</worldbody><actuator><position name="servo" joint="arm" kp="20" timeconst=".05"/></actuator>
<sensor><jointpos joint="arm"/><jointactuatorfrc joint="arm"/><accelerometer site="arm"/></sensor>
</mujoco>"""
# Delayed actuators and sensors, a mocap body, a weld that comes and goes.
DELAYED = """<mujoco><worldbody><body name="hand" mocap="true" pos="1 0 1"><geom size=".1"/></body>
<body name="ball" pos="0 0 1"><freejoint/><geom size=".1"/></body>
<body><joint name="j" axis="0 1 0"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5"/></body></worldbody>
<equality><weld body1="hand" body2="ball"/></equality>
<actuator><motor name="m" joint="j" delay=".02" nsample="12"/></actuator>
<sensor><jointpos joint="j" delay=".01" nsample="8"/><jointvel joint="j" interval=".007" nsample="3"/></sensor>
</mujoco>"""
PLUGIN = """<mujoco><extension><plugin plugin="mujoco.pid"/></extension><worldbody><body><joint name="j" axis="0 1 0"/>
<geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5"/></body></worldbody>
<actuator><plugin plugin="mujoco.pid" joint="j" actdim="2"><config key="kp" value="20"/><config key="ki" value="30"/>
<config key="slewmax" value="2"/></plugin></actuator></mujoco>"""
# Boxes that fall asleep, one after the other; a ball that falls on one of them and wakes it; one that sleeps at first.
SLEEPY = """<mujoco><option><flag sleep="enable" energy="enable"/></option><worldbody><geom type="plane" size="5 5 1"/>
<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/><site name="box"/></body>
<body pos="1 0 .3"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
<body pos="0 .02 2"><freejoint/><geom size=".1"/></body>
<body pos="3 0 .1" sleep="init"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody>
<sensor><accelerometer site="box"/><gyro site="box"/></sensor></mujoco>"""


@cache
def field_names() -> list[str]:
    """The names of all arrays and numbers of an instant that are compared."""
    data = mujoco.MjData(TUMBLER)
    names = [name for name in dir(data) if not name.startswith(("_", *SPARSE)) and name not in FOREIGN]
    return [name for name in names if isinstance(getattr(data, name), np.ndarray | int | float)]


def fields(stepper: Stepper) -> dict[str, bytes]:
    """Every field of an instant, as bytes."""
    data = stepper.instant()
    contact = data.contact
    found = {name: np.asarray(getattr(data, name)).tobytes() for name in field_names()}
    return found | {f"contact.{name}": getattr(contact, name).tobytes() for name in CONTACT}


def recorded(stepper: PhysicsStepper, steps: Sequence[int]) -> tuple[Kept, list[dict[str, bytes]]]:
    """The states of a live run at `steps`, and its instants."""
    rows: list[np.ndarray] = []
    instants: list[dict[str, bytes]] = []
    run_with_taps(
        stepper,
        [Tap(steps, lambda s: rows.append(s.state())), Tap(steps, lambda s: instants.append(fields(s)))],
        steps[-1],
    )
    return Kept(np.array(steps), np.stack(rows)), instants


def wave(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Moves every input that the state has."""
    data.ctrl[:] = np.sin(20 * data.time)
    data.xfrc_applied[2, 0] = data.time
    if model.nmocap:
        data.mocap_pos[0, 2] = 1 + 0.2 * np.sin(9 * data.time)
    if model.neq:
        data.eq_active[0] = int(data.time * 10) % 2


def live(model: mujoco.MjModel, key: int | None = None, controller: Controller | None = None) -> PhysicsStepper:
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    timestep = rational(model.opt.timestep)
    periodic = None if controller is None else PeriodicController(controller, Fraction(1, 100), timestep)
    return PhysicsStepper(model, data, ControlSources(timestep, data.ctrl.copy(), controller=periodic))


def require_alike(model: mujoco.MjModel, run: PhysicsStepper, steps: Sequence[int]) -> None:
    """A replay of `run` is `run`: its states, and every field of its instants, in order and at random places."""
    kept, instants = recorded(run, steps)
    for stops in (range(len(steps)), range(3, len(steps), 17)):
        replay = ReplayStepper(model, kept, state.sizes(model))
        for index in stops:
            replay.advance(steps[index])
            assert replay.step == steps[index]
            assert replay.state().tobytes() == kept.rows[index].tobytes()
            found = fields(replay)
            assert {name for name in found if found[name] != instants[index][name]} == set()
            assert replay.state().tobytes() == kept.rows[index].tobytes()


@pytest.mark.parametrize("controller", [None, wave])
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast"])
def test_an_instant_is_that_of_the_live_run_to_the_last_bit(integrator: str, controller: Controller | None) -> None:
    model = mujoco.MjModel.from_xml_string(TUMBLE.format(integrator))
    require_alike(model, live(model, controller=controller), range(100))


@pytest.mark.parametrize("controller", [None, wave])
@pytest.mark.parametrize("source", [DELAYED, PLUGIN], ids=["delayed", "plugin"])
def test_history_mocap_bodies_and_plugins_are_replayed_too(source: str, controller: Controller | None) -> None:
    model = mujoco.MjModel.from_xml_string(source)
    assert model.nhistory or model.nplugin
    require_alike(model, live(model, controller=controller if model.nmocap else None), range(100))


@pytest.mark.parametrize("scene", ["arm", "car", "dominos", "humanoid", "pendulum", "pinata", "tippe_top"])
def test_scenes_are_replayed_as_they_ran(scene: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(SCENES / f"{scene}.xml"))
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    require_alike(model, live(model, 0 if model.nkey else None), range(40))


@cache
def sleepy() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SLEEPY)


@pytest.mark.parametrize("stride", [1, 7])
def test_bodies_sleep_and_wake_up_as_they_did(stride: int) -> None:
    require_alike(sleepy(), live(sleepy()), range(0, 500, stride))


def test_the_oracle_of_sleep_sleeps_and_wakes_up() -> None:
    run, asleep = live(sleepy()), []
    for step in range(0, 500, 5):
        run.advance(step)
        asleep.append(bool(run.instant().tree_asleep[0] >= 0))
    assert [a for a, b in pairwise(asleep) if a != b][:2] == [False, True]


def test_a_body_that_physics_would_let_sleep_is_awake_where_the_recording_moves_it() -> None:
    kept, _ = recorded(live(sleepy()), range(200))
    odd = Kept(kept.steps, kept.rows.copy())
    odd.rows[150, 1] += 1e-9  # to where no physics leads
    replay = ReplayStepper(sleepy(), odd)
    replay.advance(149)
    assert replay.instant().tree_asleep[0] >= 0
    replay.advance(150)
    assert replay.state().tobytes() == odd.rows[150].tobytes()
    assert replay.instant().tree_asleep[0] < 0
    bare = mujoco.MjData(sleepy())
    mujoco.mj_setState(sleepy(), bare, odd.rows[150], state.STATE)
    mujoco.mj_forward(sleepy(), bare)
    assert replay.instant().qacc.tobytes() == bare.qacc.tobytes()
    assert replay.instant().xpos.tobytes() == bare.xpos.tobytes()


def test_a_step_that_cannot_be_taken_once_more_costs_nothing_but_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    kept, instants = recorded(live(sleepy()), range(200))

    def fail(model: mujoco.MjModel, data: mujoco.MjData, nstep: int) -> None:
        data.qpos[:] = np.nan
        raise mujoco.FatalError("out of arena")

    replay = ReplayStepper(sleepy(), kept)
    replay.advance(150)
    monkeypatch.setattr(mujoco, "mj_step", fail)
    replay.advance(199)
    assert replay.state().tobytes() == kept.rows[199].tobytes()
    assert replay.instant().tree_asleep[0] < 0
    assert fields(replay)["xpos"] == instants[199]["xpos"]


def test_a_vast_stretch_without_states_is_not_simulated() -> None:
    rows = np.repeat(recorded(live(sleepy()), range(1))[0].rows, 2, axis=0)
    rows[1, 0] = 2.0**40 * sleepy().opt.timestep
    replay = ReplayStepper(sleepy(), Kept(np.array([0, 2**40]), rows))
    replay.advance(2**40)
    assert replay.state().tobytes() == rows[1].tobytes()


def test_a_recording_on_disk_is_replayed_as_it_ran(tmp_path: Path) -> None:
    kept, instants = recorded(live(TUMBLER, controller=wave), range(0, 100, 3))
    with RecordingWriter(str(tmp_path / "run.npz"), kept.size, state.layout(TUMBLER)) as writer:
        for step, row in zip(kept.steps, kept.rows, strict=True):
            writer.write(step, row)
        writer.publish()
    seen: list[dict[str, bytes]] = []
    with RecordingReader(tmp_path / "run.npz") as found:
        replay = ReplayStepper(TUMBLER, found, found.facts)
        run_with_taps(replay, [Tap(found.steps.tolist(), lambda s: seen.append(fields(s)))], 99)
    assert seen == instants


TUMBLER = mujoco.MjModel.from_xml_string(TUMBLE.format("Euler"))


@cache
def tumbled(stride: int = 1, last: int = 60) -> Kept:
    return recorded(live(TUMBLER), range(0, last + 1, stride))[0]


@given(st.lists(st.integers(0, 60), max_size=8).map(sorted))
@settings(max_examples=25, deadline=None)
def test_observing_a_replay_is_observing_the_run(steps: list[int]) -> None:
    seen: list[bytes] = []
    run_with_taps(ReplayStepper(TUMBLER, tumbled()), [Tap(steps, lambda s: seen.append(s.state().tobytes()))], 60)
    assert seen == [tumbled().rows[step].tobytes() for step in steps]


def test_the_callers_model_is_not_changed_and_what_is_read_is_the_readers() -> None:
    model = copy.copy(TUMBLER)
    replay = ReplayStepper(model, tumbled())
    model.opt.gravity = 0
    replay.advance(9)
    replay.state()[:] = 0
    first = replay.instant().qacc.copy()
    assert replay.state().tobytes() == tumbled().rows[9].tobytes()
    assert np.array_equal(replay.instant().qacc, first)
    assert TUMBLER.opt.disableflags == model.opt.disableflags == 0
    assert replay.model.opt.gravity[2] == TUMBLER.opt.gravity[2]


def test_it_cannot_go_back() -> None:
    replay = ReplayStepper(TUMBLER, tumbled())
    replay.advance(7)
    with pytest.raises(ValueError, match="cannot go back from step 7 to step 6"):
        replay.advance(6)
    assert replay.step == 7


END = "the recording ends at step 60, time 0.12 s, before step {}\nrequest step 60 or an earlier one"
GAP = "step 7, time 0.014 s is not in the recording\nthe nearest recorded ones: step 5, time 0.01 s, and step 10, {}"


@pytest.mark.parametrize(
    ("stride", "step", "message"),
    [
        (1, 61, END.format("61, time 0.122 s")),
        (1, 10**9, END.format("1000000000, time 2000000 s")),
        (5, 7, GAP.format("time 0.02 s")),
    ],
)
def test_a_step_that_is_not_recorded_is_told_with_those_that_are(stride: int, step: int, message: str) -> None:
    replay = ReplayStepper(TUMBLER, tumbled(stride))
    for ask in (lambda: replay.advance(step), lambda: replay.require([0, 5, step, 10**10])):
        with pytest.raises(UsageError) as caught:
            ask()
        assert str(caught.value) == message
    assert replay.step == 0
    replay.require(range(0, 61, 5))
    replay.advance(60)
    assert replay.state().tobytes() == tumbled().rows[60].tobytes()


def test_a_recording_of_another_model_is_refused_with_what_differs() -> None:
    with pytest.raises(UsageError) as caught:
        ReplayStepper(sleepy(), tumbled())
    assert str(caught.value) == (
        f"the recording was made with another model: its states have {tumbled().size} numbers, "
        f"those of this model {state.size(sleepy())}\nthis model has nq 28, nv 24, nbody 5"
    )
    with pytest.raises(UsageError) as caught:
        ReplayStepper(sleepy(), tumbled(), state.layout(TUMBLER))
    assert str(caught.value) == (
        "the recording was made with another model: it has nq 8, not 28; nv 7, not 24; na 1, not 0; nu 1, not 0; "
        "nbody 3, not 5"
    )


def test_states_of_the_same_size_may_be_of_another_model() -> None:
    ours = state.sizes(TUMBLER)
    require_model(TUMBLER, tumbled(), {"sizes": ours})
    with pytest.raises(UsageError, match=r"it has nq 9, not 8; na 0, not 1$"):
        require_model(TUMBLER, tumbled(), {"sizes": {**ours, "nq": 9, "na": 0}})


@pytest.mark.parametrize("kind", ["joint", "actuator", "mocap body"])
def test_states_are_not_assigned_to_objects_of_other_names(kind: str) -> None:
    parts = {
        "joint": '<body><joint name="{0}"/><geom size=".1"/></body>',
        "mocap body": '<body name="{0}" mocap="true"/>',
        "actuator": '<motor name="{0}" joint="one"/>',
    }

    def model(names: str) -> mujoco.MjModel:
        parted = "".join(parts[kind].format(name) for name in names)
        bodies, motors = ("", parted) if kind == "actuator" else (parted, "")
        return mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody><body><joint name="one"/><geom size=".1"/></body>{bodies}</worldbody>
            <actuator>{motors}</actuator></mujoco>"""
        )

    recorded_model = model("ab")
    kept = recorded(live(recorded_model), range(2))[0]
    facts = json.loads(json.dumps(state.layout(recorded_model)))
    require_model(model("ab"), kept, facts)
    require_model(model("cd"), kept, facts)  # renamed
    place = 1 if kind == "joint" else 0
    with pytest.raises(UsageError, match=rf"{kind} 'a' is number {place} in it, not {place + 1}\n.*table"):
        require_model(model("ba"), kept, facts)


@pytest.mark.parametrize("said", [None, {}, [], "nq", {"nq": "8\x1b"}, {"nq": None}])
def test_a_recording_may_say_anything_of_its_model(said: object) -> None:
    if not said or not isinstance(said, dict):
        require_model(TUMBLER, tumbled(), {"sizes": said, "names": said})
        require_model(TUMBLER, tumbled(), {"names": {"joint": said, "actuator": [said, 3], "mocap body": {"a": said}}})
        return
    with pytest.raises(UsageError) as caught:
        require_model(TUMBLER, tumbled(), {"sizes": said})
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("source", [TUMBLE.format("RK4"), DELAYED, PLUGIN, SLEEPY])
def test_the_size_of_a_state_follows_from_the_sizes_that_are_compared(source: str) -> None:
    model = mujoco.MjModel.from_xml_string(source)
    n = state.sizes(model)
    once = ("nq", "na", "nu", "neq", "nhistory", "nuserdata", "npluginstate", "nplastic")
    counted = 1 + sum(n[name] for name in once) + 3 * n["nv"] + 6 * n["nbody"] + 7 * n["nmocap"]
    assert state.size(model) == counted


def test_another_timestep_is_refused() -> None:
    model = copy.copy(TUMBLER)
    model.opt.timestep = 0.001
    with pytest.raises(
        UsageError, match=r"made with a timestep of 0.002 s, not 0.001 s\nset timestep to that of the recording"
    ):
        ReplayStepper(model, tumbled())
    ReplayStepper(model, tumbled(last=0))


def test_mujoco_that_gives_up_is_told_as_in_a_live_run(monkeypatch: pytest.MonkeyPatch) -> None:
    replay = ReplayStepper(TUMBLER, tumbled())
    replay.advance(5)

    def fail(model: mujoco.MjModel, data: mujoco.MjData, *stages: int) -> None:
        raise mujoco.FatalError("out of arena")

    monkeypatch.setattr(mujoco, "mj_forwardSkip", fail)
    with pytest.raises(FailedStepError) as caught:
        replay.instant()
    assert str(caught.value) == "MuJoCo failed at step 5, time 0.01 s: out of arena"


@cache
def counted(*steps: int) -> Kept:
    """States that tell their step."""
    return Kept(np.array(steps), np.array(steps, float)[:, None])


TIMESTEPS = st.sampled_from(["0.002", "1/3", "0.0333333333333333", "1e-4", "7"]).map(Fraction)
PATHS = st.sets(st.integers(1, 50), max_size=12).map(lambda found: [0, *sorted(found)])


def chosen(steps: Sequence[int], timestep: Fraction, times: Sequence[float | Fraction]) -> list[float]:
    return [row[0] for row in states_at(counted(*steps), timestep, times)]


@given(PATHS, TIMESTEPS, st.lists(st.fractions(-5, 400, max_denominator=1000), max_size=8))
@settings(max_examples=30, deadline=None)
def test_the_state_at_a_time_is_the_last_one_that_is_not_later(
    steps: list[int], timestep: Fraction, times: list[Fraction]
) -> None:
    expected = [max([step for step in steps if step * timestep <= time], default=0) for time in times]
    assert chosen(steps, timestep, times) == expected


@given(PATHS, TIMESTEPS, st.sampled_from([float, Fraction]))
@settings(max_examples=30, deadline=None)
def test_the_time_of_a_step_finds_that_step_however_it_is_rounded(
    steps: list[int], timestep: Fraction, kind: Callable[[Fraction], float | Fraction]
) -> None:
    assert chosen(steps, timestep, [kind(step * timestep) for step in steps]) == steps


def test_before_the_beginning_is_the_first_and_after_the_end_the_last() -> None:
    assert chosen([0, 3, 4], Fraction(1, 500), [-1.0, -1e-9, 0.0, 0.0059, 0.006, 0.0079, 0.008, 1e9]) == [
        *(0, 0, 0, 0, 3, 3, 4, 4),
    ]
    assert chosen([0], Fraction(1), []) == []
