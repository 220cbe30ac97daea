"""What a comparison finds, as text."""

from dataclasses import replace
from pathlib import Path

from mjrun.cli.diff_report import cases, text, verdict
from mjrun.cli.report_formats import github
from mjrun.diff.result import (
    CellDifference,
    ColumnDifference,
    DiffResult,
    FieldDifference,
    ModelComparison,
    TableDifference,
    UnmatchedRows,
    XmlChange,
    XmlPlace,
)

NONE = UnmatchedRows(0, None, None)


def column(index: int, differs: bool, atol: float = 0) -> ColumnDifference:
    cell = CellDifference(index + 1, index + 1, 0.5, "1.0", "2.0") if differs else None
    return ColumnDifference(f"x{index}", "m", atol, 0, int(differs), float(differs) + atol / 2, 0.5, 0, cell, cell)


def result(*columns: ColumnDifference) -> DiffResult:
    table = TableDifference("time", 9, 9, 9, NONE, NONE, columns, [], [], [])
    differences = [column.name for column in columns if column.first]
    return DiffResult("table", "a\x1b.csv", "b.csv", not differences, differences, ["MuJoCo is 4 and 5"], table)


def test_a_verdict_says_how_exact_it_is() -> None:
    assert verdict(result(column(0, False))) == r"a\x1b.csv and b.csv agree: 9 rows, 1 column, bit for bit"
    assert verdict(result(column(0, False, 0.5), column(1, False, 0.1))) == (
        r"a\x1b.csv and b.csv agree: 9 rows, 2 columns, within the tolerance; the largest difference is 0.25, of x0"
    )
    assert text(result(column(0, False))) == verdict(result(column(0, False)))


def test_many_columns_are_cut_unless_all_are_asked_for() -> None:
    many = result(*(column(i, i < 40) for i in range(77)))
    shown = text(many).splitlines()
    assert len(shown) < 45
    assert "… 16 more: --verbose lists them" in text(many)
    assert "and 37 more columns agree" in shown
    assert [line.strip() for line in shown[-2:]] == ["possible reasons", "MuJoCo is 4 and 5"]
    assert "first difference  row 1, time 0.5 s: x0" in text(many)
    assert "x39" in text(many, every=True)
    assert [case.level for case in cases(many)] == ["error"] * 10
    assert [case.level for case in cases(result(column(0, False)))] == [""]


def test_annotations_point_at_a_file_that_exists(tmp_path: Path) -> None:
    golden = tmp_path / "golden.csv"
    golden.touch()
    for a, b, file in ((str(golden), "scene:car", str(golden)), ("none.csv", str(golden), str(golden)), ("x", "y", "")):
        differ = DiffResult("golden", a, b, False, ["energy differs"])
        line = github(cases(differ))
        assert line.startswith(f"::error file={file},title=" if file else "::error title=")


def test_models_are_reported_field_by_field() -> None:
    fields = [FieldDifference("geom_group", f"g{i}", (), (0,), (1,)) for i in range(12)]
    model = ModelComparison("a.xml", "b.xml", fields, [], [], [], [], [])
    differ = DiffResult("model", "a.xml", "b.xml", False, ["…"], model=model)
    assert text(differ).splitlines()[:3] == ["a.xml and b.xml differ", "", "geom_group[g0] 0 → 1"]
    assert text(differ).splitlines()[-1] == "… and 2 more like this"
    assert text(differ, every=True).splitlines()[-1] == "geom_group[g11] 0 → 1"

    changes = [XmlChange("<site>", "", None, None, None, XmlPlace("b.xml", 3))]
    same = ModelComparison("a.xml", "b.xml", [], [], [], [], [], changes)
    agree = DiffResult("model", "a.xml", "b.xml", True, [], model=same)
    assert text(agree) == "a.xml and b.xml agree: they compile to the same model; their XML differs in 1 place"
    near = DiffResult("model", "a.xml", "b.xml", True, [], model=replace(same, exact=False))
    assert text(near).startswith("a.xml and b.xml agree: they compile to the same model within the tolerance; their")
