"""The quick part of each measure of the scoreboard, and the page that the whole of it writes."""

import pytest

from tests.scoreboard.__main__ import MODULES, measure, notes, notes_of, row, rows_of
from tests.scoreboard.measure import Measure, Tally


@pytest.mark.slow
@pytest.mark.parametrize("module", MODULES)
def test_the_quick_part_clears_its_bar(module: str) -> None:
    tally = measure(module).run(True)
    assert not tally.failures, "\n".join(tally.failures)
    assert tally.tried


def test_a_page_is_read_as_it_was_written() -> None:
    of = Measure("models", "0 tracebacks", 1, lambda quick: Tally())
    tally = Tally(left_out=["shared models: there are none here"])
    tally.expect(True, "fine")
    tally.expect(False, "a\nhang")
    head = "# page\n\n| measure | tried |\n|---|---|\n"
    page = head + row(of, tally) + "\n" + notes(of, tally)
    assert rows_of(page) == {"models": row(of, tally)}
    assert "| models | 2 | 1 | 0 tracebacks |" in row(of, tally)
    assert notes_of(page) == {"models": notes(of, tally)}
    assert "- missed: a hang\n- not tried: shared models: there are none here\n" in notes(of, tally)
