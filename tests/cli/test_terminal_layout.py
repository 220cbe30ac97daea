"""Theorems about pages of tables and lines."""

import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.cells import cell_len

from mjrun.cli.table_cells import ReportColumn
from mjrun.cli.terminal_layout import TerminalReport

WORDS = st.text("ab字_", min_size=1, max_size=60)


def page(monkeypatch: pytest.MonkeyPatch, width: int | None) -> TerminalReport:
    """A page for a terminal of this width; for a pipe if None."""
    if width is None:
        monkeypatch.delenv("COLUMNS", raising=False)
    else:
        monkeypatch.setenv("COLUMNS", str(width))
    return TerminalReport()


@given(
    cells=st.lists(st.tuples(WORDS, WORDS, WORDS), min_size=1, max_size=4),
    width=st.integers(30, 120),
)
def test_no_line_is_wider_than_the_terminal_and_no_character_of_the_first_column_is_lost(
    cells: list[tuple[str, str, str]], width: int
) -> None:
    with pytest.MonkeyPatch.context() as monkeypatch:
        written = page(monkeypatch, width)
        columns = [ReportColumn(heading, texts) for heading, texts in zip("xyz", zip(*cells, strict=True), strict=True)]
        written.table("title", columns, len(cells))
    lines = written.text().splitlines()
    assert max(map(cell_len, lines)) <= width
    shown = "".join("".join(lines).split())
    for name, *_ in cells:
        assert all(shown.count(character) >= name.count(character) for character in set(name))


def test_in_a_pipe_every_row_is_one_line_without_spaces_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, None)
    written.table("title", [ReportColumn("name", ["a" * 300, "b"]), ReportColumn("value", ["1", ""], right=True)], 2)
    gaps = r" {298,300}", r" {6,8}"  # rich before 14.3 takes two spaces more for the last column
    assert re.fullmatch(rf"title  2\n  name{gaps[0]}value\n  a{{300}}{gaps[1]}1\n  b", written.text())


def test_a_page_does_not_begin_with_a_blank_line(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, None)
    written.note("first")
    written.note("second")
    assert written.text() == "first\n\nsecond"


@pytest.mark.parametrize("width", [50, 80, None])
def test_paths_are_never_broken(monkeypatch: pytest.MonkeyPatch, width: int | None) -> None:
    path, text = (
        f"/data/{'long/' * 40}model.xml",
        "some words about it, which fit on several lines of a terminal of any width",
    )
    written = page(monkeypatch, width)
    written.lines("model", [("file", path), ("about", text), ("blank", "")])
    written.table(
        "assets",
        [ReportColumn("name", ["mesh"]), ReportColumn("size", ["1 KiB"]), ReportColumn("file", [path], whole=True)],
        1,
    )
    lines = written.text().splitlines()
    assert sum(path in line for line in lines) == 2
    assert " ".join(" ".join(lines).split()).count(text) == 1 or width is not None
    assert all(cell_len(line) <= (width or 10_000) for line in lines if "data" not in line and "mesh" not in line)


def test_columns_that_say_nothing_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, 80)
    written.table("title", [ReportColumn("name", ["a"]), ReportColumn("blank", [""]), ReportColumn("value", ["1"])], 1)
    assert "blank" not in written.text()


