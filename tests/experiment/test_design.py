"""Points of a design: lists, spans, tables, random values, and conditions on them."""

import itertools
from fractions import Fraction
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.errors import FileError, MjrunError, UsageError
from mjrun.experiment.design import (
    Design,
    DesignColumn,
    GridPoints,
    LazyNumberTexts,
    _sampled,
    design,
    numbers,
    point_bound,
    texts_at,
    value_list,
)
from mjrun.experiment.samplers import SAMPLERS, SAMPLES
from mjrun.options import sweep as declared
from mjrun.options.sweep import VariationOptions
from mjrun.physics.random_distribution import Distribution
from tests.cases import cases
from tests.study.models import BALL

MODEL = mujoco.MjModel.from_xml_string(BALL)
COLUMNS = st.lists(st.lists(st.sampled_from(["1", "2", "0.5", "x"]), min_size=1, max_size=4), max_size=3)


def points(seed: int = 0, **options: Any) -> Design:
    return design(VariationOptions(**options), MODEL, seed)


def test_a_grid_is_all_with_all_the_last_changing_fastest() -> None:
    made = points(vary={"opt.timestep": "1,2", "seed": "1..3:3", "opt.cone": "a,b"})
    assert made.names == ("opt.timestep", "seed", "opt.cone")
    assert list(made.points) == list(itertools.product("12", "123", "ab"))


def test_zipped_lists_stand_side_by_side() -> None:
    assert list(points(vary={"a.x": "1,2,3", "a.y": "4,5,6"}, design="zip").points) == list(
        zip("123", "456", strict=True)
    )
    with pytest.raises(UsageError, match=r"not 2 of a\.x, 3 of a\.y"):
        points(vary={"a.x": "1,2", "a.y": "4,5,6"}, design="zip")


@pytest.mark.parametrize(
    ("options", "is_counted"),
    [
        ({"vary": [("seed", "1")]}, True),
        ({"vary": [("timestep", "1e-3,2e-3"), ("seed", "4;5;6")]}, True),
        ({"vary": [("timestep", "1e-3,2e-3")], "repeats": 3}, True),
        ({"vary": [("timestep", "1e-3,2e-3"), ("seed", "4,5")], "design": "zip"}, True),
        ({"vary": [("timestep", "1e-3,2e-3")], "where": ("timestep > 1.5e-3",)}, True),
        ({"vary": [("seed", "1..40:40")]}, False),
        ({"vary": [("timestep", "uniform(1e-3,2e-3)")], "samples": 2}, False),
        ({"vary": [("each:body/*.mass", "1,2")]}, False),
        ({}, False),
    ],
)
def test_lists_of_values_bound_the_number_of_points(options: dict[str, Any], is_counted: bool) -> None:
    bound = point_bound(VariationOptions(**options))
    assert len(points(**options).points) <= bound
    assert (bound < 7) == is_counted


def test_samples_are_combined_with_lists_and_repeats_with_all() -> None:
    made = points(vary={"a.x": "1,2", "a.y": "uniform(0,1)"}, samples=3, repeats=2, seed=5)
    assert made.names == ("a.x", "a.y", "seed")
    drawn = [point[1] for point in made.points[:6:2]]
    assert list(made.points) == list(itertools.product("12", drawn, ["5", "6"]))


def test_a_sobol_sequence_keeps_its_points_when_it_grows_and_fills_every_interval() -> None:
    vary = {"a.x": "uniform(0,1)", "a.y": "normal(0,1)"}
    drawn = {count: [*points(vary=vary, samples=count).points] for count in (5, 64, 100)}
    assert drawn[100][:5] == drawn[5]
    assert drawn[100][:64] == drawn[64]
    assert sorted(int(64 * float(x)) for x, _ in drawn[64]) == list(range(64))


def test_a_latin_hypercube_has_one_point_in_every_interval() -> None:
    drawn = points(vary={"a.x": "uniform(0,1)", "a.y": "uniform(0,2)"}, samples=50, sampler="lhs").points
    assert sorted(int(50 * float(x)) for x, _ in drawn) == list(range(50))
    assert sorted(int(25 * float(y)) for _, y in drawn) == list(range(50))


def test_every_sampler_and_every_design_that_can_be_asked_for_exists() -> None:
    assert {*SAMPLERS} == {*declared.SAMPLER_DESCRIPTIONS}
    for how in declared.DESIGNS:
        assert len(points(vary={"a.x": "1,2", "a.y": "3,4"}, design=how).points) == {"grid": 4, "zip": 2}[how]
    with pytest.raises(KeyError):  # and is not replaced by another one
        _sampled({"a.x": Distribution("uniform(0,1)", "uniform", ("0", "1"))}, 4, "hammersley", 1)


