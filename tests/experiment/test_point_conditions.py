"""A conditional parameter exists at exactly the points where its condition holds, and equal points are one."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.experiment.design import Design, chosen, design
from mjrun.options.sweep import VariationOptions
from tests.cases import cases
from tests.experiment.test_design import MODEL

GRID = {"opt.solver": "cg,newton", "opt.iterations": "5,10,50", "opt.ls_iterations": "1..4:4", "seed": "1,2"}


def points(**options: Any) -> Design:
    return design(VariationOptions(**{"vary": GRID, **options}), MODEL, seed=1)


def test_conditional_parameters_exist_where_their_conditions_hold_and_points_occur_once() -> None:
    made = points(when={"ls_iterations": "iterations < 20", "iterations": "solver == 'cg'"})
    expected = dict[tuple[str, ...], None]()
    for solver, iterations, line, seed in product(*(points().column(place).distinct for place in range(4))):
        iterations = iterations if solver == "cg" else ""
        line = line if iterations and int(iterations) < 20 else ""
        expected[solver, iterations, line, seed] = None
    assert list(made.points) == list(expected)
    assert made.values(0) == {"opt.solver": "cg", "opt.iterations": "5", "opt.ls_iterations": "1", "seed": "1"}
    assert made.values(len(made.points) - 1) == {"opt.solver": "newton", "seed": "2"}


def test_samples_stay_where_a_parameter_is_absent_and_its_numbers_are_nan() -> None:
    vary = {"a.x": "uniform(0,1)", "a.y": "normal(0,1)"}
    every, some = points(vary=vary), points(vary=vary, when={"y": "x < 0.5"})
    (x, y), (x_of_some, y_of_some) = ([made.column(place).numbers for place in (0, 1)] for made in (every, some))
    assert x is not None
    assert y is not None
    np.testing.assert_array_equal(x_of_some, x)
    np.testing.assert_array_equal(y_of_some, np.where(x < 0.5, y, np.nan))
    assert {point[1] == "" for point in some.points} == {True, False}


def test_conditions_on_points_compare_texts() -> None:
    assert {point[0] for point in points(where=["solver != 'cg'"]).points} == {"newton"}
    assert len(points(where=['opt.solver == "cg" and iterations > 20']).points) == 8
    made = points(when={"iterations": "solver == 'cg'"}, where=["iterations != 10"])
    assert {point[1] for point in made.points} == {"5", "50"}  # no comparison holds where it is absent


def test_what_is_quoted_after_a_comparison_is_a_text_whatever_it_contains() -> None:
    named = points(vary={"a.name": ["x == 'y'", "it's", "seed"], "seed": "1,2"})

    def names(condition: str) -> set[str]:
        return {point[0] for point in chosen(named, [condition]).points}

    assert names("""name == "x == 'y'" """) == {"x == 'y'"}
    assert names("not (name == 'it''s' or seed > 1)") == {"x == 'y'", "seed"}
    assert names("seed == '2' and name == 'seed' and seed > 1") == {"seed"}


@cases("options, expected")
def test_conditions_that_decide_nothing_are_refused(options: dict[str, Any], expected: str) -> None:
    with pytest.raises(UsageError) as raised:
        points(**options)
    assert expected in raised.value.spelled(lambda name: f"--{name}")
