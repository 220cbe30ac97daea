"""Rollouts of many simulations in C, against a bare loop over each of them that calls mj_forward at every step."""

import tracemalloc
from collections.abc import Sequence

import mujoco
import numpy as np
import pytest

from mjrun.errors import ContactMemoryError, FailedStepError, SimulationError, UnstableError, UsageError
from mjrun.model import state
from mjrun.model.fields import VariedModel
from mjrun.physics import engine as engines
from mjrun.physics.engine import CEngine, RolloutBlock

FIELDS = ("qpos", "qvel", "act", "ctrl", "qacc", "energy", "sensordata", "xpos", "cvel", "ncon", "solver_niter")
MODEL = """
<mujoco>
  <option integrator="{integrator}" timestep="{timestep}"><flag energy="enable" {flags}/></option>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .2"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="{mass}"/><site name="s"/></body>
    <body pos="1 0 1"><joint name="h" axis="0 1 0" damping=".1"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
  <actuator><general name="g" joint="h" dyntype="filter" dynprm=".1"/></actuator>
  <sensor><accelerometer site="s"/><jointvel joint="h"/></sensor>
</mujoco>
"""
STEPS = 100


def model_of(mass: float = 1, integrator: str = "Euler", timestep: float = 0.004, flags: str = "") -> mujoco.MjModel:
    text = MODEL.format(mass=mass, integrator=integrator, timestep=timestep, flags=flags)
    return mujoco.MjModel.from_xml_string(text)


def starts_of(models: Sequence[mujoco.MjModel]) -> np.ndarray:
    """Every simulation is thrown in a way of its own."""
    rng, rows = np.random.default_rng(3), []
    for model in models:
        data = mujoco.MjData(model)
        data.qvel[:] = rng.normal(size=model.nv)
        data.ctrl[:] = rng.normal(size=model.nu)
        rows.append(state.save(model, data))
    return np.array(rows)


def controls_of(count: int, steps: int = STEPS) -> np.ndarray:
    return np.random.default_rng(4).normal(size=(count, steps, 1))


def bare(
    model: mujoco.MjModel, start: np.ndarray, controls: np.ndarray | None, steps: Sequence[int]
) -> dict[str, np.ndarray]:
    """The instants at `steps` of a loop that anyone would write."""
    data, rows = mujoco.MjData(model), {name: [] for name in FIELDS}
    state.restore(model, data, start)
    for step in range(max(steps) + 1):
        if controls is not None:
            data.ctrl[:] = controls[min(step, len(controls) - 1)]
        if step in steps:
            shown = mujoco.MjData(model)
            mujoco.mj_copyData(shown, model, data)
            mujoco.mj_forward(model, shown)
            for name in FIELDS:
                rows[name].append(np.array(getattr(shown, name)))
        mujoco.mj_step(model, data)
    return {name: np.stack(values) for name, values in rows.items()}


def joined(blocks: Sequence[RolloutBlock], name: str, index: int) -> np.ndarray:
    """All good rows of a simulation."""
    return np.concatenate([block.fields[name][index, : block.counts[index]] for block in blocks])


def assert_same(blocks: Sequence[RolloutBlock], index: int, expected: dict[str, np.ndarray]) -> None:
    for name in FIELDS:
        values = joined(blocks, name, index)
        assert values.tobytes() == expected[name].astype(values.dtype).tobytes(), (name, index)


ENGINE = CEngine(threads=2)


