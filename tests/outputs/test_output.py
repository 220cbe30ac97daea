"""The phases of an output: a plan, and an output with its files open, which publishes nothing itself."""

import json
from contextlib import ExitStack, closing
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.camera.rigs.free_camera import FreeRig, TrackRig
from mjrun.camera.script import CameraScript, ConditionEvent, Shot
from mjrun.formats.output_writer import PublishingTransaction, publishing
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.output import (
    OpenBlockOutput,
    OpenOutput,
    OutputRequest,
    PassContext,
    RenderingResources,
    metadata_tags,
)
from mjrun.outputs.perform import perform
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.physics.simulation_loop import run_with_taps
from mjrun.physics.stepper import Stepper
from mjrun.rendering import backend as backend_module
from mjrun.rendering import compositor_pool
from mjrun.rendering.backend import BackendDetector, WorkingBackend
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation
from mjrun.worker import Worker

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")
SIZE = (64, 48)

JOBS = {
    "video": lambda simulation, path: Video(simulation, f"{path}/v.mkv", size=(32, 24), fps=50),
    "image": lambda simulation, path: Image(simulation, f"{path}/i.png", size=(32, 24)),
    "trace": lambda simulation, path: Trace(simulation, f"{path}/t.csv", contacts=f"{path}/c.csv"),
    "plot": lambda simulation, path: Plot(simulation, f"{path}/p.png", probe=["energy"]),
    "recording": lambda simulation, path: Recording(simulation, f"{path}/r.npz"),
    "keyframe": lambda simulation, path: Keyframe(simulation, f"{path}/k.xml"),
}


def visible(folder: Path) -> list[str]:
    """The names of finished outputs in a folder."""
    return sorted(path.name for path in folder.iterdir() if not path.name.endswith(".part"))


def context_of(simulation: Simulation) -> PassContext:
    model = simulation.load()
    return PassContext(simulation, model, simulation.timeline(model), PythonApiReporter())


def simulate(output: OpenOutput[Any], stepper: Stepper, until: int) -> None:
    """Runs the simulation for an output as a pass of it alone does."""
    if isinstance(output, OpenBlockOutput):
        output.simulate(stepper, until)
    else:
        run_with_taps(stepper, output.taps, until)


@pytest.mark.parametrize("kind", JOBS)
def test_nothing_is_published_by_any_phase(swing: Path, tmp_path: Path, kind: str) -> None:
    simulation = Simulation(swing, steps=20)
    job: OutputRequest[Any] = JOBS[kind](simulation, tmp_path)
    job.check()
    context = context_of(simulation)
    with ExitStack() as stack:
        plan = job.plan(context)
        assert (plan.preview.kind, plan.preview.path) == (kind, job.output)
        assert [*tmp_path.iterdir()] == [swing]

        output = plan.open(stack, stack.enter_context(closing(RenderingResources())))
        simulate(output, simulation.stepper(context.model), plan.until)
        finished = output.finish(1.0)
        assert visible(tmp_path) == ["swing.xml"]

        with publishing(finished.writers), PublishingTransaction() as together:
            files = [file for writer in finished.writers for file in together.move(writer)]
    assert sorted(path.name for path in files) == sorted(Path(path).name for _, path in job.files)
    assert visible(tmp_path) == sorted([*(path.name for path in files), "swing.xml"])
    assert finished.result.path == job.output


@pytest.mark.parametrize("kind", JOBS)
@pytest.mark.parametrize("until", ["open", "simulate", "finish"])
def test_an_output_that_is_given_up_leaves_nothing(swing: Path, tmp_path: Path, kind: str, until: str) -> None:
    simulation = Simulation(swing, steps=5)
    context = context_of(simulation)
    with ExitStack() as stack:
        plan = JOBS[kind](simulation, tmp_path).plan(context)
        output = plan.open(stack, stack.enter_context(closing(RenderingResources())))
        if until != "open":
            simulate(output, simulation.stepper(context.model), plan.until)
        if until == "finish":
            output.finish(1.0)
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


@pytest.mark.parametrize("kind", JOBS)
def test_a_plan_is_frozen_and_is_only_opened(swing: Path, tmp_path: Path, kind: str) -> None:
    plan = JOBS[kind](simulation := Simulation(swing, steps=5), tmp_path).plan(context_of(simulation))
    with pytest.raises(FrozenInstanceError):
        plan.until = 3
    assert [name for name in ("check", "plan", "open", "taps", "finish") if hasattr(plan, name)] == ["open"]
    assert {name for name in ("check", "plan", "open") if hasattr(OpenOutput, name)} == set()


