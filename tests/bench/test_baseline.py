"""Comparison of timings and their samples with those of a baseline."""

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.bench.results import (
    TimingSamples,
    check_same,
    compare,
    read_base,
    steps_of,
    timings,
    verdict,
    workload_obstacle,
)
from mjrun.errors import FileError, UsageError
from tests.cases import cases

BASE = [1.00, 1.01, 1.02, 0.99, 1.03, 1.00, 0.98, 1.01]


def document(samples: list[float] = BASE, **changed: Any) -> dict[str, Any]:
    """Returns the compared parts of a benchmark with one row and one frame."""
    step = {"samples": samples}
    threads = [{"threads": 1, "step": step}, {"threads": 2, "step": {"samples": [s / 2 for s in samples]}}]
    frame = {
        "view": "rgb",
        "size": [64, 48],
        "quality": "model",
        "renderer": "classic",
        "device": "a GPU",
        "total": step,
    }
    engine = {"name": "c", "device": "cpu", "device_name": "a CPU", "worlds": 1, "nconmax": None, "njmax": None}
    return {
        "schema": "mjrun-bench-1",
        "mujoco": "4.0.0",
        "engine": engine,
        "machine": {"system": "Linux", "cpu": "a CPU", "cores": 2, "available": 2},
        "model": {"sha256": "a", "file_sha256": "b"},
        "options": {"key": None, "noise_std": 0.01, "noise_rate": 0.1, "settings": [], "steps": None},
        "rows": [{"point": {}, "steps": 100, "step": step, "threads": threads, "failure": None}],
        "frames": [frame],
        **changed,
    }


def scaled(factor: float) -> dict[str, Any]:
    return document([factor * sample for sample in BASE])


@pytest.mark.parametrize(
    ("factor", "expected"), [(1.3, "slower"), (1.0, "not slower"), (1.1, "inconclusive"), (0.8, "faster")]
)
def test_every_timing_that_both_have_is_compared(factor: float, expected: str) -> None:
    result = compare(scaled(factor), document(), "base.json", 0.1)
    assert [ratio.name for ratio in result.ratios] == ["step", "threads 2", "rgb 64x48 model"]
    for ratio in result.ratios:
        assert ratio.ratio == pytest.approx(factor)
        assert ratio.fastest == pytest.approx(factor)
        assert ratio.low == pytest.approx(factor * 0.98 / 1.03)  # the extremes: 8 samples give no less for 97.5 %
        assert ratio.high == pytest.approx(factor * 1.03 / 0.98)
        assert ratio.verdict == expected
    assert (result.verdict, result.limit) == (expected, 1.1)


def with_workload(document: dict[str, Any], samples: list[float], version: int = 1) -> dict[str, Any]:
    """Returns the same with a reference workload."""
    row, frame = document["rows"][0], document["frames"][0]
    stat = {"samples": samples}
    threads = [{**one, "reference_workload": stat} for one in row["threads"]]
    return {
        **document,
        "reference_workload": {"version": version, "steps": 100},
        "rows": [{**row, "reference_workload": stat, "threads": threads}],
        "frames": [{**frame, "reference_workload": stat}],
    }


@given(st.lists(st.floats(0.01, 100), min_size=8, max_size=8))
def test_ratios_are_those_of_quotients_so_that_what_slows_both_in_a_turn_is_not_seen(factors: list[float]) -> None:
    base = with_workload(document(), [0.5] * 8)
    now = document([1.3 * factor * sample for factor, sample in zip(factors, BASE, strict=True)])
    result = compare(with_workload(now, [0.5 * factor for factor in factors]), base, "base.json", 0.1)
    for ratio in result.ratios:
        assert ratio.ratio == pytest.approx(1.3)
        assert ratio.low == pytest.approx(1.3 * 0.98 / 1.03)
        assert ratio.high == pytest.approx(1.3 * 1.03 / 0.98)
        assert ratio.reference_workload == pytest.approx(sorted(factors)[3] / 2 + sorted(factors)[4] / 2)


def test_the_fastest_samples_are_compared_relative_to_the_fastest_of_the_workload() -> None:
    base = with_workload(document(), [0.5] * 7 + [0.4])
    result = compare(with_workload(scaled(3), [1.0] * 8), base, "base.json", 0.1)
    assert result.ratios[0].fastest == pytest.approx(3 / (1.0 / 0.4))


@pytest.mark.parametrize("there", [document(), with_workload(document(), [0.5] * 8, version=2)])
def test_without_the_same_workload_wall_times_are_compared_as_they_are(there: dict[str, Any]) -> None:
    result = compare(with_workload(scaled(2), [1.0] * 8), there, "base.json", 0.1)
    assert {(ratio.ratio, ratio.reference_workload) for ratio in result.ratios} == {(2.0, None)}
    assert result.verdict == "slower"