def test_what_has_no_room_is_named_and_extra_columns_go_first(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = [
        ReportColumn("name", ["a" * 10]),
        ReportColumn("kind", ["b" * 10]),
        ReportColumn("size", ["c" * 10], right=True),
    ]
    columns += [ReportColumn("extra", ["d" * 30], extra=True)]
    wide, narrow = page(monkeypatch, 80), page(monkeypatch, 40)
    wide.table("title", columns, 1)
    narrow.table("title", columns, 1)
    assert "d" * 30 in wide.text()
    assert "no room" not in wide.text()
    assert narrow.text().splitlines()[-1] == "  no room for extra; --json has them"
    assert "c" * 10 in narrow.text()


def test_two_values_to_compare_are_shown_both_or_neither(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = [ReportColumn(name, [name * 8], right=True) for name in "xyz"]
    columns += [ReportColumn("a", ["3" * 8], right=True), ReportColumn("b", ["4" * 8], right=True, paired=True)]
    for width, note in ((50, ""), (46, "  no room for a, b; --json has them")):
        made = page(monkeypatch, width)
        made.table("title", columns, 1)
        assert made.text().splitlines()[-1] == note or not note
        assert ("3" * 8 in made.text()) == ("4" * 8 in made.text()) == (not note)


def test_a_table_that_is_cut_counts_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, 80)
    written.table("title", [ReportColumn("name", ["a", "b", "c"])], 3, shown=1, hint="ask")
    assert written.text().splitlines() == ["title  3", "  name", "  a", "  … 2 more: ask"]


def test_units_stand_under_headings_at_one_height(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, 80)
    written.table("title", [ReportColumn("name", ["a"]), ReportColumn("range", ["1"], "rad\nm", right=True)], 1)
    assert [line.split() for line in written.text().splitlines()[1:]] == [
        ["name", "range"],
        ["[rad]"],
        ["[m]"],
        ["a", "1"],
    ]


def test_sections_are_parted_by_a_blank_line_and_lines_without_a_value_are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    written = page(monkeypatch, 80)
    written.lines("one", [("mass", "1 kg"), ("file", "")])
    written.table("two", [ReportColumn("name", [])], 0)
    written.note("noted")
    assert written.text() == "one\n  mass  1 kg\n\ntwo  none\n\nnoted"


NAMED = ReportColumn("name", ["a", "b"])
CELLS = st.lists(st.text("ab 字", max_size=60), min_size=2, max_size=2)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.lists(st.tuples(CELLS, st.booleans(), st.booleans()), min_size=1, max_size=6), st.integers(40, 120))
def test_whatever_the_columns_no_line_is_wider_than_the_terminal(
    monkeypatch: pytest.MonkeyPatch, columns: list[tuple[list[str], bool, bool]], width: int
) -> None:
    made = [
        NAMED,
        *(ReportColumn(f"h{i}", cells, right=right, extra=extra) for i, (cells, right, extra) in enumerate(columns)),
    ]
    written = page(monkeypatch, width)
    written.table("title", [NAMED, *made], 2)
    lines = written.text().splitlines()
    assert all(cell_len(line) <= width for line in lines if "no room for" not in line)


def test_verbatim_lines_are_never_folded(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, 40)
    written.verbatim("title", ["word " * 30 + "end"])
    assert written.text() == f"title\n  {'word ' * 30}end"


def test_a_cell_of_a_million_characters_is_cut_in_the_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, 80)
    written.table("bodies", [ReportColumn("body", ["a" + "x" * 10**6 + "z"]), ReportColumn("type", ["box"])], 1)
    written.lines("file", [("path", "a" + "x" * 10**6 + "z")])
    shown = written.text()
    assert len(shown) < 4000
    assert shown.count("…") == shown.count("z") == 2


def test_names_of_a_tree_keep_their_stems(monkeypatch: pytest.MonkeyPatch) -> None:
    bodies, below = ["world", "└─ torso", "   └─ left_upper_arm"], ["│", "   │", "      "]
    tree = ReportColumn("body", bodies, below=below)
    written = page(monkeypatch, 40)
    written.table("bodies", [tree, ReportColumn("joints", ["", "hip_x, " * 9, "a"])], 3)
    lines = written.text().splitlines()
    assert any(line.startswith("  └─ torso") for line in lines)
    assert any(line.startswith("     └─ left_upper_arm") for line in lines)

    written = page(monkeypatch, 26)
    written.table("bodies", [tree, ReportColumn("mass", ["12345678"] * 3, right=True)], 3)
    assert [line[:16].rstrip() for line in written.text().splitlines()[-2:]] == [
        "     └─ left_upp",
        "        er_arm",
    ]


def test_numbers_are_shown_below_folded_headings(monkeypatch: pytest.MonkeyPatch) -> None:
    written = page(monkeypatch, 40)
    names = ["opt.gravity[2]", "opt.timestep", "top_height [m]"]
    written.table("means", [ReportColumn(name, ["-9.8125"], right=True) for name in names], 1)
    lines = written.text().splitlines()
    assert lines[-1].split() == ["-9.8125"] * 3
    assert max(map(len, lines)) <= 40
