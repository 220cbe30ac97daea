"""Programs of expressions; `tests/task/test_single_world_expressions.py` compares their bits."""

from math import isnan
from typing import Any

import numpy as np

from mjrun.probe.expression_program import WorldsProgram
from mjrun.probe.parser import Parser
from mjrun.probe.vocabularies import Vocabulary


class CountedColumns(dict[str, Any]):
    """Columns that count how often they are read."""

    reads = 0

    def __getitem__(self, name: str) -> Any:
        self.reads += 1
        return super().__getitem__(name)


def test_common_parts_of_expressions_are_computed_once() -> None:
    vocabulary = Vocabulary(["a"])
    program = WorldsProgram(is_first=False)
    values = [
        program.value(Parser(text, "text", vocabulary).row_value())
        for text in ("exp(a) + 1", "2 * exp(a)", "1/0 - inf")
    ]
    columns = CountedColumns(a=np.array([0.0, 1.0]))
    with np.errstate(all="ignore"):
        first, second, third = program.function("columns, rows, count", f"[{', '.join(values)}]")(
            columns, slice(None), 2
        )
    assert columns.reads == 1
    np.testing.assert_array_equal(second, 2 * (first - 1))
    assert [*map(isnan, third)] == [True, True]