@pytest.mark.parametrize("sampler", declared.SAMPLER_DESCRIPTIONS)
@pytest.mark.parametrize(("count", "dimensions"), [(1, 1), (5, 3), (64, 2)])
def test_every_sampler_draws_as_many_points_as_asked_for_between_0_and_1(
    sampler: str, count: int, dimensions: int
) -> None:
    drawn = SAMPLERS[sampler](count, dimensions, np.random.default_rng(3))
    in_sample = dimensions + SAMPLES[sampler][1] if sampler in SAMPLES else 1
    assert drawn.shape == (count * in_sample, dimensions)
    assert ((drawn >= 0) & (drawn < 1)).all()


@pytest.mark.parametrize("sampler", declared.SAMPLER_DESCRIPTIONS)
def test_the_seed_decides_the_samples(sampler: str) -> None:
    vary = {"a.x": "uniform(0,1)"}
    one, same, other = ([*points(seed, vary=vary, sampler=sampler).points] for seed in (1, 1, 2))
    assert one == same != other


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"vary": {"seed": "1,2"}}, "sampler requires vary NAME=uniform"),
        ({"vary": {"seed": "1,2", "a.x": "uniform(0,1)"}}, "without the list of vary seed"),
        ({"vary": {"a.x": "uniform(0,1)"}, "repeats": 2}, "without repeats"),
        ({"vary": {"a.x": "uniform(0,1)"}, "where": ["x > 0"]}, "without where"),
        ({"vary": {"a.x": "uniform(0,1)"}, "samples": 9_000_000}, "18,000,000 points"),
    ],
)
def test_designs_for_sensitivities_have_complete_samples_of_distributions(options: dict[str, Any], match: str) -> None:
    with pytest.raises(UsageError, match=match):
        points(sampler="morris", **options)


def test_random_samples_are_independent_and_have_the_mean_of_their_distribution() -> None:
    drawn = np.array(
        points(vary={"a.x": "uniform(0,1)", "a.y": "uniform(0,1)"}, samples=4000, sampler="random").points, float
    )
    assert np.abs(drawn.mean(axis=0) - 0.5).max() < 5 * 0.29 / 4000**0.5
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 5 / 4000**0.5


def test_each_object_that_a_wildcard_matches_varies_on_its_own() -> None:
    made = points(vary={"each:scale:geom/*.friction[0]": "uniform(0,1)"}, samples=2)
    assert made.names == ("scale:geom/floor.friction[0]", "scale:geom/ball.friction[0]")
    assert made.points[0][0] != made.points[0][1]


def test_points_come_from_a_table(tmp_path: Path) -> None:
    table = tmp_path / "points.csv"
    table.write_text("opt.timestep, qpos/ball/z\n.001, 1\n.002, 2\n")
    made = points(points=str(table), vary={"seed": "7,8"})
    assert made.names == ("opt.timestep", "qpos/ball/z", "seed")
    assert list(made.points) == [(".001", "1", "7"), (".001", "1", "8"), (".002", "2", "7"), (".002", "2", "8")]


def test_conditions_leave_points_out() -> None:
    made = points(
        vary={"body/ball.mass": "1,2,5", "opt.density": "0,1"}, where=["mass*density < 3", "mass > 1 or density == 1"]
    )
    assert list(made.points) == [("1", "1"), ("2", "0"), ("2", "1"), ("5", "0")]


@cases("options, expected")
def test_points_that_cannot_be_are_refused(options: Any, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        points(**options)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "a table of points has a header"),
        (b"a.x\n", "a table of points has a header"),
        (b"a.x,a.x\n1,2\n", "a table of points has a header"),
        (b"a.x,a.y\n1\n", "row 2 does not have one value for each of the 2 columns"),
        (b"a.x,a.y\n\n1,2\n\n1\n", "row 5 does not have one value for each of the 2 columns"),
        (b"a.x,a.y,b.x\n1,,\n", "row 2 has no value of a.y, b.x\neach column is a parameter$"),
        (b"PAR1\x15\x04\x15\n\xff\n", "cannot be read as CSV text in UTF-8"),
    ],
)
def test_a_table_that_has_no_points_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    table = tmp_path / "points.csv"
    table.write_bytes(content)
    with pytest.raises(MjrunError, match=rf"points\.csv: {reason}"):
        points(points=str(table))
    with pytest.raises(FileError):
        points(points=str(tmp_path / "missing.csv"))


