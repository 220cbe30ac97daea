"""Compiled expressions of one world give the bits that they have among many worlds."""

from collections.abc import Sequence

import numpy as np
import pytest

from mjrun.probe.task_expression import TaskExpression, TaskVocabulary, parse_task_condition, parse_task_value
from mjrun.task.expressions import RowFunctionBuilder
from tests.task.test_worlds import MODEL

NAMES = [*(f"action/{i}" for i in range(20)), "command/goal/0", "command/goal/1", "qpos/slide", "qpos/hinge"]
COLUMNS = TaskVocabulary(MODEL, NAMES[:22], 0.05)
SCALES = 10.0 ** np.random.default_rng(5).integers(-9, 9, (4, 12, len(NAMES)))
SERIES = np.random.default_rng(4).normal(size=SCALES.shape) * SCALES  # instants, worlds, columns
SERIES[:, 1] = np.where(SERIES[:, 1] > 0, 0.0, -0.0)
SERIES[:, 2] = np.inf
SERIES[:, 3, ::3] = np.nan
VALUES = [
    "3",
    "1/0 - inf",
    "-action/1",
    "control_dt * time",
    "action/1 - action/2 - 3 * action/1 / action/2 + action/3^2 - action/4^3 + 2^time + action/5 / 8",
    "abs(action/1) + sqrt(abs(action/2)) + exp(action/3) + log(action/4) + sin(action/5)^3 + tanh(action/6)",
    "min(action/1, 0, action/2) + max(action/3, action/4) + clip(action/5, -1, 1) + sum(action/1, action/2, 3)",
    "norm(action/1)",
    "norm(action/1, action/2, action/3)",
    "norm(qpos/slide - command/goal/0, qpos/hinge)",
    *(
        f"{call}('{names}')"
        for call in ("sum", "norm", "min", "max")
        for names in ("command/*", "action/?", "action/*")
    ),
    "sum('command/*'^2) + sum(abs('command/*')) - sum('command/*' / action/1) + sum(1 - 'command/*' * 2)",
    "sum(sin('command/*')) + sum('action/*'^2) + sum('action/*' + 'action/*') + norm(sqrt('action/*'))",
    "sum('action/?', command/goal/0) + norm('command/*', 2) + max('action/*', 0)",
    "sum(where(action/1 > 0, 'action/*', -1)) + where(action/1 <= 0 or action/2 != 1, action/3, 'command/goal/0')",
    "sum(clip('command/*' * qpos/hinge, -1, 1))",
    "sum('command/*', time)",
    "previous(action/1) + previous(previous(action/1)) + rate(action/1) + rate(rate(action/2))",
    "sum(('action/*' - previous('action/*'))^2) + norm(rate('command/*'))",
]
CONDITIONS = [
    "time > 0.1",
    "isfinite('action/*')",
    "not isfinite('command/*' / action/1) or isfinite(log(qpos/slide))",
    "action/1 < 0 and not (action/2 >= 1 or action/3 == action/4) and action/5 != 1",
    "rate(action/1) > 0",
]


@pytest.mark.parametrize("is_condition", [False, True])
def test_a_world_alone_gets_the_same_bits(is_condition: bool) -> None:
    parse = parse_task_condition if is_condition else parse_task_value
    texts = CONDITIONS if is_condition else VALUES
    expressions = [parse(text, COLUMNS, "value") for text in texts]
    expected = among_others(expressions)
    row = np.zeros(len(NAMES))
    sources = {name: (row, place) for place, name in enumerate(NAMES)}
    for world in range(SERIES.shape[1]):
        alone = [each.evaluator(1) for each in expressions]
        programs = []
        for is_first in (True, False):
            program = RowFunctionBuilder(sources, is_first)
            values = [program.value(each) for each in alone]
            programs.append(program.function("time", f"[{', '.join(values)}]"))
        for instant, columns in enumerate(SERIES[:, world]):
            row[:] = columns
            with np.errstate(all="ignore"):
                ours = programs[instant > 0](0.05 * instant)
            for text, value, other in zip(texts, ours, expected[instant, :, world], strict=True):
                assert same_bits(value, other), (text, world, instant, value, other)


def among_others(expressions: Sequence[TaskExpression]) -> np.ndarray:
    """The values of all worlds together `(instants, expressions, worlds)`."""
    evaluators = [each.evaluator(SERIES.shape[1]) for each in expressions]
    values = []
    for instant, columns in enumerate(SERIES):
        known = dict(zip(NAMES, columns.T.copy(), strict=True)) | {"time": np.full(len(columns), 0.05 * instant)}
        with np.errstate(all="ignore"):
            values.append([(each.advance if instant else each.begin)(known) for each in evaluators])
    return np.array(values)


def same_bits(value: float, other: float) -> bool:
    """Whether two numbers are the same, or both no number; 0 is not the same as -0."""
    return np.float64(value).tobytes() == np.float64(other).tobytes() or bool(np.isnan(value) and np.isnan(other))


@pytest.mark.parametrize("seed", range(20))
def test_numbers_are_copied_to_their_places(seed: int) -> None:
    generator = np.random.default_rng(seed)
    arrays = [np.zeros(40), np.zeros(40)]
    adjacent = [(array, i) for array in arrays for i in range(generator.integers(1, 20))]
    scattered = [(arrays[generator.integers(2)], int(i)) for i in generator.integers(40, size=generator.integers(30))]
    sources = adjacent + scattered
    places = (
        sorted(generator.choice(60 + len(sources), len(sources), replace=False).tolist())
        if seed % 2
        else [*range(len(sources))]
    )
    program = RowFunctionBuilder({}, False)
    program.copy(dict(zip(places, sources, strict=True)), "values")
    copy = program.function("values, time", "None")
    for array in arrays:
        array[:] = generator.normal(size=40)  # after the function was compiled
    values = np.zeros(200)
    copy(values, 0.0)
    expected = np.zeros(200)
    expected[places] = [array[i] for array, i in sources]
    np.testing.assert_array_equal(values, expected)


def test_only_arithmetic_needs_no_numpy() -> None:
    def uses_numpy(text: str) -> bool:
        row = np.zeros(len(NAMES))
        program = RowFunctionBuilder({name: (row, place) for place, name in enumerate(NAMES)}, False)
        program.value(parse_task_value(text, COLUMNS, "value").evaluator(1))
        return program.uses_numpy

    assert not uses_numpy("norm('command/*') + where(isfinite('action/*'), action/1^2 / 3, rate(action/2))")
    for text in ("1/action/1", "action/1^3", "sin(action/1)", "sum('action/*'^2)", "max(action/1, 0)"):
        assert uses_numpy(text)
