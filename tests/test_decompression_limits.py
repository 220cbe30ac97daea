"""The limits of what compressed files expand to; the formats that they hold for are tested with each format."""

import os
from pathlib import Path

import pytest

from mjrun.decompression_limits import FREE, RATIO, largest_expansion, require_expandable
from mjrun.errors import FileError


@pytest.mark.parametrize(("size", "largest"), [(0, FREE), (1000, FREE), (FREE, RATIO * FREE)])
def test_a_file_may_expand_to_a_gibibyte_or_a_hundred_times_its_size(tmp_path: Path, size: int, largest: int) -> None:
    path = tmp_path / "a.npz"
    path.touch()
    os.truncate(path, size)
    assert largest_expansion(size) == largest
    require_expandable(path, largest)
    with pytest.raises(FileError, match=r"a\.npz: would expand to [\d.,e+]+ GB in memory") as caught:
        require_expandable(path, largest + 1)
    assert caught.value.exit_code == 7
    assert f"{(largest + 1) / max(1, size):,.0f} times its size" in str(caught.value)
    assert "write it again without compression" in str(caught.value)
