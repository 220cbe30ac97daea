"""What the outputs of one pass share to draw with."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.camera.rigs.around import FreeRig, TrackRig
from mjrun.camera.script import CameraScript, Event, Shot
from mjrun.options.view import ViewOptions
from mjrun.outputs.image import Image
from mjrun.outputs.perform import perform
from mjrun.outputs.shared_rendering import RendererRequest, SharedRendering
from mjrun.outputs.video import Video
from mjrun.rendering import backend_detection, workers
from mjrun.rendering.backend import Backend
from mjrun.rendering.backend_detection import BackendDetection
from mjrun.simulation.simulation import Simulation
from mjrun.worker import Worker

pytestmark = pytest.mark.filterwarnings("ignore:drawing in software")

SIZE = (64, 48)


def frames(folder: Path) -> list[np.ndarray]:
    return [np.array(Pillow.open(path)) for path in sorted(folder.iterdir())]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How many detections of backends and how many worker processes were started."""
    count = {"detections": 0, "workers": 0}

    class CountedDetection(BackendDetection):
        def __init__(self, requested: str | None = None) -> None:
            count["detections"] += 1
            super().__init__(requested)

    class CountedWorker(Worker):
        def __init__(self, *arguments: Any, **how: Any) -> None:
            count["workers"] += 1
            super().__init__(*arguments, **how)

    monkeypatch.setattr(backend_detection, "BackendDetection", CountedDetection)
    monkeypatch.setattr(workers, "Worker", CountedWorker)
    return count


def test_images_of_one_pass_share_one_detection(swing: Path, tmp_path: Path, started: dict[str, int]) -> None:
    simulation = Simulation(swing, duration=0.1)
    perform([Image(simulation, f"{tmp_path}/{step}.png", step=step, size=SIZE) for step in (0, 10, 20)])
    assert started == {"detections": 1, "workers": 0}


@pytest.mark.parametrize("jobs", [1, 3])
def test_videos_of_one_pass_share_one_group_of_workers(
    swing: Path, tmp_path: Path, started: dict[str, int], jobs: int
) -> None:
    simulation = Simulation(swing, duration=0.2)
    event = CameraScript("hit", [Shot(FreeRig(), until=Event("time > 0.1")), Shot(TrackRig("ball"))])

    def videos(folder: Path, count: int) -> list[Video]:
        folder.mkdir()
        return [
            Video(simulation, f"{folder}/a/", size=SIZE, camera="side", jobs=count),
            Video(simulation, f"{folder}/b/", size=(32, 24), view="depth", trail=["ball"], jobs=min(count, 2)),
            Video(simulation, f"{folder}/c/", size=SIZE, camera=event, text="{frame}", jobs=count),
        ]

    results = perform(videos(tmp_path / "together", jobs))
    assert started == {"detections": 1, "workers": jobs if jobs > 1 else 0}
    assert [result.jobs for result in results] == [jobs, min(jobs, 2), jobs]
    for video in videos(tmp_path / "alone", 1):
        video.run()
    for name in "abc":
        pairs = zip(frames(tmp_path / "together" / name), frames(tmp_path / "alone" / name), strict=True)
        assert all(np.array_equal(one, other) for one, other in pairs)


def test_a_backend_is_detected_once_for_each_choice(started: dict[str, int], backend: Backend) -> None:
    with SharedRendering() as rendering:
        choice = RendererRequest.of(ViewOptions(gl=backend.name))
        rendering.detect(choice)
        rendering.detect(RendererRequest.of(ViewOptions(gl=backend.name, camera="side")))
        assert started["detections"] == 1
        assert rendering.backend(choice) is rendering.backend(choice)
        assert rendering.backend(choice).renderer == backend.renderer
        assert rendering.backend(RendererRequest.of(ViewOptions())).max_size > 0
    assert started["detections"] == 2


def test_workers_are_added_and_never_started_again(started: dict[str, int]) -> None:
    with SharedRendering() as rendering:
        first = rendering.workers(1)
        assert rendering.workers(2) is first
        assert rendering.workers(1) is first
        assert started["workers"] == 2


def test_the_physically_based_renderer_does_not_ask_for_a_backend_of_opengl() -> None:
    options = ViewOptions(renderer="filament", gl="egl", require_gpu=True)
    assert RendererRequest.of(options) == RendererRequest("filament", None, True)
