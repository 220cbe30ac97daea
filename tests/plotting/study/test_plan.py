"""The figures that suit studies, and their statistics."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import BadValueError, MissingExtraError, UnknownNameError, UsageError
from mjrun.formats.study_reader import StudyResults, TextColumn
from mjrun.options.plot import FigureOptions
from mjrun.plotting.study.figure_data import DrawnStudyFigure, GraphPanel, HeatmapPanel, SensitivityPanel
from mjrun.plotting.study.plan import StudyFigurePlan
from mjrun.plotting.study.statistics import QUANTILES, Parameter, dependences, quantiles, rank_correlations, summary

Columns = Mapping[str, "np.ndarray | list[str]"]


def results(parameters: Columns, metrics: Mapping[str, np.ndarray], status: np.ndarray | None = None) -> StudyResults:
    count = len(next(iter(parameters.values())))
    numbers = {name: values for name, values in parameters.items() if isinstance(values, np.ndarray)}
    texts = {name: TextColumn.of(values) for name, values in parameters.items() if not isinstance(values, np.ndarray)}
    states = TextColumn.of(["ok"] * count if status is None else status.tolist())
    return StudyResults("study", list(parameters), list(metrics), {**numbers, **metrics}, {**texts, "status": states})


def drawn(study: StudyResults, **options: object) -> DrawnStudyFigure:
    return StudyFigurePlan(study, FigureOptions(**options)).drawing  # type: ignore[arg-type]


STEP = np.repeat(np.geomspace(1e-4, 1e-1, 7), 9)
SEED = np.tile(np.arange(9.0), 7)
DRIFT = np.random.default_rng(5).normal(5, 1, 63) * STEP


def test_one_parameter_with_repeats_is_its_median_and_bands() -> None:
    rng = np.random.default_rng(5)
    drift = np.where(rng.random(63) < 0.1, np.nan, DRIFT)
    status = np.where(np.isnan(drift), "unstable", "ok")
    (panel,) = drawn(results({"opt.timestep": STEP, "seed": SEED}, {"drift": drift}, status)).panels
    assert isinstance(panel, GraphPanel)
    assert panel.x.log
    assert panel.x.name == "opt.timestep"
    (series,) = panel.series
    groups = pd.DataFrame({"x": STEP, "y": drift}).groupby("x")["y"]
    np.testing.assert_array_equal(series.x, list(groups.groups))
    np.testing.assert_allclose(series.y, groups.median(), rtol=1e-12)
    for band, (low, high) in zip(series.bands, [(0.05, 0.95), (0.25, 0.75)], strict=True):
        np.testing.assert_allclose(band.low, groups.quantile(low), rtol=1e-12)
        np.testing.assert_allclose(band.high, groups.quantile(high), rtol=1e-12)
    (failures,) = panel.failures
    assert failures.status == "unstable"
    np.testing.assert_array_equal(failures.x, STEP[np.isnan(drift)])


def test_one_parameter_without_repeats_is_a_curve_without_bands() -> None:
    (panel,) = drawn(results({"mass": np.array([3.0, 1, 2])}, {"z": np.array([9.0, 7, 8])})).panels
    assert isinstance(panel, GraphPanel)
    (series,) = panel.series
    assert series.x.tolist() == [1, 2, 3]
    assert series.y.tolist() == [7, 8, 9]
    assert not series.bands


def test_two_parameters_on_a_grid_are_a_map_of_medians() -> None:
    a, b = np.repeat(np.arange(4.0), 15), np.tile(np.repeat(np.arange(5.0), 3), 4)
    rng = np.random.default_rng(5)
    z = rng.normal(size=60)
    z[(a == 1) & (b == 2)] = np.nan
    status = np.where(np.isnan(z), "crashed", "ok")
    panel, _ = drawn(results({"a": a, "b": b, "seed": rng.random(60)}, {"z": z, "w": z}, status)).panels
    assert isinstance(panel, HeatmapPanel)
    table = pd.DataFrame({"a": a, "b": b, "z": z}).pivot_table(index="b", columns="a", values="z", aggfunc="median")
    np.testing.assert_allclose(panel.values, table.to_numpy(), rtol=1e-12)
    assert np.argwhere(panel.failed).tolist() == [[2, 1]]
    status[(a == 1) & (b == 2)] = ["crashed", "ok", "crashed"]  # a metric may have no value at a point that is ok
    panel, _ = drawn(results({"a": a, "b": b, "seed": rng.random(60)}, {"z": z, "w": z}, status)).panels
    assert isinstance(panel, HeatmapPanel)
    assert not panel.failed.any()


def test_x_chooses_curves_and_the_other_parameter_their_colours() -> None:
    a, model = np.tile(np.arange(5.0), 2), ["a.xml"] * 5 + ["b.xml"] * 5
    study = results({"a": a, "model": model}, {"z": a**2})
    for (panel,) in (drawn(study).panels, drawn(study, x="a").panels):
        assert isinstance(panel, GraphPanel)
        assert panel.x.name == "a"
        assert [series.name for series in panel.series] == ["model = a.xml", "model = b.xml"]
    (panel,) = drawn(study, x="model").panels
    assert isinstance(panel, GraphPanel)
    assert panel.x.categories == ["a.xml", "b.xml"]
    assert not panel.series[0].joined


def test_coinciding_curves_take_turns_and_are_noted() -> None:
    mass, kind = np.tile(np.arange(5.0), 4), np.repeat(["Euler", "RK4", "implicit", "other"], 5)
    height = np.where(kind == "other", 9 - mass, mass**2) + np.where(kind == "RK4", 1e-9, 0)
    study = results({"mass": mass, "integrator": kind.tolist()}, {"z": height})
    plan = StudyFigurePlan(study, FigureOptions())
    (panel,) = plan.drawing.panels
    assert isinstance(panel, GraphPanel)
    assert [series.turn for series in panel.series] == [(0, 3), (1, 3), (2, 3), (0, 1)]
    (note,) = plan.notes
    assert all(name in note for name in ("Euler", "RK4", "implicit"))
    assert "other" not in note


def test_points_where_a_parameter_does_not_exist_are_a_curve_and_a_row_of_their_own() -> None:
    a = np.array([0.0, *np.repeat([1, 2, 3], 3)])
    number, text = np.array([np.nan, *[4, 5, 6] * 3]), ["", *["x", "y", "z"] * 3]
    for b, names in ((number, ["4", "5", "6", "none"]), (text, ["none", "x", "y", "z"])):
        study = results({"a": a, "b": b}, {"z": 10 * a})
        (panel,) = drawn(study, x="a").panels
        assert isinstance(panel, GraphPanel)
        assert [series.name for series in panel.series] == [f"b = {name}" for name in names]
        assert sum(len(series.x) for series in panel.series) == len(a)
    (panel,) = drawn(results({"a": a, "b": number}, {"z": 10 * a})).panels
    assert isinstance(panel, HeatmapPanel)
    assert panel.rows.categories == ["4", "5", "6", "none"]
    np.testing.assert_array_equal(panel.values[3], [0, np.nan, np.nan, np.nan])


def test_indices_of_sensitivity_have_the_intervals_of_their_table() -> None:
    known = {"first": 0.5, "first_low": 0.25, "first_high": 0.75, "total": 0.625}
    indices = {"z": {index: {"a": value, "b": value / 2} for index, value in known.items()}}
    study = replace(results({"a": STEP, "b": SEED}, {"z": DRIFT}), sensitivity=indices)
    (panel,) = drawn(study).panels
    assert isinstance(panel, SensitivityPanel)
    expected = [[[0.25, 0.75], [0.125, 0.375]], [[np.nan, np.nan]] * 2]
    np.testing.assert_array_equal(panel.intervals, expected)  # type: ignore[arg-type]
    assert panel.ends
    assert panel.ends[1] > 0.75
    with pytest.raises(UsageError, match="log does not apply to indices of sensitivity"):
        drawn(study, log="y")


def test_parameters_are_in_the_order_of_their_indices_beside_a_constant_metric() -> None:
    a, b = STEP, SEED
    nothing = {index: {"a": np.nan, "b": np.nan} for index in ("first", "total")}
    known = {index: {"a": 0.25, "b": 0.75} for index in ("first", "total")}
    for order in (("constant", "z"), ("z", "constant")):
        metrics = {name: np.ones(63) if name == "constant" else DRIFT for name in order}
        study = replace(results({"a": a, "b": b}, metrics), sensitivity={"constant": nothing, "z": known})
        for panel in drawn(study).panels:
            assert isinstance(panel, SensitivityPanel)
            assert list(panel.parameters) == ["b", "a"]


def test_a_study_whose_metrics_have_no_indices_is_drawn_as_any_other() -> None:
    samples = {"samples": {"a": 4.0, "b": 4.0}}  # the columns of indices are left out if all of them are undefined
    study = replace(results({"a": STEP, "b": SEED}, {"z": np.ones(63)}), sensitivity={"z": samples})
    assert not any(isinstance(panel, SensitivityPanel) for panel in drawn(study).panels)


def test_few_random_parameters_are_dots_and_x_may_be_a_metric() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.random((2, 40))
    study = results({"a": a, "b": b}, {"z": a + b, "w": a - b})
    drawing = drawn(study)
    assert drawing.columns == 2
    assert drawing.description == "z, w"
    assert [panel.x.name for panel in drawing.panels if isinstance(panel, GraphPanel)] == ["a", "b", "a", "b"]
    (panel,) = drawn(study, x="z", y=("w*2",)).panels
    assert isinstance(panel, GraphPanel)
    assert panel.label == "w*2"
    np.testing.assert_array_equal(panel.series[0].y, 2 * (a - b))


def test_a_grid_with_random_parameters_too_has_bands_over_them() -> None:
    rng = np.random.default_rng(5)
    a, b = np.repeat(np.arange(4.0), 20), rng.random(80)
    (panel,) = drawn(results({"a": a, "b": b}, {"z": a + b})).panels
    assert isinstance(panel, GraphPanel)
    assert panel.x.name == "a"
    assert len(panel.series[0].bands) == 2


def test_many_parameters_are_parallel_coordinates_and_rank_correlations() -> None:
    rng = np.random.default_rng(0)
    values, kind = rng.random((50, 4)), [str(k) for k in rng.choice(["x", "y", "z"], 50)]
    z = values[:, 0] - 2 * values[:, 1]
    z[7] = np.nan
    parameters = {name: column.copy() for name, column in zip("abcd", values.T, strict=True)}
    plan = StudyFigurePlan(results({**parameters, "kind": kind}, {"z": z, "w": -z}), FigureOptions(y=("w",)))
    drawing = plan.drawing
    assert drawing.above
    assert [axis.name for axis in drawing.above.scales] == ["a", "b", "c", "d", "kind", "w"]
    assert drawing.above.failed.tolist() == [True] + [False] * 49
    (panel,) = drawing.panels
    assert isinstance(panel, SensitivityPanel)
    frame: Any = pd.DataFrame({**parameters, "w": -z})
    expected = frame.corr(method="spearman")["w"].drop("w").sort_values(key=np.abs, ascending=False)
    assert list(panel.parameters) == expected.index.tolist()
    np.testing.assert_allclose(panel.correlations, expected, rtol=1e-12)
    assert plan.notes == ["kind: texts without an order have no rank correlation"]


def test_lines_of_the_extremes_are_on_top_beside_failed_points() -> None:
    values = np.random.default_rng(0).random((50, 4))
    z = np.where(np.arange(50) % 5 < 2, values[:, 0], np.nan)
    above = drawn(results(dict(zip("abcd", values.T.copy(), strict=True)), {"z": z})).above
    assert above
    assert set(above.values[-2:, -1]) == {np.nanmin(z), np.nanmax(z)}
    assert above.values[30, -1] in np.sort(z)[9:11]


def test_lines_of_many_points_are_chosen_evenly() -> None:
    rng = np.random.default_rng(5)
    values = rng.random((9000, 4))
    plan = StudyFigurePlan(
        results(dict(zip("abcd", values.T.copy(), strict=True)), {"z": values[:, 0]}), FigureOptions()
    )
    assert plan.drawing.above
    assert len(plan.drawing.above.values) == 4000
    assert plan.notes == ["4000 of 9000 points have a line, evenly chosen"]


def test_a_metric_without_values_is_noted_and_the_others_are_drawn() -> None:
    draws = np.random.default_rng(1).uniform(size=(4, 40))
    study = results(dict(zip("abcd", draws, strict=True)), {"fell": np.full(40, np.nan), "height": draws[0]})
    plan = StudyFigurePlan(study, FigureOptions())
    assert [panel.label for panel in plan.drawing.panels] == ["height"]
    assert plan.drawing.above is not None
    assert plan.drawing.above.scales[-1].name == "height"
    assert plan.notes == ["fell: no point has a value"]


def test_what_cannot_be_shown_is_reported() -> None:
    a, z = np.arange(3.0), np.full(3, np.nan)
    with pytest.raises(UsageError, match="no metrics"):
        drawn(results({"a": a}, {}))
    with pytest.raises(UsageError, match="no parameter varies"):
        drawn(results({"a": np.ones(3)}, {"z": a}))
    with pytest.raises(UnknownNameError, match="mss"):
        drawn(results({"a": a}, {"z": a}), x="mss")
    with pytest.raises(BadValueError, match="one parameter"):
        drawn(results({"a/b": a, "a/c": a}, {"z": a}), x="a/*")
    plan = StudyFigurePlan(results({"a": a}, {"z": z}), FigureOptions())
    assert plan.drawing.panels
    assert plan.notes == ["z: no point has a value"]


def test_correlations_are_those_of_pandas_without_what_is_missing() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=(60, 3)).round(1)  # with ties
    metric = np.exp(values[:, 0]) - values[:, 1] ** 3 + 0.1 * rng.normal(size=60)
    metric[[4, 9, 33]] = np.nan
    frame = pd.DataFrame(np.column_stack([values, metric]))
    expected = frame.corr(method="spearman").to_numpy()[:3, 3]
    np.testing.assert_allclose(rank_correlations(list(values.T), metric), expected, rtol=1e-12)


def test_dependence_on_normal_values_is_their_correlation_and_has_any_shape() -> None:
    random = np.random.default_rng(2)
    x, noise = random.normal(size=(2, 20_000))
    for correlation in (0.0, 0.5, -0.9):
        y = correlation * x + np.sqrt(1 - correlation**2) * noise
        assert dependences([x], y)[0] == pytest.approx(abs(correlation), abs=0.06)
    square = x**2
    assert abs(rank_correlations([x], square)[0]) < 0.05
    assert dependences([x], square)[0] > 0.85
    assert dependences([np.sign(x)], np.abs(x))[0] < 0.05
    level = np.tile([0.0, 1, 2], 9)
    assert dependences([level], (level == 1).astype(float))[0] > 0.8
    assert np.isnan(dependences([np.ones(5)], np.arange(5.0))[0])


def test_dependence_is_one_where_one_value_determines_the_other() -> None:
    numbers = np.arange(60.0)
    level, ordered = numbers % 2, numbers**3
    for a, b in ((level, 1 - level), (level, numbers % 4), (ordered, numbers)):
        assert dependences([a], b)[0] == pytest.approx(1, abs=1e-12)
        assert dependences([b], a)[0] == pytest.approx(1, abs=1e-12)


def test_marks_ranges_and_labels_belong_to_their_panels() -> None:
    study = results({"mass": np.array([1.0, 2, 3])}, {"z": np.array([7.0, 8, 9]), "w": np.array([0.0, 1, 2])})
    study = replace(study, units={"mass": "kg", "z": "m"})
    options = {"mark": ("x:limit=2", "2:top=5"), "xlim": (0.0, 4.0), "ylim": ("1:0..20",), "ylabel": ("2:width",)}
    first, second = drawn(study, **options).panels
    assert isinstance(first, GraphPanel)
    assert isinstance(second, GraphPanel)
    assert [(mark.label, mark.vertical) for mark in first.marks] == [("limit", True)]
    assert [mark.label for mark in second.marks] == ["limit", "top"]
    assert (first.x.name, first.x.low, first.x.high) == ("mass [kg]", 0, 4)
    assert (first.label, first.y.low, first.y.high) == ("z [m]", 0, 20)
    assert (second.label, second.axis_label) == ("w", "width")
    assert second.y.low <= 0 < 5 <= second.y.high
    assert drawn(study, xlabel="load [kg]").panels[0].x.name == "load [kg]"  # type: ignore[union-attr]
    assert [each.label for each in drawn(study, y=("z * 2", "z + 1", "z [mm]=z*1000")).panels] == [
        *("z * 2", "z + 1 [m]", "z [mm]"),
    ]


@pytest.mark.parametrize(
    "option",
    [
        {"mark": ("1",)},
        {"xlim": (0.0, 1.0)},
        {"ylim": ("0..1",)},
        {"xlabel": "a"},
        {"log": ("x",)},
        {"log": ("both",)},
    ],
)
def test_maps_have_no_marks_of_curves(option: dict[str, object]) -> None:
    grid = results({"a": np.array([0.0, 0, 1, 1]), "b": np.array([0.0, 1, 0, 1])}, {"z": np.arange(4.0)})
    with pytest.raises(UsageError, match="does not apply to heat maps"):
        drawn(grid, **option)


def test_what_does_not_vary_has_none() -> None:
    found = rank_correlations([np.ones(5), np.arange(5.0)], np.arange(5.0) ** 3)
    assert np.isnan(found[0])
    assert found[1] == pytest.approx(1)
    assert np.isnan(rank_correlations([np.arange(5.0)], np.array([1, 2, np.nan, np.nan, np.nan]))).all()


def test_without_scipy_the_extra_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="scipy"):
        rank_correlations([], np.empty(0))


def test_medians_are_those_of_the_finite_values_of_each_group() -> None:
    rng = np.random.default_rng(0)
    groups, values = rng.integers(0, 9, 60), rng.normal(size=60)
    values[::7], values[groups == 4] = np.nan, np.inf
    expected = [values[(groups == group) & np.isfinite(values)] for group in range(11)]
    made = [np.median(each) if len(each) else np.nan for each in expected]
    np.testing.assert_array_equal(quantiles(groups, values, 11, [0.5])[0], made)


def test_a_summary_has_median_and_quantiles_of_the_finite_values_at_each_place() -> None:
    rng = np.random.default_rng(1)
    places, values = rng.integers(0, 6, 50).astype(float), rng.normal(size=50)
    values[::9], chosen = np.nan, places != 3
    made = summary("", Parameter("x", places, np.arange(6.0)), values, chosen, 0)
    inside = [values[(places == place) & np.isfinite(values)] for place in (0, 1, 2, 4, 5)]
    assert made.x.tolist() == [0, 1, 2, 4, 5]
    np.testing.assert_allclose(made.y, [np.median(each) for each in inside], rtol=1e-12)
    for band, (low, high) in zip(made.bands, QUANTILES, strict=True):
        np.testing.assert_allclose(band.low, [np.quantile(each, low) for each in inside], rtol=1e-12)
        np.testing.assert_allclose(band.high, [np.quantile(each, high) for each in inside], rtol=1e-12)
