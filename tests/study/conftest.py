"""Fixtures that tests of studies share."""

from pathlib import Path

import pytest

from mjrun.simulation.simulation import Simulation
from tests.study.in_process import simulate_here
from tests.study.models import BALL, DEADLY


@pytest.fixture
def ball(tmp_path: Path) -> Simulation:
    """20 steps of a ball. The folder of its model also contains `deadly.xml`."""
    (tmp_path / "ball.xml").write_text(BALL)
    (tmp_path / "deadly.xml").write_text(DEADLY)
    return Simulation(str(tmp_path / "ball.xml"), steps=20)


@pytest.fixture
def point_processes() -> None:
    """Points are simulated in separate processes, as they are for users."""


@pytest.fixture(autouse=True)
def _here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "point_processes" not in request.fixturenames:
        simulate_here(monkeypatch)
