"""Rows turned into columns: numpy's transpose is the oracle."""

import gc
import tracemalloc
import weakref
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.formats import table_writer
from mjrun.formats.table_writer import RowGroupBuffer, TableWriter, WholeColumnWriter
from mjrun.formats.tables import FORMATS
from mjrun.model.table_column import Column


@given(columns=st.integers(1, 5), cuts=st.lists(st.integers(0, 40), max_size=6).map(sorted), size=st.integers(1, 60))
def test_groups_are_the_transposed_rows_however_these_are_cut(columns: int, cuts: list[int], size: int) -> None:
    rows = np.arange(40.0 * columns).reshape(40, columns)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_writer, "GROUP", size)
        patch.setattr(table_writer, "FIRST_ROWS", 2)
        groups = RowGroupBuffer(columns)
        found = [group.copy() for block in np.split(rows, cuts) for group in groups.add(block)]
        found += [group.copy() for group in groups.rest()]
    assert np.array_equal(np.concatenate(found, axis=1), rows.T)
    full = max(1, size // columns)
    assert [group.shape[1] for group in found[:-1]] == [full] * (len(found) - 1)
    assert list(groups.rest()) == []


class Spilled(WholeColumnWriter):
    """Columns that wait until they are whole."""

    def end(self, manifest: str) -> None:
        self.saved = [np.concatenate(list(self.cells(index)[1])) for index in (2, 0, 1, 2)]
        self.kinds = [self.cells(index)[0].kind for index in range(3)]


def test_whole_columns_leave_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_writer, "GROUP", 12)
    rows = np.random.default_rng(0).integers(-9, 9, (25, 3)).astype(float)
    with (tmp_path / "t").open("wb") as file:
        writer = Spilled(file, [Column("a"), Column("b", integer=True), Column("c")], "")
        for block in np.array_split(rows, 4):
            writer.write(block)
        assert [path.name for path in tmp_path.iterdir()] == ["t"]
        writer.finish("")
    assert writer.rows == 25
    assert np.array_equal(writer.saved, rows.T[[2, 0, 1, 2]])
    assert writer.kinds == ["f", "i", "f"]
    writer.close()


def write(path: Path, columns: int = 20) -> TableWriter:
    """A published table of 500 rows."""
    with TableWriter(str(path), path.suffix[1:], [Column(f"c{i}") for i in range(columns)]) as out:
        out.write(np.zeros((500, columns)))
        out.publish()
    return out


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMATS)
def test_ten_tables_leave_no_memory_behind_even_while_their_writers_live(tmp_path: Path, form: str) -> None:
    write(tmp_path / f"t.{form}")
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        writers = [write(tmp_path / f"t.{form}") for _ in range(10)]
        assert tracemalloc.get_traced_memory()[0] - before < 2**18  # bytes; the rows of all have 0.8 MB
        del writers
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("form", FORMATS)
def test_a_writer_is_in_no_reference_cycle(tmp_path: Path, form: str) -> None:
    gc.disable()
    try:
        writer = write(tmp_path / f"t.{form}")
        reference = weakref.ref(writer)
        del writer
        assert reference() is None
    finally:
        gc.enable()
