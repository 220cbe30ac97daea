"""Which processes draw the frames of a video, and what the user is warned of."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import wraps
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from mjrun.errors import BadValueError, NoRendererError, spelled
from mjrun.outputs import frame_drawing
from mjrun.outputs.frame_drawing import estimated_cost, jobs_for, open_frame_recorder, plan_frames
from mjrun.outputs.output import PassContext, RenderingResources
from mjrun.outputs.video import Video, VideoResult
from mjrun.rendering import compositor_pool
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.compositor import FrameCosts, SceneCompositor
from mjrun.rendering.compositor_pool import CompositorPool, CompositorProcesses
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from tests.cases import cases

SIZE = (64, 48)
FRAMES = 6


class Notes(PythonApiReporter):
    """Keeps the notes."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def note(self, text: str) -> None:
        self.texts.append(spelled(text))


@pytest.fixture
def make_video(swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """Makes a video with two cores on which a frame is estimated to cost so much, and then measured to cost so much."""
    monkeypatch.setattr(frame_drawing, "available_cores", lambda: 2)
    monkeypatch.setattr(frame_drawing, "LONG", 0.0)

    def made(
        estimated: float, measured: float, draft: float = 0.0, duration: float = 0.2, **options: object
    ) -> tuple[VideoResult, str, list[int]]:
        started: list[int] = []

        def assumed(costs: FrameCosts) -> FrameCosts:
            """Returns the costs on a machine where frames cost what this test says, however busy this one is."""
            return FrameCosts(measured, None if costs.draft is None else draft)

        class MeasuredPool(CompositorPool):
            @property
            def answer(self) -> object:  # type: ignore[override]
                return assumed(self._answer) if isinstance(self._answer, FrameCosts) else self._answer

            @answer.setter
            def answer(self, answer: object) -> None:
                self._answer = answer

            _answer: object = None

        class CountedWorkers(CompositorProcesses):
            def __init__(self, count: int, module: str) -> None:
                started.append(count)
                super().__init__(count, module)

        monkeypatch.setattr(frame_drawing, "estimated_cost", lambda size, panels: estimated)
        measure = SceneCompositor.costs
        monkeypatch.setattr(frame_drawing, "CompositorPool", MeasuredPool)
        monkeypatch.setattr(SceneCompositor, "costs", wraps(measure)(lambda self: assumed(measure(self))))
        monkeypatch.setattr(compositor_pool, "CompositorProcesses", CountedWorkers)
        notes = Notes()
        simulation = Simulation(swing, duration=duration)
        job = Video(simulation, f"{tmp_path}/f/", size=SIZE, camera="side", **options)  # type: ignore[arg-type]
        result = job.run(notes)
        (note,) = [text for text in notes.texts if "software rendering" in text] or [""]
        return result, note, started

    return made


def pictures(folder: Path) -> np.ndarray:
    return np.stack([iio.imread(file) for file in sorted(folder.iterdir())])


@cases("estimated, measured, draft, started, costs")
@pytest.mark.slow
def test_an_estimate_starts_processes_early_and_a_measurement_late(
    make_video: Callable,
    backend: WorkingBackend,
    tmp_path: Path,
    estimated: float,
    measured: float,
    draft: float,
    started: list[int],
    costs: str,
) -> None:
    result, _, groups = make_video(estimated, measured, jobs=1)
    alone = pictures(tmp_path / "f")
    assert (result.jobs, groups) == (1, [])
    result, note, groups = make_video(estimated, measured, draft)
    assert len(alone) == result.frames == FRAMES
    assert np.array_equal(pictures(tmp_path / "f"), alone)
    if backend.software:
        assert (result.jobs, groups) == (2 if started else 1, started)
        assert note.endswith(f"): {costs}")


def test_a_ghost_that_was_drawn_here_goes_on_in_other_processes(
    make_video: Callable, swing: Path, backend: WorkingBackend, tmp_path: Path
) -> None:
    keyframe = '<keyframe><key name="up" qpos="1 .6 0 .5 1 0 0 0"/></keyframe></mujoco>'
    swing.write_text(swing.read_text().replace("</mujoco>", keyframe))
    ghost = ["key=up"]
    make_video(0.001, 0.001, jobs=1, ghost=ghost)
    alone = pictures(tmp_path / "f")
    result, _, _ = make_video(0.001, 60.0, ghost=ghost)
    assert result.jobs == (2 if backend.software else 1)
    assert np.array_equal(pictures(tmp_path / "f"), alone)


@pytest.mark.parametrize("duration", [0.01, 0.05])
def test_videos_of_one_and_two_frames_are_drawn(make_video: Callable, backend: WorkingBackend, duration: float) -> None:
    result, note, groups = make_video(0.001, 60.0, duration=duration)
    assert (result.frames, result.jobs, groups) == (1 if duration < 0.02 else 2, 1, [])
    assert ("software rendering" in note) == (backend.software and result.frames == 2)


def test_drawing_that_takes_no_time_is_not_spoken_of(make_video: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_drawing, "LONG", 60.0)
    assert make_video(0.001, 0.001)[1] == ""


def test_a_draft_is_recommended_where_there_is_none(make_video: Callable, backend: WorkingBackend) -> None:
    assert ("quality draft" in make_video(0.001, 0.001)[1]) == backend.software
    assert "quality" not in make_video(0.001, 0.001, quality="draft")[1]


def test_colours_of_depth_are_chosen_before_anybody_draws(make_video: Callable, tmp_path: Path) -> None:
    make_video(0.001, 0.001, view="depth")
    alone = pictures(tmp_path / "f")
    _, _, groups = make_video(60.0, 60.0, view="depth", jobs=2)
    assert groups == [2]
    assert np.array_equal(pictures(tmp_path / "f"), alone)


@pytest.mark.parametrize(
    ("asked", "software", "frames", "cost", "cores", "expected"),
    [
        ("auto", False, 10_000, 1.0, 8, 1),  # a GPU
        ("auto", True, 300, 0.005, 8, 1),  # short
        ("auto", True, 300, 0.1, 8, 8),
        ("auto", True, 300, 0.1, 2, 2),
        ("auto", True, 19, 0.1, 2, 1),
        ("auto", True, 5, 60.0, 8, 5),
        ("auto", True, 300, 1.0, 1, 1),
        (3, False, 300, 0.001, 1, 3),
        (3, True, 2, 0.1, 8, 2),
        (2, True, 0, 0.1, 8, 1),
    ],
)
def test_processes_are_as_many_as_are_worth_it(
    asked: int | str, software: bool, frames: int, cost: float, cores: int, expected: int
) -> None:
    assert jobs_for(asked, software, frames, cost, cores) == expected


def test_a_guess_grows_with_pixels_and_panels() -> None:
    assert estimated_cost((640, 480)) == pytest.approx(0.06072)
    assert estimated_cost((640, 480), 3) == pytest.approx(3 * 0.06072)


@pytest.mark.parametrize("asked", [0, -1, "many", "2"])
def test_a_number_of_processes_that_is_none_is_refused(asked: int | str) -> None:
    with pytest.raises(BadValueError, match=r"jobs: .* is not a number of processes, at least 1, or auto"):
        jobs_for(asked, True, 100, 0.1, 2)


@cases("asked, frames, lacks_gpu, started")
def test_processes_start_before_the_backend_is_known_where_no_gpu_can_draw(
    swing: Path, monkeypatch: pytest.MonkeyPatch, asked: int | str, frames: int, lacks_gpu: bool, started: list[int]
) -> None:
    def backend(backends: RenderingResources, choice: object) -> WorkingBackend:
        assert counts == started
        raise NoRendererError({}, "")

    monkeypatch.setattr(frame_drawing, "available_cores", lambda: 2)
    monkeypatch.setattr(frame_drawing, "lacks_gpu", lambda: lacks_gpu)
    counts: list[int] = []
    monkeypatch.setattr(RenderingResources, "workers", lambda self, count: counts.append(count))
    monkeypatch.setattr(RenderingResources, "backend", backend)
    simulation = Simulation(swing, duration=frames / 30)
    video = Video(simulation, "v.mkv", size=(640, 480), fps=30, camera="side", jobs=asked)
    model = simulation.load()
    context = PassContext(simulation, model, simulation.timeline(model), PythonApiReporter())
    plan = plan_frames(video, context)
    with ExitStack() as stack, pytest.raises(NoRendererError):
        open_frame_recorder(
            plan, video.schedule_frames(plan.scene, {}), video.encoded_files, stack, RenderingResources(), asked
        )
