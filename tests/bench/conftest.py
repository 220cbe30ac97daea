"""Fixtures that tests of benchmarks share."""

from pathlib import Path

import pytest

from tests.bench.bench_clocks import MODEL


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The file of a small model."""
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path
