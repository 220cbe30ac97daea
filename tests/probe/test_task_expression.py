"""Expressions over control instants, against numpy on whole series; and that no world changes another."""

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.probe.task_expression import TaskExpression, TaskVocabulary, parse_task_condition, parse_task_value
from tests.cases import cases

DT = 0.05
MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body name="cart"><joint name="slide" type="slide"/><geom size=".1"/>
    <body name="pole"><joint name="hinge"/><geom size=".1" pos="0 0 1"/></body></body></worldbody></mujoco>"""
)
COLUMNS = TaskVocabulary(MODEL, ["action/a", "action/b", "action/c", "command/goal/0", "command/goal/1"], DT)
NAMES = ["time", "qpos/slide", "qpos/hinge", "xpos/pole/x", "xpos/pole/z"]
NAMES += ["action/a", "action/b", "action/c", "command/goal/0", "command/goal/1"]
SERIES = np.random.default_rng(4).normal(size=(9, 130, len(NAMES)))  # instants, worlds, columns


def at(instant: int, worlds: slice | list[int] = slice(None)) -> dict[str, np.ndarray]:
    """The columns at one instant."""
    return {name: SERIES[instant, worlds, i] for i, name in enumerate(NAMES)}


def series(expression: TaskExpression, worlds: list[int] | None = None) -> np.ndarray:
    """The values at all instants: `(instants, worlds)`."""
    chosen = slice(None) if worlds is None else worlds
    evaluator = expression.evaluator(SERIES.shape[1] if worlds is None else len(worlds))
    first = evaluator.begin(at(0, chosen))
    return np.stack([first, *(evaluator.advance(at(k, chosen)) for k in range(1, len(SERIES)))])


def column(name: str) -> np.ndarray:
    return SERIES[..., NAMES.index(name)]


def shifted(values: np.ndarray) -> np.ndarray:
    """The values one instant ago; at the first instant, those there."""
    return np.concatenate([values[:1], values[:-1]])


@pytest.fixture(autouse=True)
def _without_warnings() -> Iterator[None]:
    with np.errstate(all="ignore"):
        yield


SLIDE, HINGE = column("qpos/slide"), column("qpos/hinge")
ACTION = SERIES[..., 5:8]
RATE = (SLIDE - shifted(SLIDE)) / DT


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("previous(qpos/slide)", shifted(SLIDE)),
        ("previous(previous(qpos/slide))", shifted(shifted(SLIDE))),
        ("rate(qpos/slide)", RATE),
        ("rate(rate(qpos/slide))", (RATE - shifted(RATE)) / DT),
        ("previous(qpos/slide + qpos/hinge) * control_dt", shifted(SLIDE + HINGE) * DT),
        ("sum((\"action/*\" - previous('action/*'))^2)", np.sum((ACTION - shifted(ACTION)) ** 2, axis=-1)),
        ("norm('action/*')", np.linalg.norm(ACTION, axis=-1)),
        ("norm(qpos/slide - command/goal/0, qpos/hinge)", np.hypot(SLIDE - column("command/goal/0"), HINGE)),
        ("max('action/*', 0)", np.maximum(ACTION.max(axis=-1), 0)),
        ('min("action/?") + sum(qpos/slide, 1)', ACTION.min(axis=-1) + (SLIDE + 1)),
        ("sum(where(time > 0, 'action/*', -1))", np.where(column("time") > 0, ACTION.sum(axis=-1), -3.0)),
        ("where(not isfinite(log(qpos/slide)), 7, tanh(qpos/hinge))", np.where(SLIDE < 0, 7, np.tanh(HINGE))),
        ("sum(clip('action/*' * qpos/hinge, -1, 1))", np.clip(ACTION * HINGE[..., None], -1, 1).sum(axis=-1)),
        ("exp(-norm(xpos(pole).x, xpos(pole).z))", np.exp(-np.hypot(column("xpos/pole/x"), column("xpos/pole/z")))),
        ("3", np.full(SLIDE.shape, 3.0)),
    ],
)
def test_the_values_are_numpys(text: str, expected: np.ndarray) -> None:
    np.testing.assert_allclose(series(parse_task_value(text, COLUMNS, "value")), expected, rtol=1e-14, atol=1e-14)


EVERYTHING = (
    "exp(-norm('action/*', 'qpos/*')) + tanh(rate(sum('action/*'))) * sin(qpos/slide)^3"
    " - sqrt(abs(previous(norm(command/goal/0, command/goal/1)))) + where(qpos/slide > 0, log(abs(qpos/hinge)), 2^time)"
)


@pytest.mark.parametrize("worlds", [[0], [3, 128], [*range(7)], [*range(60, 125)]])
def test_a_world_gets_the_same_bits_whatever_is_beside_it(worlds: list[int]) -> None:
    expression = parse_task_value(EVERYTHING, COLUMNS, "value")
    np.testing.assert_array_equal(series(expression, worlds), series(expression)[:, worlds])


def test_worlds_begin_and_continue_on_their_own() -> None:
    expression = parse_task_value("previous(qpos/slide)", COLUMNS, "value")
    evaluator = expression.evaluator(4)
    evaluator.begin(at(0, [0, 1, 2, 3]))
    np.testing.assert_array_equal(evaluator.advance(at(1, [3, 1]), [3, 1]), SLIDE[0, [3, 1]])
    np.testing.assert_array_equal(evaluator.begin(at(5, [1]), [1]), SLIDE[5, [1]])
    np.testing.assert_array_equal(
        evaluator.advance(at(6, [0, 1, 2, 3])), [SLIDE[0, 0], SLIDE[5, 1], SLIDE[0, 2], SLIDE[1, 3]]
    )


def test_a_condition_holds_world_by_world_and_nan_is_not_finite() -> None:
    condition = parse_task_condition("not isfinite('qpos/*') or rate(qpos/slide) > 0", COLUMNS, "fallen")
    assert condition.columns == ("qpos/slide", "qpos/hinge")
    evaluator = condition.evaluator(5)
    slide, hinge = np.array([0, np.nan, 0, 0, 0.0]), np.array([0, 0, np.inf, 0, 0])
    np.testing.assert_array_equal(evaluator.begin({"qpos/slide": slide, "qpos/hinge": hinge}), [0, 1, 1, 0, 0])
    slide = np.array([-1, 0, 0, 1, np.nan])
    np.testing.assert_array_equal(evaluator.advance({"qpos/slide": slide, "qpos/hinge": hinge}), [0, 0, 1, 1, 1])


@cases("text, message")
def test_what_has_no_number_per_instant_is_refused(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message.replace("(", r"\(")):
        parse_task_value(text, COLUMNS, "reward")


def test_unknown_names_are_reported_with_near_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"no column 'action/\*\*x'"):
        parse_task_value("sum('action/**x')", COLUMNS, "reward")
    with pytest.raises(UnknownNameError, match=r"no function or probe 'rates' .*did you mean 'rate'"):
        parse_task_value("rates(qpos/slide)", COLUMNS, "reward")
