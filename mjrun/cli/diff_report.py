"""The report of a comparison, in prose and as cases for CI systems."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from mjrun.cli.console import CommandReport
from mjrun.cli.report_formats import CiVerdict
from mjrun.cli.simulation_command import golden_summary
from mjrun.cli.table_cells import ReportColumn
from mjrun.cli.terminal_layout import TerminalReport
from mjrun.diff import sentences
from mjrun.diff.result import (
    CellDifference,
    ColumnDifference,
    DiffResult,
    TableDifference,
    UnmatchedRows,
    VideoOrImageDifference,
)
from mjrun.errors import clean, counted, flag, listing, spelled
from mjrun.formats.input_file import is_file

ROWS = 24  # of a table, unless all are asked for
NAMED = 4  # columns that differ in the first row
REPORTED = 10  # differences as cases: GitHub shows no more of a step


def diff_report(result: DiffResult, *, every: bool) -> CommandReport:
    """Returns the report of a comparison; `every` lists all differing columns or values."""
    return CommandReport(
        "diff",
        result,
        summary=lambda: text(result, every=every),
        cases=lambda: cases(result),
        remark=lambda: verdict(result),
    )


def text(result: DiffResult, *, every: bool = False) -> str:
    """Formats the verdict and the differences; `every` lists all differing columns or values."""
    if result.equal or (result.golden and result.golden.updated):
        return verdict(result)
    if result.model:
        return "\n".join([verdict(result), "", *sentences.model_lines(result.model, every=every)])
    page = TerminalReport()
    if result.table:
        _table(page, result, result.table, every)
    elif result.picture:
        _picture(page, result.picture, result.differences)
    else:
        page.lines("differences", [("", sentence) for sentence in result.differences])
    if result.notes:
        page.lines("possible reasons", [("", note) for note in result.notes])
    return f"{verdict(result)}\n\n{page.text()}"


def verdict(result: DiffResult) -> str:
    """Formats the verdict in one line."""
    if result.golden and result.golden.updated:
        return golden_summary(result)
    pair = f"{clean(result.a)} and {clean(result.b)}"
    golden = f"; {sentences.golden_versions(result.golden)}" if result.golden else ""
    if result.equal:
        return f"{pair} agree{_agreement(result)}{golden}"
    shared = sentences.shared_sentence(result.table, _row_word(result)) if result.table and not result.golden else ""
    return f"{pair} differ{golden}{f': {spelled(shared, flag)}' if shared else ''}"


def cases(result: DiffResult) -> Iterator[CiVerdict]:
    """Yields a case for each difference, or one that passed."""
    if result.equal or (result.golden and result.golden.updated):
        yield CiVerdict(verdict(result))
        return
    file = next((name for name in (result.b, result.a) if is_file(Path(name))), "")
    title = f"mjrun diff: {result.b} differs from {result.a}"
    for sentence in result.differences[:REPORTED]:
        yield CiVerdict(result.b, "error", title, sentence, file)


def _agreement(result: DiffResult) -> str:
    if result.model:
        places = f"; their XML differs in {counted(len(result.model.xml), 'place')}" if result.model.xml else ""
        within = "" if result.model.exact else " within the tolerance"
        return f": they compile to the same model{within}{places}"
    if result.picture:
        return _picture_agreement(result.picture)
    if result.table is None:
        return ""
    table = result.table
    exact = all(column.atol == column.rtol == 0 for column in table.columns)
    both = " that both have" if _is_partial(table) else ""
    size = f": {counted(table.rows, _row_word(result))}, {counted(len(table.columns), 'column')}{both}"
    if exact:
        return f"{size}, bit for bit"
    worst = max(table.columns, key=lambda column: column.maximum or 0)
    largest = f"; the largest difference is {_number(worst.maximum)}, of {clean(worst.name)}" if worst.maximum else ""
    return f"{size}, within the tolerance{largest}"


def _is_partial(table: TableDifference) -> bool:
    """Returns whether a row or column exists in only one of the two tables."""
    return bool(table.only_a.count or table.only_b.count or table.columns_only_a or table.columns_only_b)


def _picture_agreement(picture: VideoOrImageDifference) -> str:
    size = f": {counted(picture.frames, 'frame')}" if picture.frames > 1 else ":"
    if picture.worst is None:
        return f"{size} pixel for pixel" if picture.frames == 1 else f"{size}, pixel for pixel"
    joint = "" if picture.frames == 1 else ", the worst"
    return f"{size}{joint} {sentences.frame_place(picture.worst, picture)}{sentences.frame_facts(picture.worst)}"


def _table(page: TerminalReport, result: DiffResult, table: TableDifference, every: bool) -> None:
    what, key = _row_word(result), "number" if table.aligned == "row" else clean(table.aligned)
    differing = [column for column in table.columns if column.first]
    facts = [
        ("compared", f"{counted(table.rows, what)} of the same {key}"),
        ("first difference", _first_difference(differing, table)),
        ("only in A", _unmatched(table.only_a, table.aligned)),
        ("only in B", _unmatched(table.only_b, table.aligned)),
        ("columns only in A", listing(table.columns_only_a)),
        ("columns only in B", listing(table.columns_only_b)),
        ("units", "; ".join(f"{clean(u.name)} [{clean(u.a)}] and [{clean(u.b)}]" for u in table.units)),
    ]
    page.lines(f"{what}s", facts)
    if differing:
        shown = None if every else ROWS
        page.table("columns that differ", _columns(differing, table), len(differing), shown, "--verbose lists them")
    if agreeing := len(table.columns) - len(differing):
        more = "more " if differing else ""
        page.note(f"and {counted(agreeing, f'{more}column')} agree{'s' if agreeing == 1 else ''}")


def _picture(page: TerminalReport, picture: VideoOrImageDifference, differences: Sequence[str]) -> None:
    page.lines("differences", [("", sentence) for sentence in differences])
    if picture.frames_a > 1 and picture.frames:
        facts = [
            ("frames", f"{picture.frames} compared, {picture.differing} differ"),
            ("PSNR", "" if picture.psnr is None else f"{picture.psnr:.2f} dB"),
            ("SSIM", "" if picture.ssim is None else f"{picture.ssim:.4f}"),
            ("pixels", f"{sentences.percent(picture.changed)} changed"),
        ]
        page.lines("all frames", facts)


def _row_word(result: DiffResult) -> str:
    return "state" if result.kind == "recording" else "row"


def _first_difference(differing: Sequence[ColumnDifference], table: TableDifference) -> str:
    """Formats the columns of the first row with a differing number."""
    firsts = [(column.first, clean(column.name)) for column in differing if column.first]
    if not firsts:
        return ""
    earliest = min((cell for cell, _ in firsts), key=lambda cell: cell.row)
    names = [name for cell, name in firsts if cell.row == earliest.row]
    return (
        f"{sentences.place(earliest, table.aligned)}: {', '.join(names[:NAMED])}{', …' if len(names) > NAMED else ''}"
    )


def _columns(columns: Sequence[ColumnDifference], table: TableDifference) -> list[ReportColumn]:
    firsts = [column.first for column in columns if column.first]
    cells = [sentences.cell_texts(column, column.first) for column in columns if column.first]
    by_step = table.aligned == "step"
    return [
        ReportColumn("column", [clean(column.name) for column in columns]),
        ReportColumn("unit", [clean(column.unit) for column in columns]),
        ReportColumn("rows", [str(column.differing) for column in columns], right=True),
        ReportColumn("maximum", [_size(column, column.maximum) for column in columns], right=True),
        ReportColumn("rms", [_size(column, column.rms) for column in columns], right=True, extra=True),
        ReportColumn("last", [_size(column, column.last) for column in columns], right=True, extra=True),
        ReportColumn("first step" if by_step else "first row", [_row(cell, by_step) for cell in firsts], right=True),
        ReportColumn("time", ["" if cell.at is None or by_step else repr(cell.at) for cell in firsts], "s", right=True),
        ReportColumn("a", [a for a, _ in cells], right=True),
        ReportColumn("b", [b for _, b in cells], right=True, paired=True),
    ]


def _row(cell: CellDifference, by_step: bool) -> str:
    if by_step and cell.at is not None:
        return f"{cell.at:.0f}"
    return str(cell.row) if cell.row == cell.row_b else f"{cell.row}/{cell.row_b}"


def _unmatched(rows: UnmatchedRows, aligned: str) -> str:
    if not rows.count:
        return ""
    return f"{rows.count}, {'the first is ' if rows.count > 1 else ''}{sentences.unmatched_place(rows, aligned)}"


def _size(column: ColumnDifference, value: float | None) -> str:
    return "" if column.text else _number(value)


def _number(value: float | None) -> str:
    return "not finite" if value is None else f"{value:.3g}"
