"""Fixtures that tests of studies share."""

from pathlib import Path

import pytest

from mjrun.simulation.simulation import Simulation
from tests.study.models import BALL, DEADLY


@pytest.fixture
def ball(tmp_path: Path) -> Simulation:
    """20 steps of a ball. The folder of its model also contains `deadly.xml`."""
    (tmp_path / "ball.xml").write_text(BALL)
    (tmp_path / "deadly.xml").write_text(DEADLY)
    return Simulation(str(tmp_path / "ball.xml"), steps=20)
