"""Files that can run code are opened only where the user says so."""

from pathlib import Path

import pytest

from mjrun.errors import FileError, UsageError
from mjrun.policy.trust import require_trusted_file


def test_trust_is_asked_for_a_file_that_is_there(tmp_path: Path) -> None:
    path = tmp_path / "walk.zip"
    with pytest.raises(FileError, match="no such file"):
        require_trusted_file(path, False)
    path.touch()
    require_trusted_file(path, True)
    with pytest.raises(UsageError, match=r"walk.zip can run any code as it is opened\ntrust opens it") as error:
        require_trusted_file(path, False)
    assert error.value.path == ("policy",)
