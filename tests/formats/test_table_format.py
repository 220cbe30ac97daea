"""What a table format is."""

import pytest

from mjrun.errors import MissingExtraError
from mjrun.formats.table_format import TableFormat
from mjrun.formats.tables import formats


def test_a_library_is_required_only_where_there_is_one() -> None:
    csv = formats()["csv"]
    csv.require_library("writing .csv")
    absent = TableFormat("x", (".x",), csv.writer, None, library="no_such_library", extra="x")
    with pytest.raises(MissingExtraError, match=r"writing .x needs no-such-library.*\npip install 'mjrun\[x\]'"):
        absent.require_library("writing .x")