def test_another_mujoco_may_be_slower_with_its_workload_so_that_wall_times_are_compared() -> None:
    base = with_workload(document(mujoco="4.0.1"), [0.5] * 8)
    now = with_workload(scaled(2), [1.0] * 8)
    assert "MuJoCo 4.0.1" in (workload_obstacle(now, base) or "")
    assert compare(now, base, "base.json", 0.1).verdict == "slower"
    assert workload_obstacle(now, with_workload(document(), [0.5] * 8)) is None


@pytest.mark.parametrize(
    ("low", "high", "fastest", "expected"),
    [
        (1.11, 1.4, 1.3, "slower"),
        (1.11, 1.4, 1.09, "inconclusive"),  # all but the fastest were disturbed
        (1.10, 1.4, 1.3, "inconclusive"),
        (1.0, 1.11, 1.0, "inconclusive"),
        (0.9, 1.1, 1.0, "not slower"),
        (0.8, 0.99, 0.9, "faster"),
        (None, None, 2.0, "inconclusive"),
    ],
)
def test_the_verdict_follows_from_the_interval_the_fastest_sample_and_the_limit(
    low: float | None, high: float | None, fastest: float, expected: str
) -> None:
    assert verdict(low, high, fastest, 1.1) == expected


def test_the_worst_timing_decides() -> None:
    now = scaled(0.8)
    now["rows"][0]["step"] = {"samples": [2 * sample for sample in BASE]}
    assert compare(now, document(), "base.json", 0.1).verdict == "slower"


def test_too_few_samples_are_inconclusive_however_slow() -> None:
    result = compare(document([9.0] * 6), document(), "base.json", 0.1)
    assert {ratio.verdict for ratio in result.ratios} == {"inconclusive"}
    assert result.ratios[0].low is None


def test_points_of_a_grid_and_devices_are_compared_with_their_own() -> None:
    now, base = document(), document()
    row = now["rows"][0]
    now["rows"] = [{**row, "point": {"timestep": step}} for step in (".1", ".2")]
    base["rows"] = [{**row, "point": {"timestep": step}} for step in (".2", ".3")]
    base["frames"][0] = {**base["frames"][0], "device": "another GPU"}
    result = compare(now, base, "base.json", 0.1)
    assert [ratio.name for ratio in result.ratios] == ["step timestep=.2", "threads 2 timestep=.2"]
    assert steps_of(base, {"timestep": ".2"}) == 100
    assert steps_of(base, {"timestep": ".1"}) is None


def grid(*timesteps: str, failed: str = "") -> dict[str, Any]:
    """Returns a benchmark of a grid, one point of which may have failed."""
    row = document()["rows"][0]
    rows = [{**row, "point": {"timestep": timestep}} for timestep in timesteps]
    nothing = {"step": None, "threads": [], "failure": "the simulation became unstable at step 3"}
    return document(rows=[{**row, **nothing} if row["point"]["timestep"] == failed else row for row in rows], frames=[])


@pytest.mark.parametrize(
    ("now", "gone", "expected"),
    [
        (grid(".1", ".2"), [], "not slower"),
        (grid(".1"), [False, False], "not slower"),
        (grid(".1", ".2", failed=".2"), [True, True], "failed"),
        (grid(".2", failed=".2"), [False, False, True, True], "failed"),
    ],
)
def test_a_timing_that_only_the_base_has_is_named_and_fails_where_it_could_not_be_measured(
    now: dict[str, Any], gone: list[bool], expected: str
) -> None:
    result = compare(now, grid(".1", ".2"), "base.json", 0.1)
    assert [one.failure is not None for one in result.gone] == gone
    assert result.verdict == expected
    names = [name for name, _ in (of for of, _ in timings(grid(".1", ".2")))]
    assert sorted([one.name for one in result.gone] + [ratio.name for ratio in result.ratios]) == sorted(names)
    assert {one.base for one in result.gone} <= {1.005, 0.5025}


def test_what_the_base_could_not_measure_either_is_no_loss() -> None:
    unstable = grid(".1", ".2", failed=".2")
    assert compare(unstable, unstable, "base.json", 0.1).verdict == "not slower"


def test_benchmarks_of_different_things_have_no_timing_in_common() -> None:
    now, base = document(rows=[]), document(frames=[])
    with pytest.raises(UsageError, match=r"no timing in common.*\nit has step, threads 2"):
        compare(now, base, "base.json", 0.1)


@cases("part, key, value, expected")
def test_another_model_options_or_machine_is_refused_unless_forced(
    part: str, key: str, value: object, expected: str
) -> None:
    base = document()
    base[part] = {**base[part], key: value}
    with pytest.raises(UsageError, match=f"base.json is not a baseline.*\n{expected}\nforce"):
        check_same(document(), base, "base.json", force=False)
    assert len(check_same(document(), base, "base.json", force=True)) == 1
    assert check_same(document(), document(), "base.json", force=False) == []


def test_overrides_must_be_those_of_the_base() -> None:
    now, base = (document(options={**document()["options"], "settings": [f"opt.timestep={dt}"]}) for dt in (1, 2))
    with pytest.raises(UsageError, match="settings"):
        check_same(now, base, "base.json", force=False)


