"""Plans of drawings, and what is kept of each frame, against a bare loop."""

import json
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import UnknownNameError, UsageError
from mjrun.options.view import ViewOptions
from mjrun.outputs.drawing import FrameRecorder, check_drawing, metadata_tags, plan_drawing
from mjrun.outputs.frame_schedule import video_schedule
from mjrun.outputs.task import Context
from mjrun.outputs.video import Video
from mjrun.physics.observe import observe
from mjrun.physics.stepper import PhysicsStepper
from mjrun.rendering.backend import Backend
from mjrun.rendering.graph import graph_size
from mjrun.reporter import WarningReporter
from mjrun.simulation.simulation import Simulation

SIZE = (64, 48)

pytestmark = pytest.mark.filterwarnings("ignore:drawing in software")


def test_tags_say_what_made_the_film(swing: Path, tmp_path: Path) -> None:
    Video(Simulation(swing, duration="0.1"), str(tmp_path / "f.mp4"), size=SIZE, fps=20, quality="draft").run()
    assert (
        f"mjrun {mjrun.__version__}, MuJoCo {mujoco.mj_versionString()}, ".encode() in (tmp_path / "f.mp4").read_bytes()
    )


def context_of(swing: Path, steps: int = 50) -> Context:
    """A context of the swinging box."""
    simulation = Simulation(swing, steps=steps)
    model = simulation.load()
    return Context(simulation, model, simulation.timeline(model), WarningReporter())


def test_what_frames_are_drawn_from_is_taken_at_their_steps(swing: Path) -> None:
    context = context_of(swing)
    options = ViewOptions(camera=["side", "track:box"], text="{qpos/ball/z:.17g} {frame}", trail="ball", size=SIZE)
    plan = plan_drawing(options, context, ["qpos[ball]"])
    schedule = video_schedule(plan.scripts, context.timeline, Fraction(50), Fraction(1), {})
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    with ExitStack() as stack:
        recorder = FrameRecorder(plan, schedule, context.timeline, stack)
        observe(PhysicsStepper(model, data), recorder.taps, 50)
        assert list(recorder.times) == [k / 50 for k in range(5)]
        assert len(recorder.states) == len(recorder.poses) == 5
        heights = []
        for k, (still, tracking) in enumerate(recorder.poses):
            size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
            expected = np.empty(size)
            mujoco.mj_getState(model, data, expected, mujoco.mjtState.mjSTATE_INTEGRATION)
            assert np.array_equal(recorder.states[k], expected)
            shown = mujoco.MjData(model)
            mujoco.mj_copyData(shown, model, data)
            mujoco.mj_forward(model, shown)
            assert np.allclose(still.position, shown.camera("side").xpos, atol=1e-6)
            away = shown.body("box").xpos - tracking.position
            assert np.allclose(np.abs(tracking.rotation.T @ away), np.array([0, 0, np.linalg.norm(away)]), atol=1e-6)
            heights.append(data.qpos[3])
            mujoco.mj_step(model, data, nstep=10)
        overlay = plan.probes.overlay(plan.overlay, recorder._values, schedule.steps, schedule.speeds, context.timeline)
    assert overlay.texts == [f"{height:.17g} {k}" for k, height in enumerate(heights)]
    assert overlay.plots == [graph_size((SIZE[0] * 2 + 2, SIZE[1]))]


@pytest.mark.parametrize(
    ("values", "corner"), [({}, "top-left"), ({"captions": True}, "bottom-right"), ({"text_corner": "top"}, "top")]
)
def test_text_makes_room_for_captions(swing: Path, values: dict[str, object], corner: str) -> None:
    options = ViewOptions(camera="side", text="hi", **values)  # type: ignore[arg-type]
    assert plan_drawing(options, context_of(swing)).overlay.corner == corner


@pytest.mark.parametrize(("text", "enabled"), [("{time}", False), ("{energy/kinetic}", True)])
def test_a_drawing_switches_on_what_it_measures(swing: Path, text: str, enabled: bool) -> None:
    plan = plan_drawing(ViewOptions(camera="side", text=text), context_of(swing))
    assert bool(plan.enable_flags & mujoco.mjtEnableBit.mjENBL_ENERGY) == enabled


def test_a_camera_that_is_not_there_is_named_by_its_place(swing: Path) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'side'") as caught:
        plan_drawing(ViewOptions(camera=["free", "sied"]), context_of(swing))
    assert caught.value.path == ("camera", 1)


def test_a_picture_that_the_backend_cannot_hold_is_refused(swing: Path, backend: Backend) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    assert check_drawing(ViewOptions(size=SIZE), model, backend) == []
    with pytest.raises(UsageError, match="too large"):
        check_drawing(ViewOptions(size=(backend.max_size + 1, 48)), model, backend)


def test_tags_hold_all_facts() -> None:
    facts = {"mjrun": "1.0", "mujoco": "3.0", "renderer": "llvmpipe", "steps": 3}
    assert metadata_tags("a/film.mp4", facts) == {
        "title": "film",
        "comment": "mjrun 1.0, MuJoCo 3.0, llvmpipe",
        "description": json.dumps(facts),
    }
    assert "title" not in metadata_tags(None, facts)
