"""The phases of an output: each is reached through the one before, and nothing is published before its end."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, get_type_hints

import mujoco
import pytest

from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.shared_rendering import SharedRendering
from mjrun.outputs.task import Artifact, Context, EventDrivenOutput, Job, Output, OutputResult, PassSummary, Plan
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.reporter import WarningReporter
from mjrun.simulation.simulation import Simulation

pytestmark = pytest.mark.filterwarnings("ignore:drawing in software")

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


@pytest.mark.parametrize("kind", JOBS)
def test_an_output_goes_through_its_phases_and_is_published_by_the_last(swing: Path, tmp_path: Path, kind: str) -> None:
    simulation = Simulation(swing, steps=20)
    job: Job[Any] = JOBS[kind](simulation, tmp_path)
    model = simulation.load()
    context = Context(simulation, model, simulation.timeline(model), WarningReporter())
    with ExitStack() as stack:
        rendering = stack.enter_context(SharedRendering())
        plan = job.task().plan(context)
        assert (plan.preview().kind, plan.preview().path) == (kind, job.output)
        assert visible(tmp_path) == ["swing.xml"]

        opened = plan.open(stack, rendering)
        output = opened if isinstance(opened, Output) else opened.schedule({})
        output.simulate(simulation.stepper(model), plan.until)
        artifact = output.finish()
        assert visible(tmp_path) == ["swing.xml"]

        files = artifact.publish()
    assert sorted(path.name for path in files) == sorted(Path(path).name for _, path in job.files)
    assert visible(tmp_path) == sorted([*(path.name for path in files), "swing.xml"])
    assert artifact.result(files, PassSummary(2.0, 1.0, ["careful"])).path == job.output


@pytest.mark.parametrize("kind", JOBS)
@pytest.mark.parametrize("until", ["open", "simulate", "finish"])
def test_an_output_that_is_given_up_leaves_nothing(swing: Path, tmp_path: Path, kind: str, until: str) -> None:
    simulation = Simulation(swing, steps=5)
    model = simulation.load()
    context = Context(simulation, model, simulation.timeline(model), WarningReporter())
    with ExitStack() as stack:
        rendering = stack.enter_context(SharedRendering())
        plan = JOBS[kind](simulation, tmp_path).task().plan(context)
        opened = plan.open(stack, rendering)
        if until != "open":
            output = opened if isinstance(opened, Output) else opened.schedule({})
            output.simulate(simulation.stepper(model), plan.until)
            if until == "finish":
                output.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


@pytest.mark.parametrize(
    ("phase", "method", "following"),
    [(Plan, "open", Output[Any] | EventDrivenOutput[Any]), (EventDrivenOutput, "schedule", Output[Any]),
     (Output, "finish", Artifact[Any])],
)  # fmt: skip
def test_a_phase_has_no_method_of_another_and_returns_the_next(phase: type, method: str, following: object) -> None:
    phases = {"plan", "open", "schedule", "finish", "publish"}
    assert {name for name in phases if hasattr(phase, name)} == {method}
    returned = str(get_type_hints(getattr(phase, method))["return"])
    assert returned.replace("+R_co", "typing.Any") == str(following)


def test_an_artifact_publishes_every_file_in_order(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in "cab"]
    result: Callable[..., OutputResult] = lambda files, summary: OutputResult(str(files[0]))  # noqa: E731
    with ExitStack() as stack:
        writers = [stack.enter_context(OutputWriter(StagedFile(path))) for path in paths]
        assert Artifact({}, writers, result).publish() == paths


def test_a_preview_counts_what_a_recording_will_hold(swing: Path, tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    simulation = Simulation(model, steps=3)
    context = Context(simulation, model, simulation.timeline(model), WarningReporter())
    plan = Recording(simulation, f"{tmp_path}/r.npz").task().plan(context)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
    assert (plan.preview().count, plan.preview().size, plan.until) == (4, [size], 3)