@pytest.mark.parametrize("integrators", [("Euler",), ("RK4",), ("Euler", "RK4", "implicitfast")])
def test_every_simulation_is_that_of_a_bare_loop_alone(
    integrators: Sequence[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "BLOCK_STEPS", 32)
    models = [model_of(mass, integrators[i % len(integrators)], 0.002 + 0.001 * i) for i, mass in enumerate((1, 2, 5))]
    starts, controls = starts_of(models), controls_of(3)
    given = zip(models, starts, controls, strict=True)
    loops = [bare(model, start, control, range(STEPS + 1)) for model, start, control in given]
    for threads, every in ((1, 1), (2, 3), (1, 70), (2, 1000)):
        blocks = list(CEngine(threads).rollout(models, starts, controls, STEPS, FIELDS, every))
        steps = np.concatenate([block.steps for block in blocks]).tolist()
        assert steps == [*range(0, STEPS, every), STEPS]
        assert len(blocks) > 2 or every > 32
        for index, loop in enumerate(loops):
            assert_same(blocks, index, {name: rows[steps] for name, rows in loop.items()})
        assert not any(block.failures for block in blocks)


def test_one_model_serves_all_and_controls_may_be_those_of_the_start() -> None:
    model = model_of()
    starts = starts_of([model] * 4)
    blocks = list(ENGINE.rollout(model, starts, None, 30, FIELDS))
    for index, start in enumerate(starts):
        assert_same(blocks, index, bare(model, start, None, range(31)))


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_numbers_of_one_model_are_those_of_a_model_for_each(integrator: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BLOCK_STEPS", 32)
    model, count = model_of(integrator=integrator), 4
    arrays = {
        "geom_friction": np.random.default_rng(5).uniform(0.1, 1, (count, *model.geom_friction.shape)),
        "opt.gravity": np.array([[[0, 0, -9.81]], [[1, 0, -5]], [[0, 0, 1e12]], [[0, 2, -9]]]),  # the third diverges
        "opt.viscosity": np.array([[[0.0]], [[0.1]], [[0.0]], [[0.2]]]),
    }
    varied = VariedModel(model, arrays)
    starts, controls = starts_of([model] * count), controls_of(count)
    rollouts = [
        list(ENGINE.rollout(models, starts, controls, STEPS, FIELDS, 3))
        for models in (varied, [varied.at(simulation) for simulation in range(count)])
    ]
    for ours, theirs in zip(*rollouts, strict=True):
        assert [*ours.failures] == [*theirs.failures]
        assert [str(error) for error in ours.failures.values()] == [str(error) for error in theirs.failures.values()]
        assert ours.counts.tolist() == theirs.counts.tolist()
        for name in FIELDS:
            for own, other, rows in zip(ours.fields[name], theirs.fields[name], ours.counts, strict=True):
                assert own[:rows].tobytes() == other[:rows].tobytes(), name
    assert rollouts[0][-1].counts.tolist() == [1, 1, 0, 1]
    np.testing.assert_array_equal(model.opt.gravity, (0, 0, -9.81))


def test_every_block_has_the_first_row_of_the_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BLOCK_STEPS", 8)
    model = model_of()
    starts = starts_of([model] * 2)
    blocks = list(ENGINE.rollout(model, starts, None, 30, FIELDS))
    assert len(blocks) == 5
    for block in blocks:
        for name in FIELDS:
            np.testing.assert_array_equal(block.initial[name], blocks[0].fields[name][:, :1])


def test_without_steps_there_is_the_start_alone() -> None:
    model = model_of()
    starts = starts_of([model])
    (block,) = ENGINE.rollout(model, starts, np.empty((1, 0, 1)), 0, FIELDS)
    assert (block.steps.tolist(), block.counts.tolist()) == ([0], [1])
    assert_same([block], 0, bare(model, starts[0], None, [0]))


def test_bodies_that_sleep_are_measured_as_they_are_beside_others_that_cannot() -> None:
    models = [model_of(flags='sleep="enable"'), model_of(), model_of(flags='sleep="enable"')]
    starts = starts_of(models)
    starts[0, 1 + models[0].nq : 1 + models[0].nq + models[0].nv] = 0  # at rest: the box falls, and then sleeps
    blocks = list(ENGINE.rollout(models, starts, None, 200, FIELDS))
    for index, model in enumerate(models):
        assert_same(blocks, index, bare(model, starts[index], None, range(201)))


def test_a_simulation_that_diverges_ends_alone_at_its_own_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BLOCK_STEPS", 32)
    models = [model_of() for _ in range(3)]
    starts, controls = starts_of(models), controls_of(3)
    controls[1, 40:] = 9e9
    blocks = list(ENGINE.rollout(models, starts, controls, STEPS, FIELDS))
    failures = [
        (number, index, error) for number, block in enumerate(blocks) for index, error in block.failures.items()
    ]
    ((number, index, error),) = failures
    assert (number, index) == (1, 1)
    assert isinstance(error, UnstableError)
    assert 40 <= error.step < 64
    with pytest.raises(SimulationError, match="became unstable at step"):
        raise error
    assert error.time == pytest.approx(error.step * 0.004)
    assert "joint 'h'" in str(error)
    steps = range(error.step + 1)
    assert_same(blocks, 1, bare(models[1], starts[1], controls[1], steps))
    for other in (0, 2):
        assert_same(blocks, other, bare(models[other], starts[other], controls[other], range(STEPS + 1)))


def test_a_failure_between_two_rows_is_told_with_the_next_block(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engines, "BLOCK_STEPS", 10)
    model = model_of()
    starts, controls = starts_of([model] * 2), controls_of(2)
    controls[0, 15:] = 9e9
    blocks = list(ENGINE.rollout(model, starts, controls, STEPS, FIELDS, every=50))
    assert [(block.steps.tolist(), block.counts.tolist(), list(block.failures)) for block in blocks] == [
        ([0], [1, 1], []),
        ([50], [0, 1], [0]),
        ([100], [0, 1], []),
    ]


@pytest.mark.parametrize(("memory", "error"), [("20K", FailedStepError), ("12K", ContactMemoryError)])
def test_running_out_of_memory_ends_that_simulation_alone(memory: str, error: type[SimulationError]) -> None:
    spheres = "".join(f'<body pos="{x / 8} 0 .06"><freejoint/><geom size=".05"/></body>' for x in range(6))
    text = (
        f'<mujoco><size memory="{memory}"/><worldbody><geom type="plane" size="1 1 1"/>{spheres}</worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    falling = state.save(model, data)
    data.qpos[2::7] = 5  # where nothing touches
    starts = np.array([state.save(model, data), falling])
    blocks = list(ENGINE.rollout(model, starts, None, 60, ("qpos",)))
    (failure,) = [error for block in blocks for error in block.failures.values()]
    assert isinstance(failure, error)
    assert len(joined(blocks, "qpos", 0)) == 61
    assert len(joined(blocks, "qpos", 1)) <= failure.step + 1


def test_a_warning_that_is_no_failure_ends_nothing() -> None:
    text = """<mujoco><worldbody><body><joint name="j"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[0] = np.nan  # for which MuJoCo substitutes zero
    starts = np.array([state.save(model, data)] * 2)
    mujoco.mj_step(model, data, nstep=60)
    assert data.warning[int(mujoco.mjtWarning.mjWARN_BADCTRL)].number
    blocks = list(ENGINE.rollout(model, starts, None, 60, ("qpos",)))
    for index in range(2):
        np.testing.assert_array_equal(joined(blocks, "qpos", index)[-1], data.qpos)


def test_models_and_starts_are_left_as_they_are() -> None:
    model = model_of(integrator="RK4")
    starts = starts_of([model] * 2)
    before, flags = starts.copy(), (model.opt.disableflags, model.opt.enableflags)
    list(ENGINE.rollout(model, starts, None, 10, FIELDS))
    np.testing.assert_array_equal(starts, before)
    assert (model.opt.disableflags, model.opt.enableflags) == flags


def test_models_of_different_sizes_are_refused() -> None:
    small = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    model = model_of()
    with pytest.raises(UsageError, match="models of different sizes"):
        list(ENGINE.rollout([model, small], starts_of([model] * 2), None, 5, ("qpos",)))
    with pytest.raises(ValueError, match="1 models for 2 simulations"):
        list(ENGINE.rollout([model], starts_of([model] * 2), None, 5, ("qpos",)))


def test_memory_does_not_grow_with_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BLOCK_BYTES", 2**18)
    model = model_of()
    starts = starts_of([model] * 4)

    def peak(steps: int) -> int:
        tracemalloc.start()
        for block in ENGINE.rollout(model, starts, None, steps, FIELDS):
            assert sum(values.nbytes for values in block.fields.values()) <= 2**18
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(200)
    assert peak(2000) < 1.5 * peak(400)
