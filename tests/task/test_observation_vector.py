"""Observations: each source, and what is done to it in which order."""

from fractions import Fraction

import mujoco
import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.probe.task_expression import TaskVocabulary
from mjrun.task.expressions import ExpressionInputs
from mjrun.task.observation_plan import BatchObservations, ObservationPlan
from mjrun.task.random_streams import BLOCK, OBSERVATIONS, CommandSignals, stream
from mjrun.task.task import Command, Observation

MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body name="base"><freejoint name="root"/><geom size=".1"/>
    <body name="leg"><joint name="hip"/><joint name="knee"/><geom size=".1"/></body></body></worldbody>
    <actuator><motor name="m" joint="hip"/></actuator></mujoco>"""
)
DT = Fraction(1, 50)


def plan(*terms: Observation) -> ObservationPlan:
    commands = CommandSignals({"goal": Command(constant=[1, 2, 3])}, DT, 10, 3)
    return ObservationPlan(terms, MODEL, TaskVocabulary(MODEL, [], float(DT)), ["m"], commands)


def vector(made: ObservationPlan, count: int = 3) -> BatchObservations:
    rotations = np.random.default_rng(1).normal(size=(count, MODEL.nbody, 9))
    return BatchObservations(made, count, DT, rotations)


def inputs(instant: int, count: int) -> ExpressionInputs:
    return ExpressionInputs(
        np.full(count, instant), np.arange(count)[:, None] + 0.5, np.tile([1.0, 2.0, 3.0], (count, 1))
    )


def test_terms_stand_in_their_order_and_joints_in_that_which_is_said() -> None:
    made = plan(
        Observation(name="goal", command="goal"),
        Observation(name="joints", joints=["knee", "root", "hip"], of="qvel"),
        Observation(name="gait", phase=0.5),
        Observation(name="base", probe=["xpos/base", "qpos/h*"]),
        Observation(name="last", action="previous"),
        Observation(name="high", value="qpos/root/z - 1"),
    )
    twist = ["vx", "vy", "vz", "wx", "wy", "wz"]
    assert made.measured[:2] == ["qvel/knee", "qvel/root/vx"]
    assert made.measured[-4:] == ["xpos/base/x", "xpos/base/y", "xpos/base/z", "qpos/hip"]
    assert [number.name for number in made.numbers] == [
        *("goal/0", "goal/1", "goal/2", "joints/knee", *(f"joints/root/{each}" for each in twist), "joints/hip"),
        *("gait/sin", "gait/cos", "base/xpos/base/x", "base/xpos/base/y", "base/xpos/base/z", "base/qpos/hip"),
        *("last/m", "high"),
    ]
    measured = np.random.default_rng(0).normal(size=(3, 12))
    worlds = np.arange(3)
    seen = vector(made).observe(measured, inputs(7, 3), {"high": np.array([7.0, 8, 9])}, worlds, first=True)
    angle = 2 * np.pi * 7 * 0.02 / 0.5
    np.testing.assert_array_equal(seen[:, 3:11], measured[:, :8])
    np.testing.assert_allclose(seen[:, 11:13], [[np.sin(angle), np.cos(angle)]] * 3, rtol=1e-14)
    np.testing.assert_array_equal(seen[:, 13:17], measured[:, 8:])
    np.testing.assert_array_equal(seen[:, 17:], [[0.5, 7], [1.5, 8], [2.5, 9]])


def test_the_order_is_frame_noise_offset_scale_clip_delay_history() -> None:
    made = plan(
        Observation(
            name="up",
            probe="xpos/leg",
            frame="base",
            noise="normal(0, 0.1)",
            offset=[1, 2, 3],
            scale=2,
            clip=[-4, [3, 4, 5]],
            delay=1,
            history=2,
        ),
        Observation(name="plain", probe="qpos/hip"),
    )
    assert [number.name for number in made.numbers] == [
        *("up/x@-1", "up/y@-1", "up/z@-1", "up/x", "up/y", "up/z", "plain")
    ]
    assert [number.delay for number in made.numbers[::3]] == [2, 1, 0]
    seen = vector(made)
    axes = np.random.default_rng(1).normal(size=(3, MODEL.nbody, 9))[2, 1].reshape(3, 3)
    series = np.random.default_rng(2).normal(size=(BLOCK + 5, 4))
    generator = stream(9, OBSERVATIONS)
    blocks = [np.stack([generator.normal(0, 0.1, BLOCK) for _ in range(3)], axis=1) for _ in range(2)]
    noise = np.concatenate(blocks)

    seen.begin(2, 9)
    expected: list[np.ndarray] = []
    for k, row in enumerate(series):
        value = np.clip((axes.T @ row[:3] + noise[k] - [1, 2, 3]) * 2, -4, [3, 4, 5])
        expected += [value] * (3 if k == 0 else 1)
        got = seen.observe(row[None], inputs(k, 1), {}, np.array([2]), first=k == 0)
        np.testing.assert_allclose(got[0], [*expected[k], *expected[k + 1], row[3]], rtol=1e-13)


@pytest.mark.parametrize(
    ("term", "message", "path"),
    [
        (Observation(name="x", probe="qpos/hp"), "no column 'qpos/hp'", ("probe", 0)),
        (Observation(name="x", joints=["hip", "kne"]), "no joint 'kne'", ("joints", 1)),
        (Observation(name="x", value="qpos/hip +"), r"observations\[0\].value, character 11", ("value",)),
        (Observation(name="x", probe="qpos", scale=[1, 2]), "one number, or 9", ("scale",)),
        (Observation(name="x", probe="xquat/leg", frame="base"), "does not consist of vectors of three", ("frame",)),
        (Observation(name="x", probe="xpos/leg", frame="bas"), "no body 'bas'", ("frame",)),
        (Observation(name="x", probe="act"), "has no columns", ("probe", 0)),
        (Observation(name="x", probe="reward/total"), "cannot use it", ("probe", 0)),
        (Observation(name="x", value="2 * return"), "cannot use it", ("value",)),
    ],
)
def test_what_does_not_fit_is_told_where_it_stands(
    term: Observation, message: str, path: tuple[str | int, ...]
) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        assert not plan(term).rotated_terms
    assert caught.value.path == ("observations", 0, *path)
