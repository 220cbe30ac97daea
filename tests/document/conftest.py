"""Tests of documents read and write files in an empty folder."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that relative paths mean."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
