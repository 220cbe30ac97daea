"""Columns are read of worlds as probes measure them, with appended sensors where a step leaves something out."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.probe.episode_columns import EpisodeProbe
from mjrun.probe.fields import RecordedFieldProbe
from mjrun.probe.select import select, selected_columns
from mjrun.task.batch_columns import (
    ALL,
    SENSED,
    BatchColumns,
    MeasurementPlan,
    MjDataBatch,
    SourceWithSensors,
    can_sense,
)

SOURCE = parse_source("scene:dominos")
MODEL = SOURCE.load()


def names(*probes: str) -> list[str]:
    return [column.name for column in selected_columns(MODEL, probes)]


def expected(data: mujoco.MjData, columns: list[str]) -> np.ndarray:
    """The columns, one by one, measured on an MjData."""
    values = []
    for name in columns:
        (probe,) = select(MODEL, [name])
        assert not isinstance(probe, EpisodeProbe)
        if isinstance(probe, RecordedFieldProbe):
            fields = {field: np.asarray(getattr(data, field)) for field in probe.fields}
            values.append(probe.compute(fields, fields)[0])
        else:
            values.append(probe.measure(MODEL, data)[0])
    return np.array(values)


@pytest.mark.parametrize("can_sense", [True, False])
def test_columns_are_those_of_one_mjdata_in_any_order(can_sense: bool) -> None:
    body = mujoco.mj_id2name(MODEL, mujoco.mjtObj.mjOBJ_BODY, 1)
    columns = [*names("qvel", "xpos", "energy", "com"), *names(f"cfrc_ext/{body}", "contact"), names("qpos")[2]]
    columns += [*names("speed", "qpos")[-2::-1], *names("cvel", "momentum")]
    plan = MeasurementPlan(MODEL, columns, can_sense)
    assert plan.needs_energy
    assert plan.sensed == (("cfrc_ext",) if can_sense else ())
    assert plan.needs_data == (not can_sense)
    assert plan.stage == 3

    model = SourceWithSensors(SOURCE, plan.sensed).load()
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    plain = SOURCE.load()
    plain.opt.enableflags = model.opt.enableflags
    batch = MjDataBatch(model, 3, 2, persistent=False) if plan.needs_data else Batch(model, 3, 2)
    measurement = BatchColumns(batch, plan, lambda world: model)
    batch.bind("qvel")[:] = np.random.default_rng(0).normal(size=(3, MODEL.nv))
    batch.forward()
    measurement.begin(ALL)
    batch.step(nstep=40)
    batch.forward()

    values = np.empty((3, len(columns)))
    measurement.read(ALL, values)
    some = np.empty((2, len(columns)))
    measurement.read(np.array([2, 0]), some)
    np.testing.assert_array_equal(some, values[[2, 0]])
    drift = columns.index("energy/drift")
    for world in range(3):
        data = mujoco.MjData(plain)
        mujoco.mj_setState(plain, data, batch.state[world], mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(plain, data)
        reference = expected(data, columns)
        assert values[world, drift] < 0  # friction; a single instant has no drift
        reference[drift] = values[world, drift]
        np.testing.assert_array_equal(values[world], reference)


@pytest.mark.parametrize(("columns", "stage"), [(["qpos"], 0), (["xpos", "qpos"], 1), (["cvel"], 2), (["qacc"], 3)])
def test_no_more_is_computed_than_is_measured(columns: list[str], stage: int) -> None:
    assert MeasurementPlan(MODEL, names(*columns), True).stage == stage


@pytest.mark.parametrize("field", SENSED)
def test_a_step_leaves_the_field_as_mujocos_own_function_gives_it(field: str) -> None:
    source = parse_source("scene:dominos", [Override("opt.gravity", "0 0 -5")])
    plain = source.load()
    sensing = SourceWithSensors(source, (field,)).load()
    assert sensing.nsensor == plain.nsensor + 1
    data, other = mujoco.MjData(plain), mujoco.MjData(sensing)
    data.qvel[:] = other.qvel[:] = np.random.default_rng(0).normal(0, 0.05, plain.nv)
    for _ in range(80):
        mujoco.mj_step(plain, data)
        mujoco.mj_step(sensing, other)
    np.testing.assert_array_equal(data.qpos, other.qpos)

    mujoco.mj_forward(plain, data)
    mujoco.mj_forward(sensing, other)
    mujoco.mj_rnePostConstraint(plain, data)
    mujoco.mj_subtreeVel(plain, data)
    assert np.any(getattr(data, field))
    np.testing.assert_array_equal(getattr(data, field), getattr(other, field))


def test_contact_forces_are_left_as_gymnasium_computes_them_after_a_step() -> None:
    source = parse_source("scene:dominos")
    plain, sensing = source.load(), SourceWithSensors(source, ("cfrc_ext",)).load()
    data, other = mujoco.MjData(plain), mujoco.MjData(sensing)
    for _ in range(50):
        mujoco.mj_step(plain, data)
        mujoco.mj_step(sensing, other)
        mujoco.mj_rnePostConstraint(plain, data)
        np.testing.assert_array_equal(data.cfrc_ext, other.cfrc_ext)
    assert np.any(other.cfrc_ext)


def test_compiled_models_and_those_without_sensors_cannot_sense() -> None:
    source = parse_source("scene:pendulum")
    spec, model = source.compile()
    assert can_sense(spec, model)
    assert not can_sense(None, model)
    assert not can_sense(*parse_source("scene:pendulum", [Override("opt.flag.sensor", "disable")]).compile())