def test_without_anything_that_varies_there_is_one_point() -> None:
    assert list(points().points) == [()]


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a,b", ["a", "b"]), (" 1 , 2 ", ["1", "2"]), ("0,0,1;0,0,2", ["0,0,1", "0,0,2"]), ("a", ["a"])],
)
def test_values_of_a_scan_are_separated_by_commas_or_semicolons(text: str, expected: list[str]) -> None:
    assert [*value_list("opt.x", text, "scan")] == expected


@pytest.mark.parametrize("text", ["", "a,,b", "a,a", ";"])
def test_a_scan_without_values_or_with_one_twice_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="scan opt"):
        value_list("opt.x", text, "scan")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.1..1:10", ["0.1", "0.2", "0.3", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1"]),
        ("-1..1:3", ["-1", "0", "1"]),
        (".1...5:3", ["0.1", "0.3", "0.5"]),
        ("1..40:40", [str(seed) for seed in range(1, 41)]),
        ("0..1:3,7", ["0", "0.5", "1", "7"]),
        ("log:1e-4..1e-1:4", ["0.0001", "0.001", "0.01", "0.1"]),
        ("log:1..2:3", ["1", repr(2**0.5), "2"]),
        ("..", [".."]),
    ],
)
def test_a_span_is_spelled_out(text: str, expected: list[str]) -> None:
    assert [*value_list("opt.x", text, "scan")] == expected


def test_values_with_units_are_numbers_in_si_units() -> None:
    """As pint or a pocket calculator converts them; the simulation gets the texts, whose units it checks."""
    vary = {"qpos/a": "10deg,20deg", "geom/g.size": "25mm..35mm:3", "qpos/b": "uniform(10deg, 20deg)"}
    made = points(vary=vary, samples=2, where=["a > 0.2", "size < 0.032"])
    assert [made.column(0).numbers, made.column(1).numbers] == [
        pytest.approx([np.pi / 9] * 4),
        pytest.approx([0.025, 0.025, 0.03, 0.03], rel=1e-15),
    ]
    assert {values[:2] for values in made.points} == {("20deg", "25mm"), ("20deg", "30mm")}
    assert all(values[2].endswith("deg") and 10 < float(values[2][:-3]) < 20 for values in made.points)
    drawn, plain = made.column(2).numbers, points(vary={"qpos/b": "uniform(10, 20)"}, samples=2).column(0).numbers
    assert drawn is not None
    assert plain is not None
    np.testing.assert_allclose(drawn, np.tile(np.radians(plain), 2))


UNLIKE = ["10deg..20:3", "uniform(10deg, 20)", "10deg..200mm:3", "uniform(10, 20deg)", "uniform(500g, 1.5kg)"]


@pytest.mark.parametrize("text", [*UNLIKE, "loguniform(20m, 10mm)"])
def test_ends_in_different_units_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"same unit|all numbers in (deg|g|m), or all without a unit"):
        points(vary={"qpos/a": text})


def test_a_range_without_a_count_shows_both_things_that_it_may_mean() -> None:
    with pytest.raises(UsageError, match=r"-0\.5\.\.1e-1:10 for ten values, or uniform\(-0\.5,1e-1\)"):
        value_list("opt.x", "-0.5..1e-1", "vary")


@pytest.mark.parametrize("text", ["a..b:3", "0..1:1", "1..1:3", "0..1:x", "log:0..1:3", "0..1:2000000", "0..1:3,1"])
def test_a_span_that_has_no_values_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="vary opt"):
        value_list("opt.x", text, "vary")


