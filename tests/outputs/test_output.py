"""The two phases of an output: a plan, and an output with its files open, which publishes nothing itself."""

import json
from contextlib import ExitStack
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import mujoco
import pytest

from mjrun.formats.atomic_output import publish_together
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.output import Context, Job, Output, PassSummary, metadata_tags
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.shared_rendering import SharedRendering
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


def context_of(simulation: Simulation) -> Context:
    model = simulation.load()
    return Context(simulation, model, simulation.timeline(model), WarningReporter())


@pytest.mark.parametrize("kind", JOBS)
def test_nothing_is_published_by_either_phase(swing: Path, tmp_path: Path, kind: str) -> None:
    simulation = Simulation(swing, steps=20)
    job: Job[Any] = JOBS[kind](simulation, tmp_path)
    job.check()
    context = context_of(simulation)
    with ExitStack() as stack:
        plan = job.plan(context)
        assert (plan.preview.kind, plan.preview.path) == (kind, job.output)
        assert [*tmp_path.iterdir()] == [swing]

        output = plan.open(stack, stack.enter_context(SharedRendering()))
        output.simulate(simulation.stepper(context.model), plan.until)
        writers = output.finish()
        assert visible(tmp_path) == ["swing.xml"]

        files = publish_together(writers)
    assert sorted(path.name for path in files) == sorted(Path(path).name for _, path in job.files)
    assert visible(tmp_path) == sorted([*(path.name for path in files), "swing.xml"])
    assert output.result(files, PassSummary(2.0, 1.0, ["careful"])).path == job.output


@pytest.mark.parametrize("kind", JOBS)
@pytest.mark.parametrize("until", ["open", "simulate", "finish"])
def test_an_output_that_is_given_up_leaves_nothing(swing: Path, tmp_path: Path, kind: str, until: str) -> None:
    simulation = Simulation(swing, steps=5)
    context = context_of(simulation)
    with ExitStack() as stack:
        plan = JOBS[kind](simulation, tmp_path).plan(context)
        output = plan.open(stack, stack.enter_context(SharedRendering()))
        if until != "open":
            output.simulate(simulation.stepper(context.model), plan.until)
        if until == "finish":
            output.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


@pytest.mark.parametrize("kind", JOBS)
def test_a_plan_is_frozen_and_is_only_opened(swing: Path, tmp_path: Path, kind: str) -> None:
    plan = JOBS[kind](simulation := Simulation(swing, steps=5), tmp_path).plan(context_of(simulation))
    with pytest.raises(FrozenInstanceError):
        plan.until = 3
    assert {name for name in ("check", "plan", "open", "taps", "finish", "result") if hasattr(plan, name)} == {"open"}
    assert {name for name in ("check", "plan", "open") if hasattr(Output, name)} == set()


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
