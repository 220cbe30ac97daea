"""A whole trace and a whole video."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))

from bench_clocks import MODEL, FakeClock, bench


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


@pytest.mark.gl
def test_a_whole_film_and_trace_are_a_second_of_simulation(path: Path) -> None:
    trace, film = bench(path, whole=True, size=(64, 48)).run(clock=FakeClock()).whole
    assert (trace.what, trace.count, trace.unit, trace.simulated, trace.seconds) == ("trace", 101, "rows", 1.0, 1.0)
    assert (film.what, film.count, film.unit, film.simulated, film.seconds) == ("video", 30, "frames", 1.0, 1.0)
    assert film.simulation is not None
