"""Who draws the frames of a film, and what is told of it."""

import re
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from mjrun.errors import spelled
from mjrun.job import frame_drawing, shared_rendering
from mjrun.job.simulation import Simulation
from mjrun.job.video import Video, VideoResult
from mjrun.rendering.backend import Backend
from mjrun.rendering.visual import Visual
from mjrun.rendering.workers import Workers
from mjrun.reporter import QuietReporter

SIZE = (64, 48)
FRAMES = 6


class Listener(QuietReporter):
    """Keeps the warnings."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def warn(self, text: str) -> None:
        self.heard.append(spelled(text))


@pytest.fixture
def film(swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """Makes a film on a machine with two cores where a frame is guessed to cost so much, and found to cost so much."""
    monkeypatch.setattr(frame_drawing, "available_cores", lambda: 2)
    monkeypatch.setattr(frame_drawing, "LONG", 0.0)

    def made(guessed: float, found: float, duration: float = 0.2, **options: object) -> tuple[VideoResult, str, list]:
        monkeypatch.setattr(frame_drawing, "estimated_cost", lambda size, panels: guessed)
        # A frame takes no time to speak of here, so the measured cost stands in a known proportion to it.
        monkeypatch.setattr(frame_drawing, "jobs_for", lambda a, s, n, cost, c: jobs(a, s, n, *known(cost), c))

        def known(cost: float) -> tuple[float]:
            return (guessed if cost == guessed else found,)

        started: list[int] = []

        class Counted(Workers):
            def __init__(self, count: int, module: str) -> None:
                started.append(count)
                super().__init__(count, module)

        monkeypatch.setattr(shared_rendering, "Workers", Counted)
        listener = Listener()
        simulation = Simulation(swing, duration=duration)
        job = Video(simulation, f"{tmp_path}/f/", size=SIZE, camera="side", **options)  # type: ignore[arg-type]
        result = job.run(listener)
        (told,) = [text for text in listener.heard if "drawing in software" in text] or [""]
        return result, told, started

    jobs = frame_drawing.jobs_for
    return made


def pictures(folder: Path) -> np.ndarray:
    return np.stack([iio.imread(file) for file in sorted(folder.iterdir())])


COST = r"\): \d+ ms per frame, "


@pytest.mark.parametrize(
    ("guessed", "found", "started", "told"),
    [
        (0.001, 0.001, [], COST + r"about \d+ s in all"),
        (60.0, 0.001, [2], COST + r"about \d+ s in all by 2 processes"),
        (0.001, 60.0, [2], COST + r"less than \d+ s in all by 2 processes"),
    ],
)
def test_what_is_guessed_starts_processes_early_and_what_is_found_late(
    film: Callable, backend: Backend, tmp_path: Path, guessed: float, found: float, started: list[int], told: str
) -> None:
    result, text, crews = film(guessed, found, jobs=1)
    alone = pictures(tmp_path / "f")
    assert (result.jobs, crews) == (1, [])
    result, text, crews = film(guessed, found)
    assert len(alone) == result.frames == FRAMES
    assert np.array_equal(pictures(tmp_path / "f"), alone)
    if backend.software:
        assert (result.jobs, crews) == (2 if started else 1, started)
        assert re.search(told + "(; quality draft takes about|$)", text)


@pytest.mark.parametrize("duration", [0.01, 0.05])
def test_films_of_one_and_two_frames_are_drawn(film: Callable, backend: Backend, duration: float) -> None:
    result, told, crews = film(0.001, 60.0, duration)
    assert (result.frames, result.jobs, crews) == (1 if duration < 0.02 else 2, 1, [])
    assert ("drawing in software" in told) == (backend.software and result.frames == 2)


def test_drawing_that_takes_no_time_is_not_spoken_of(film: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_drawing, "LONG", 60.0)
    assert film(0.001, 0.001)[1] == ""


def test_a_draft_does_not_speak_of_drafts(film: Callable) -> None:
    _, told, _ = film(0.001, 0.001, visual=Visual(quality="draft"))
    assert "quality" not in told


def test_colours_of_depth_are_chosen_before_anybody_draws(film: Callable, tmp_path: Path) -> None:
    film(0.001, 0.001, view="depth")
    alone = pictures(tmp_path / "f")
    _, _, crews = film(60.0, 60.0, view="depth", jobs=3)
    assert crews == [3]
    assert np.array_equal(pictures(tmp_path / "f"), alone)
