"""Theorems about the one loop: every tap gets its steps in order, and the motion never knows that it is watched."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mjrun.errors import UnstableError
from mjrun.physics.simulation_loop import Tap, run_with_taps
from mjrun.physics.stepper import CHUNK, PhysicsStepper, Stepper

UNTIL = 150
BOUNCE = mujoco.MjModel.from_xml_string("""<mujoco><option><flag energy="enable"/></option><worldbody>
<geom type="plane" size="5 5 1"/>
<body pos="0 0 .25" euler="20 30 0"><freejoint/><geom type="box" size=".1 .15 .2"/></body>
<body pos=".2 0 .5"><joint name="arm" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/></body>
</worldbody><sensor><jointpos joint="arm"/></sensor></mujoco>""")
CADENCES = st.lists(st.integers(0, UNTIL), max_size=12).map(sorted)


def stepper(model: mujoco.MjModel = BOUNCE) -> PhysicsStepper:
    return PhysicsStepper(model, mujoco.MjData(model))


def reading(steps: Sequence[int], read: Callable[[Stepper], Any], write: Callable[[Any], object]) -> Tap:
    """A tap that writes what it reads."""
    return Tap(steps, lambda stepper: write(read(stepper)))


def step_of(stepper: Stepper) -> int:
    return stepper.step


@cache
def bare(model: mujoco.MjModel, until: int) -> tuple[bytes, ...]:
    """qpos and qvel at every step of a bare loop."""
    data = mujoco.MjData(model)
    found = []
    for _ in range(until + 1):
        found.append(data.qpos.tobytes() + data.qvel.tobytes())
        mujoco.mj_step(model, data)
    return tuple(found)


def motion(stepper: Stepper) -> bytes:
    """qpos and qvel of the state, which says nothing of how they are laid out in it."""
    data = mujoco.MjData(stepper.model)
    mujoco.mj_setState(stepper.model, data, stepper.state(), int(mujoco.mjtState.mjSTATE_INTEGRATION))
    return data.qpos.tobytes() + data.qvel.tobytes()


def instant(stepper: Stepper) -> bytes:
    data = stepper.instant()
    return data.qpos.tobytes() + data.qvel.tobytes()


@given(st.lists(CADENCES, max_size=4))
@settings(max_examples=20, deadline=None)
def test_every_tap_is_served_exactly_at_its_steps_in_order(cadences: list[list[int]]) -> None:
    served: list[list[int]] = [[] for _ in cadences]
    run = stepper()
    run_with_taps(run, [reading(c, step_of, s.append) for c, s in zip(cadences, served, strict=True)], UNTIL)
    assert served == cadences
    assert run.step == UNTIL


@given(st.lists(st.tuples(CADENCES, st.sampled_from([motion, instant])), max_size=3))
@example([([*range(UNTIL + 1)], motion), ([*range(UNTIL + 1)], instant)])
@settings(max_examples=20, deadline=None)
def test_watching_changes_nothing_and_sees_what_a_bare_loop_goes_through(
    taps: list[tuple[list[int], Callable[[Stepper], bytes]]],
) -> None:
    seen: list[list[bytes]] = [[] for _ in taps]
    run = stepper()
    run_with_taps(run, [reading(c, read, s.append) for (c, read), s in zip(taps, seen, strict=True)], UNTIL)
    path = bare(BOUNCE, UNTIL)
    assert seen == [[path[step] for step in cadence] for cadence, _ in taps]
    assert motion(run) == path[UNTIL]


def test_taps_that_share_a_step_see_the_same_instant_in_the_order_they_were_given() -> None:
    log: list[tuple[str, int, int]] = []
    taps = [reading(range(0, 31, n), lambda s, n=n: (str(n), s.step, id(s.instant())), log.append) for n in (10, 15, 5)]
    run_with_taps(stepper(), taps, 30)
    assert [(name, step) for name, step, _ in log] == [
        *(("10", 0), ("15", 0), ("5", 0), ("5", 5), ("10", 10), ("5", 10)),
        *(("15", 15), ("5", 15), ("10", 20), ("5", 20), ("5", 25), ("10", 30), ("15", 30), ("5", 30)),
    ]


def test_each_write_follows_its_read_before_the_next_step_is_taken() -> None:
    log: list[object] = []

    def read(stepper: Stepper) -> int:
        log.append(("read", stepper.step))
        return stepper.step

    run_with_taps(stepper(), [reading([1, 2], read, lambda step: log.append(("write", step)))], 3)
    assert log == [("read", 1), ("write", 1), ("read", 2), ("write", 2)]


def test_a_cadence_is_read_as_it_is_needed_so_a_long_one_costs_no_memory() -> None:
    served: list[int] = []

    def stop(step: int) -> None:
        served.append(step)
        if step == 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_with_taps(stepper(), [reading(range(0, 10**15, 10), step_of, stop)], 10**15)
    assert served == [0, 10, 20]


@pytest.mark.parametrize("steps", [[0, 7], [7]])
def test_a_tap_never_sees_a_step_beyond_the_end_of_the_run(steps: list[int]) -> None:
    served: list[int] = []
    run = stepper()
    with suppress(ValueError):
        run_with_taps(run, [reading(steps, step_of, served.append)], 5)
    assert 7 not in served
    assert run.step <= 5


def falling(step: int) -> mujoco.MjModel:
    """A mass whose speed passes MuJoCo's limit at `step`, by the closed form of a uniform acceleration."""
    timestep = 1.5 / step
    acceleration = 1e10 / (timestep * (step - 0.5))
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
<option timestep="{timestep!r}" gravity="{acceleration!r} 0 0"/>
<worldbody><body><joint type="slide" axis="1 0 0"/><geom size="1"/></body></worldbody></mujoco>""")


@pytest.mark.parametrize("every", [1, 7, 50, 1000])
@pytest.mark.parametrize("bad", [2, CHUNK, CHUNK + 1, 120])
def test_what_is_written_before_a_run_becomes_unstable_is_good_and_nothing_is_written_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bad: int, every: int
) -> None:
    monkeypatch.chdir(tmp_path)
    model = falling(bad)
    states: list[bytes] = []
    steps: list[int] = []
    instants: list[float] = []
    taps = [
        reading(range(0, 500, every), motion, states.append),
        reading(range(0, 500, every), step_of, steps.append),
        reading(range(500), lambda s: s.instant().qvel[0].item(), instants.append),
    ]
    with pytest.raises(UnstableError) as caught:
        run_with_taps(stepper(model), taps, 500)
    assert caught.value.step == bad - 1
    assert steps == list(range(0, bad, every))
    assert states == list(bare(model, bad)[:bad:every])
    assert len(instants) == bad
    assert np.abs(instants).max() < 1e10