def test_a_preview_counts_what_a_recording_will_hold(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, steps=3)
    context = context_of(simulation)
    plan = Recording(simulation, f"{tmp_path}/r.npz").plan(context)
    size = mujoco.mj_stateSize(context.model, mujoco.mjtState.mjSTATE_INTEGRATION)
    assert (plan.preview.count, plan.preview.size, plan.until) == (4, [size], 3)


def test_tags_hold_all_facts() -> None:
    facts = {"mjrun": "1.0", "mujoco": "3.0", "renderer": "llvmpipe", "steps": 3}
    assert metadata_tags("a/video.mp4", facts) == {
        "title": "video",
        "comment": "mjrun 1.0, MuJoCo 3.0, llvmpipe",
        "description": json.dumps(facts),
    }
    assert "title" not in metadata_tags(None, facts)


def frames(folder: Path) -> list[np.ndarray]:
    return [np.array(Pillow.open(path)) for path in sorted(folder.iterdir())]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How many detections of backends and how many worker processes were started."""
    count = {"detections": 0, "workers": 0}

    class CountedDetection(BackendDetector):
        def __init__(self, requested: str | None = None) -> None:
            count["detections"] += 1
            super().__init__(requested)

    class CountedWorker(Worker):
        def __init__(self, *arguments: Any, **how: Any) -> None:
            count["workers"] += 1
            super().__init__(*arguments, **how)

    monkeypatch.setattr(backend_module, "BackendDetector", CountedDetection)
    monkeypatch.setattr(compositor_pool, "Worker", CountedWorker)
    return count


def test_images_of_one_pass_share_one_detection(swing: Path, tmp_path: Path, started: dict[str, int]) -> None:
    simulation = Simulation(swing, duration=0.1)
    perform([Image(simulation, f"{tmp_path}/{step}.png", step=step, size=SIZE) for step in (0, 10, 20)])
    assert started == {"detections": 1, "workers": 0}


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_videos_of_one_pass_share_one_group_of_workers(
    swing: Path, tmp_path: Path, started: dict[str, int], jobs: int
) -> None:
    simulation = Simulation(swing, duration=0.15)
    event = CameraScript("hit", [Shot(FreeRig(), until=ConditionEvent("time > 0.1")), Shot(TrackRig("ball"))])

    def videos(folder: Path, count: int) -> list[Video]:
        folder.mkdir()
        return [
            Video(simulation, f"{folder}/a/", size=SIZE, camera="side", jobs=count),
            Video(simulation, f"{folder}/b/", size=(32, 24), view="depth", jobs=1),
            Video(simulation, f"{folder}/c/", size=SIZE, camera=event, trail=["ball"], text="{frame}", jobs=count),
        ]

    results = perform(videos(tmp_path / "together", jobs))
    assert started == {"detections": 1, "workers": jobs if jobs > 1 else 0}
    assert [result.jobs for result in results] == [jobs, 1, jobs]
    for video in videos(tmp_path / "alone", 1):
        video.run()
    for name in "abc":
        pairs = zip(frames(tmp_path / "together" / name), frames(tmp_path / "alone" / name), strict=True)
        assert all(np.array_equal(one, other) for one, other in pairs)


def test_a_backend_is_detected_once_for_each_choice(started: dict[str, int], backend: WorkingBackend) -> None:
    with closing(RenderingResources()) as backends:
        choice = ViewOptions(gl=backend.name)
        backends.detect(choice)
        backends.detect(ViewOptions(gl=backend.name, camera="side"))
        assert started["detections"] == 1
        assert backends.backend(choice) is backends.backend(choice)
        assert backends.backend(choice).renderer == backend.renderer
        assert backends.backend(ViewOptions()).max_size > 0
    assert started["detections"] == 2


def test_workers_are_added_and_never_started_again(started: dict[str, int]) -> None:
    with closing(RenderingResources()) as backends:
        first = backends.workers(1)
        assert backends.workers(2) is first
        assert backends.workers(1) is first
        assert started["workers"] == 2


def test_the_physically_based_renderer_detects_vulkan_once_and_no_backend_of_opengl(
    monkeypatch: pytest.MonkeyPatch, started: dict[str, int]
) -> None:
    vulkan: list[object] = []

    class Detection:
        def __init__(self) -> None:
            vulkan.append(self)

        def cancel(self) -> None:
            pass

    monkeypatch.setattr(backend_module, "VulkanDetector", Detection)
    with closing(RenderingResources()) as backends:
        for gl in ("egl", "osmesa"):
            backends.detect(ViewOptions(renderer="filament", gl=gl))
    assert (len(vulkan), started["detections"]) == (1, 0)