def test_steps_that_were_asked_for_must_be_those_of_the_base() -> None:
    now = document(options={**document()["options"], "steps": 70})
    with pytest.raises(UsageError, match="steps: 100 there, 70 here"):
        check_same(now, document(), "base.json", force=False)
    now["options"]["steps"] = 100
    assert check_same(now, document(), "base.json", force=False) == []


def test_of_two_versions_of_mujoco_the_files_are_compared_for_compiled_models_always_differ() -> None:
    base = document(mujoco="4.0.1", model={"sha256": "other", "file_sha256": "b"})
    assert check_same(document(), base, "base.json", force=False) == []
    base["model"]["file_sha256"] = "c"
    with pytest.raises(UsageError, match="another model file"):
        check_same(document(), base, "base.json", force=False)


def without(key: str) -> Callable[[dict[str, Any]], None]:
    return lambda changed: changed.pop(key)


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (
            lambda d: d.update(schema="mjrun-bench-0"),
            "is not a benchmark of this mjrun\n.*makes one with save",
        ),
        (without("machine"), "is an incomplete benchmark: KeyError 'machine'"),
        (lambda d: d["rows"][0]["step"].update(samples=[1, -1]), "samples must be positive"),
        (lambda d: d["rows"][0]["step"].update(samples=[]), "samples must be positive"),
        (lambda d: d["rows"][0]["step"].update(samples=[math.nan]), "samples must be positive"),
        (lambda d: d["rows"][0]["step"].update(samples=[math.inf]), "samples must be positive"),
        (lambda d: d["rows"][0]["step"].update(samples=[10**400]), "is an incomplete benchmark: OverflowError"),
        (lambda d: d.update(rows=3), "is an incomplete benchmark: TypeError"),
        (lambda d: d.update(reference_workload={}), "is an incomplete benchmark: KeyError 'version'"),
        (lambda d: d["rows"][0].update(reference_workload={"samples": [1.0]}), "as many samples as the timing"),
    ],
)
def test_a_file_that_is_no_benchmark_is_refused(
    tmp_path: Path, spoil: Callable[[dict[str, Any]], None], expected: str
) -> None:
    path, spoilt = tmp_path / "base.json", copy.deepcopy(document())
    path.write_text(json.dumps(spoilt))
    assert read_base(path) == spoilt
    spoil(spoilt)
    path.write_text(json.dumps(spoilt))
    with pytest.raises(FileError, match=expected):
        read_base(path)


@pytest.mark.parametrize("text", ["", "[]", "{", "3", "\x00", "[" * 100_000])
def test_a_file_that_is_not_json_or_not_an_object_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "base.json"
    path.write_text(text)
    with pytest.raises(FileError, match=r"is not(.|\n)*`mjrun bench` makes (a benchmark|one) with save"):
        read_base(path)
    with pytest.raises(FileError, match="cannot be read: No such file"):
        read_base(tmp_path / "none.json")


STEP, WORKLOAD = {"samples": [2.0, 4.0, 6.0]}, {"samples": [1.0, 2.0, 1.0]}


def row(**changed: Any) -> dict[str, Any]:
    return {"point": {}, "step": STEP, "threads": [], **changed}


def frame(**changed: Any) -> dict[str, Any]:
    return {
        "view": "depth",
        "size": [64, 48],
        "quality": "high",
        "renderer": "classic",
        "device": "a GPU",
        "total": STEP,
        **changed,
    }


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"rows": [row()], "frames": []}, [("step", "")]),
        ({"rows": [row(point={"a.b": "1"})], "frames": []}, [("step a.b=1", "")]),
        ({"rows": [row(step=None)], "frames": []}, []),
        (
            {"rows": [row(threads=[{"threads": n, "step": STEP} for n in (1, 4)])], "frames": []},
            [("step", ""), ("threads 4", "")],
        ),
        (
            {"rows": [], "frames": [frame(), frame(renderer="filament")]},
            [("depth 64x48 high", "a GPU"), ("depth 64x48 high filament", "a GPU")],
        ),
    ],
)
def test_a_timing_is_named_by_what_it_measures_its_point_and_its_device(
    document: dict[str, Any], expected: list[tuple[str, str]]
) -> None:
    assert [timing for timing, _ in timings(document)] == expected


def test_samples_are_divided_by_those_of_the_workload_in_the_same_turn() -> None:
    document = {"rows": [row(reference_workload=WORKLOAD)], "frames": [frame()]}
    (_, step), (_, drawn) = timings(document)
    assert step.workload is not None
    assert step.quotients(step.workload) == [2.0, 2.0, 6.0]
    assert (step.median, drawn.median, drawn.workload) == (4.0, 4.0, None)


@pytest.mark.parametrize("workload", [{"samples": [1.0]}, {"samples": [1.0, 0.0, 1.0]}, {"samples": []}])
def test_a_workload_without_a_positive_sample_for_each_turn_is_refused(workload: dict[str, list[float]]) -> None:
    with pytest.raises(ValueError, match="samples"):
        TimingSamples.read(STEP, workload)
