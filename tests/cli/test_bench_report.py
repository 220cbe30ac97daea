"""Reports of benchmarks: text in 80 columns, Markdown, their tables, CSV, and pages."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mjrun.bench.bench import Bench
from mjrun.bench.block_timing import StepPhase
from mjrun.bench.results import BaselineComparison, BenchResult, MissingTiming, TimingComparison
from mjrun.cli.commands.bench import csv_table, digits, duration, markdown, sections, text
from tests.cases import cases, mjcf
from tests.page_cells import PageCells

SECOND = count(1.0).__next__  # a clock that advances by a second at every look
bench = partial(Bench, steps=20, repeats=8, threads=(1, 2))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "model.xml"
    path.write_text(mjcf("spring"))
    return path


@pytest.fixture(scope="module")
def result(path: Path) -> BenchResult:
    return bench(path, accuracy=True).run(clock=SECOND)


@pytest.fixture(scope="module")
def grid(path: Path) -> BenchResult:
    return bench(path, scan={"timestep": [".01", "1"]}, accuracy=True, horizon=100).run(clock=SECOND)


@pytest.fixture
def compared(result: BenchResult) -> BenchResult:
    ratio = TimingComparison("step", 1.0, 2.6, 1.3, 1.25, 1.35, 1.28, 2.0, "slower")
    unsure = replace(ratio, name="threads 2", low=None, high=None, reference_workload=2.5, verdict="inconclusive")
    missing = [MissingTiming("step a=1", 1.0, "unstable"), MissingTiming("step a=2", 1.0, None)]
    comparison = BaselineComparison("a|b.json", 1.1, "failed", [ratio, unsure], missing, ["key: a there, b\x1b here"])
    return replace(result, comparison=comparison)


def test_a_single_point_is_lines_and_a_grid_a_table_with_its_failures(result: BenchResult, grid: BenchResult) -> None:
    lines = text(result).splitlines()
    assert "step       1.000 s, 1.000 s to 1.000 s at 99.2 %" in lines
    assert "speed      1.000 steps/s, 0.010 times real time" in lines
    assert any(line.startswith("load       1.000 s the first time; again: parse 1.000 s") for line in lines)
    assert max(map(len, lines)) <= 80
    lines = text(grid).splitlines()
    assert not any(line.startswith("speed") for line in lines)
    table = [line.split() for line in lines if line.startswith("  ")]
    assert ["timestep", "step", "±", "real", "time", "drift", "distance"] in table
    assert [row[:3] for row in table if row[0] in (".01", "1")][1] == ["1", "failed", "-"]
    assert any(line.startswith("note: timestep=1: the simulation became unstable") for line in lines)


def test_a_comparison_tells_ratios_missing_figures_and_how_the_machine_has_changed(compared: BenchResult) -> None:
    lines = text(compared).splitlines()
    start = lines.index("against a|b.json; slower is above 1.1")
    cells = [line.split() for line in lines[start + 2 : start + 6]]
    assert cells[0] == ["step", "1.00", "s", "2.60", "s", "1.300", "1.250..1.350", "slower"]
    assert cells[1][-2:] == ["-", "inconclusive"]
    assert [row[-1] for row in cells[2:]] == ["failed", "measured"]
    assert "verdict: failed" in lines
    assert "relative to a reference workload, which took 2 to 2.5 times as long as in the baseline" in lines
    assert r"compared in spite of a difference: key: a there, b\x1b here" in lines


def test_markdown_has_the_same_tables_and_escapes_what_is_markup(compared: BenchResult) -> None:
    page = markdown(compared)
    assert r"against a\|b.json: **failed**" in page
    titles = [line.strip("*") for line in page.splitlines() if line.startswith("**")]
    assert titles == [title.replace("|", r"\|") for title, _ in sections(compared)]
    assert "| step | 1.00 s | 2.60 s | 1.300 | 1.250..1.350 | slower |" in page


def test_phases_are_a_tree_by_indent_and_by_path(result: BenchResult) -> None:
    tree = StepPhase(
        "step",
        2.0,
        1.0,
        [StepPhase("position", 1.5, 0.75, [StepPhase("collision", 1.0, 0.5)]), StepPhase("other", 0.5, 0.25)],
    )
    (row,) = result.rows
    changed = replace(result, rows=[replace(row, phases=tree)])
    (table,) = [table for title, table in sections(changed) if title.startswith("phases")]
    assert [line[0] for line in table] == ["phase", "step", "  position", "    collision", "  other"]
    header, record = csv.reader(csv_table(changed).splitlines())
    phases = {name: cell for name, cell in zip(header, record, strict=True) if name.startswith("phase/")}
    assert phases == {
        "phase/step": "2.0",
        "phase/step/position": "1.5",
        "phase/step/position/collision": "1.0",
        "phase/step/other": "0.5",
    }


def test_every_point_is_a_line_of_the_same_columns(grid: BenchResult) -> None:
    good, bad = csv.DictReader(csv_table(grid).splitlines())
    assert [*good] == [*bad]
    assert [good[name] for name in ("timestep", "step/n", "step/median", "steps_per_second")] == [
        *("0.01", "8", "1.0", "1.0")
    ]
    assert grid.rows[0].accuracy
    assert float(good["energy_drift"]) == grid.rows[0].accuracy.energy_drift
    assert (bad["step/median"], bad["contacts"], bad["energy_drift"]) == ("", "", "")
    assert bad["failure"].startswith("the simulation became unstable at step")


@cases("seconds, expected")
def test_a_duration_is_in_the_unit_that_suits_it(seconds: float | None, expected: str) -> None:
    assert duration(seconds) == expected


@pytest.mark.parametrize(
    ("value", "expected"), [(1234567.0, "1,234,567"), (0.5, "0.500"), (12.345, "12.35"), (1.5e12, "1.5e+12")]
)
def test_numbers_have_four_significant_digits_and_groups_of_three(value: float, expected: str) -> None:
    assert digits(value) == expected


if TYPE_CHECKING:
    from tests.conftest import Command


def test_the_page_has_the_tables_of_the_report(mjrun_here: Command) -> None:
    (mjrun_here.folder / "m.xml").write_text(
        '<mujoco><worldbody><body><joint/><geom size="1"/></body></worldbody></mujoco>'
    )
    options = ("--steps", "20", "--repeats", "2", "--scan", "integrator=euler,rk4")
    done = mjrun_here("bench", "m.xml", *options, "--html", "page.html")
    assert done.returncode == 0
    text = (mjrun_here.folder / "page.html").read_text("utf-8")
    cells = [cell for cell in PageCells(text).texts if cell]
    report = done.stdout.decode()
    for cell in cells[:10]:
        assert all(word in report for word in cell.split())
    assert "rk4" in cells
    assert "mjrun bench m.xml" in re.sub("</?span>", "", text)
    assert not re.search(r"<script", text)


def test_a_page_of_another_name_is_refused_before_measuring(mjrun_here: Command) -> None:
    done = mjrun_here("bench", "scene:pendulum", "--html", "page.txt")
    assert done.returncode == 2
    assert b"a file that ends with .html" in done.stderr
