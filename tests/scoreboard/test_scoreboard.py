"""Tests of the quick part of each measure, and of the page that the whole scoreboard writes."""

import pytest

from tests.scoreboard.__main__ import MEASURES, measure
from tests.scoreboard.measure import Measure, Tally, notes_of, rows_of, whole_page


@pytest.mark.slow
@pytest.mark.parametrize("name", MEASURES)
def test_the_quick_part_clears_its_bar(name: str) -> None:
    tally = measure(name).run(True)
    assert not tally.failures, "\n".join(tally.failures)
    assert tally.tried


def test_a_page_is_read_as_it_was_written() -> None:
    models = Measure("models", "0 tracebacks", 1, lambda quick: Tally())
    tally = Tally(left_out=["shared models: there are none here"])
    tally.expect(True, "fine")
    tally.expect(False, "a\nhang")
    row, notes = models.row(tally), models.notes(tally)
    page = whole_page([models], {"models": row}, {"models": notes})
    assert rows_of(page) == {"models": row}
    assert "| models | 2 | 1 | 0 tracebacks |" in row
    assert notes_of(page) == {"models": notes}
    assert "- missed: a hang\n- not tried: shared models: there are none here\n" in notes