def grid(columns: list[list[str]]) -> GridPoints:
    count = int(np.prod([len(texts) for texts in columns], initial=1))
    ends = np.cumprod([1, *[len(texts) for texts in columns]])[1:]
    return GridPoints([(texts, count // int(end)) for texts, end in zip(columns, ends, strict=True)], count)


@given(COLUMNS, st.data())
def test_points_are_those_of_nested_loops(columns: list[list[str]], data: Any) -> None:
    expected, made = list(itertools.product(*columns)), grid(columns)
    chosen = data.draw(st.lists(st.integers(0, len(expected) - 1), unique=True).map(sorted))
    some, some_expected = made.only(np.array(chosen, int)), [expected[index] for index in chosen]
    for points, all_expected in ((made, expected), (some, some_expected), (some.only(np.arange(len(chosen))), None)):
        all_expected = some_expected if all_expected is None else all_expected
        assert list(points) == [points[index] for index in range(len(points))] == all_expected
        part = slice(*sorted(data.draw(st.tuples(st.integers(0, 9), st.integers(0, 9)))))
        assert points[part] == all_expected[part]
        for number in range(len(columns)):
            column = Design(("p",) * len(columns), points).column(number)
            values = [point[number] for point in all_expected]
            assert texts_at(column.texts, column.places) == values
            assert sorted(column.distinct) == sorted({*values})
            assert [*points.distinct(number)] == [*column.distinct]
            assert len({*column.texts}) == len(column.texts)
            texts = column.numbers
            assert (texts is None) == ("x" in values)
            assert texts is None or texts.tolist() == [float(text) for text in values]


def test_the_digest_changes_with_every_value_and_their_order() -> None:
    columns = [["1", "2"], LazyNumberTexts(np.array([1.0, 2.0]), has_integers=True)]
    base = GridPoints([(columns[0], 2), (columns[1], 1)], 4)
    others = [
        GridPoints([(columns[1], 2), (columns[0], 1)], 4),
        GridPoints([(columns[0], 1), (columns[1], 2)], 4),
        GridPoints([(columns[0], 2), (LazyNumberTexts(np.array([1.0, 2.0])), 1)], 4),
        GridPoints([(columns[0], 2), (LazyNumberTexts(np.array([1.0, 3.0]), has_integers=True), 1)], 4),
        base.only(np.array([0, 1, 2])),
        GridPoints([(["1,2"], 2), (columns[1], 1)], 2),
    ]
    assert len({made.digest for made in (base, *others)}) == 1 + len(others)
    assert GridPoints(base.columns, 4).digest == base.digest


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=9))
def test_numbers_have_the_shortest_texts(values: list[float]) -> None:
    texts = LazyNumberTexts(np.array(values, float))
    assert list(texts) == [texts[index] for index in range(len(texts))] == [repr(value) for value in values]
    read, column = numbers(texts), DesignColumn.of(texts, np.arange(len(values)))
    assert read is not None
    assert read.tolist() == values
    assert texts_at(column.texts, column.places) == list(texts)
    assert len({*column.texts}) == len(column.texts) == len({*texts})
    assert [*texts.only(np.arange(len(values))[::2])] == [repr(value) for value in values[::2]]


@pytest.mark.parametrize("text", ["1..7:7", "0.1..0.7:7", "-1e-3..2:31", "1..1e12:5", "0..1e17:3", "1e-18..3e-18:3"])
def test_a_span_is_rounded_once(text: str) -> None:
    first, rest = text.split("..")
    last, count = rest.split(":")
    step = (Fraction(last) - Fraction(first)) / (int(count) - 1)
    exact = [Fraction(first) + step * index for index in range(int(count))]
    texts = [*value_list("p", text, "vary")]
    assert [float(value) for value in texts] == [float(value) for value in exact]
    assert [text.removeprefix("-").isdecimal() for text in texts] == [value.denominator == 1 for value in exact]


def test_whole_numbers_that_floats_round_stay_texts() -> None:
    large = 2**53
    for text in ("0.5", str(large), str(large + 2), "1e300", ""):
        assert numbers([text, "3"]) is not None
    assert numbers([str(large + 1), "3"]) is None
    column = DesignColumn([str(large), str(large + 1)], np.array([0, 1]))
    assert column.numbers is None
    assert [*column.distinct] == [str(large), str(large + 1)]


@pytest.mark.parametrize("text", ["1/0..2:3", "0.5..1e400:3", "1e5000..2e5000:2", "log:1..1e400:3"])
def test_spans_beyond_the_floats_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"with numbers|at most"):
        value_list("x", text, "vary")


def test_whole_numbers_beyond_the_floats_remain_texts() -> None:
    assert numbers(["9" * 400, "1"]) is None


def test_repeats_have_consecutive_seeds_where_floats_have_gaps() -> None:
    first = 2**53 - 1
    repeated = design(VariationOptions(repeats=4), mujoco.MjModel.from_xml_string(BALL), first)
    assert [*repeated.points] == [(str(first + index),) for index in range(4)]


def test_more_points_than_a_float_can_count_are_refused() -> None:
    with pytest.raises(UsageError, match=r"10\^400 points; a study has"):
        points(vary={f"body/ball.user[{index}]": "0..9:10" for index in range(400)})


@pytest.mark.parametrize("sign", ["", "+", "-"])
def test_whole_numbers_of_any_sign_remain_texts_where_floats_round_them(sign: str) -> None:
    exact, rounded = 2**53, 2**53 + 1
    assert numbers([f"{sign}{exact}", "1"]) is not None
    assert numbers([f"{sign}{rounded}", "1"]) is None
