"""Tables in memory: as text, in notebooks and as other libraries' frames."""

import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import MissingExtraError
from mjrun.formats.table_reader import SHOWN_COLUMNS, SHOWN_ROWS, NumericTable

TABLE = NumericTable({"time": np.arange(12) / 10, "a<b>": np.array([np.nan, *range(11)])}, {"time": "s"})


def test_a_table_in_words_has_its_size_and_the_range_of_each_column() -> None:
    assert repr(TABLE) == "Table of 12 rows and 2 columns\n  time [s]  0 to 1.1\n  a<b>      0 to 10"
    assert repr(NumericTable({"x": np.full(1, np.nan)})) == "Table of 1 row and 1 column\n  x  no numbers"
    assert repr(NumericTable({})) == "Table of 0 rows and 0 columns"
    wide = NumericTable({str(i): np.zeros(1) for i in range(SHOWN_COLUMNS + 3)})
    assert repr(wide).endswith("… and 3 columns more")


def test_a_notebook_shows_the_rows_at_both_ends_and_escapes_names() -> None:
    head, body = ElementTree.fromstring(f"<div>{TABLE._repr_html_()}</div>").findall("table/*")
    assert ["".join(cell.itertext()) for cell in head.iter("th")] == ["times", "a<b>"]
    rows = [[cell.text for cell in row] for row in body]
    assert [row[0] for row in rows] == ["0", "0.1", "0.2", "0.3", "0.4", "…", "0.7", "0.8", "0.9", "1", "1.1"]
    short = NumericTable({"x": np.arange(2 * SHOWN_ROWS)})
    shown = ElementTree.fromstring(f"<div>{short._repr_html_()}</div>").findall("table/tbody/tr/td")
    assert [cell.text for cell in shown] == [str(i) for i in range(2 * SHOWN_ROWS)]


def test_a_table_becomes_a_frame_and_a_dictionary() -> None:
    frame = TABLE.to_pandas()
    pd.testing.assert_frame_equal(frame, pd.DataFrame(TABLE.columns))
    assert frame.attrs["units"] == {"time": "s", "a<b>": ""}
    assert TABLE.to_dict()["time"] == [i / 10 for i in range(12)]


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "polars", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"Table\.to_polars needs polars, which is not installed"):
        TABLE.to_polars()
