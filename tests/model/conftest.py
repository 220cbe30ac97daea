"""What the tests of this folder share."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory for MuJoCo's log, which warns of a NaN in a file."""
    monkeypatch.chdir(tmp_path)
