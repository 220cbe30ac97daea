"""The comparison as a job."""

from pathlib import Path

import numpy as np
import pytest

import mjrun
from mjrun.diff import file_kind
from mjrun.errors import UsageError
from mjrun.job.diff import COMPARISONS
from tests.formats.table_files import columns, write


def test_two_tables_agree_or_not(tmp_path: Path) -> None:
    names = columns("time", "x")
    a = write(tmp_path / "a.csv", [np.array([[0.0, 1], [1, 2]])], names)
    b = write(tmp_path / "b.npz", [np.array([[0.0, 1], [1, 2.5]])], names)
    result = mjrun.Diff(a, b).run()
    assert (result.kind, result.a, result.b, result.equal) == ("table", str(a), str(b), False)
    assert result.differences == ["x differs in row 2, time 1.0 s: 2.0, not 2.5"]
    assert result.table
    assert mjrun.Diff(a, b, atol=0.5).run().equal


def test_a_kind_of_files_is_told_before_anything_is_read() -> None:
    assert set(COMPARISONS) <= {file_kind.TABLE, file_kind.RECORDING, file_kind.VIDEO, file_kind.IMAGE, file_kind.MODEL}
    with pytest.raises(UsageError, match="only two of a kind can be compared"):
        mjrun.Diff("a.csv", "b.mp4").run()
