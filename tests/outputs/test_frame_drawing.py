"""Plans of frames, and what is kept of each frame, against a bare loop."""

from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import MjrunError, UnknownNameError, UsageError
from mjrun.options.rendering import RENDERERS as NAMES
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.frame_drawing import (
    FramePlan,
    check_drawing,
    check_view,
    frame_compositor,
    open_frame_recorder,
    plan_frames,
)
from mjrun.outputs.output import PassContext, RenderingResources
from mjrun.outputs.video import Video
from mjrun.physics.simulation_loop import run_with_taps
from mjrun.physics.stepper import PhysicsStepper
from mjrun.rendering.backend import WorkingBackend
from mjrun.rendering.compositor import RENDERERS
from mjrun.rendering.live_plot import live_plot_size
from mjrun.rendering.visual import check_segmentation_name, groupings, visual_of
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.simulation import Simulation

SIZE = (64, 48)

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")


def test_tags_say_what_made_the_video(swing: Path, tmp_path: Path) -> None:
    Video(Simulation(swing, duration="0.1"), str(tmp_path / "f.mp4"), size=SIZE, fps=20, quality="draft").run()
    assert (
        f"mjrun {mjrun.__version__}, MuJoCo {mujoco.mj_versionString()}, ".encode() in (tmp_path / "f.mp4").read_bytes()
    )


def planned(swing: Path, **options: Any) -> FramePlan:
    job, context = job_and_context(swing, **options)
    return plan_frames(job, context)


def job_and_context(swing: Path, output: str = "v.mkv", steps: int = 50, **options: Any) -> tuple[Video, PassContext]:
    """A video of the swinging box that is never made, and the context of its pass."""
    simulation = Simulation(swing, steps=steps)
    model = simulation.load()
    job = Video(simulation, output, size=SIZE, fps=50, **options)
    return job, PassContext(simulation, model, simulation.timeline(model), PythonApiReporter())


def test_what_frames_are_drawn_from_is_taken_at_their_steps(swing: Path, tmp_path: Path) -> None:
    job, context = job_and_context(
        swing,
        f"{tmp_path}/v.mkv",
        camera=["side", "track:box"],
        text="{qpos/ball/z:.17g} {frame}",
        trail="ball",
        plot="qpos[ball]",
    )
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    with ExitStack() as stack:
        plan = plan_frames(job, context, job.plot, job.plot_side)
        schedule = job.schedule_frames(plan.scene, {})
        backends = stack.enter_context(closing(RenderingResources()))
        frames = open_frame_recorder(plan, schedule, job.encoded_files, stack, backends)
        run_with_taps(PhysicsStepper(model, data), frames.taps, 50)
        scene = frames.place()
        assert list(scene.times) == [k / 50 for k in range(5)]
        assert len(scene.states) == len(scene.poses) == 5
        heights = []
        for k, (still, tracking) in enumerate(scene.poses):
            size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
            expected = np.empty(size)
            mujoco.mj_getState(model, data, expected, mujoco.mjtState.mjSTATE_INTEGRATION)
            assert np.array_equal(scene.states[k], expected)
            shown = mujoco.MjData(model)
            mujoco.mj_copyData(shown, model, data)
            mujoco.mj_forward(model, shown)
            assert np.allclose(still.position, shown.camera("side").xpos, atol=1e-6)
            away = shown.body("box").xpos - tracking.position
            assert np.allclose(np.abs(tracking.rotation.T @ away), np.array([0, 0, np.linalg.norm(away)]), atol=1e-6)
            heights.append(data.qpos[3])
            mujoco.mj_step(model, data, nstep=10)
        (spec,) = frame_compositor(frames, scene).specs
    assert spec.composition.overlay.texts == [f"{height:.17g} {k}" for k, height in enumerate(heights)]
    assert spec.composition.overlay.plots == [live_plot_size((SIZE[0] * 2 + 2, SIZE[1]))]


@pytest.mark.parametrize(
    ("values", "corner"), [({}, "top-left"), ({"captions": True}, "bottom-right"), ({"text_corner": "top"}, "top")]
)
def test_text_makes_room_for_captions(swing: Path, values: dict[str, Any], corner: str) -> None:
    assert planned(swing, camera="side", text="hi", **values).overlay.corner == corner


@pytest.mark.parametrize(("text", "enabled"), [("{time}", False), ("{energy/kinetic}", True)])
def test_a_plan_enables_what_it_measures(swing: Path, text: str, enabled: bool) -> None:
    plan = planned(swing, camera="side", text=text)
    assert bool(plan.enable_flags & mujoco.mjtEnableBit.mjENBL_ENERGY) == enabled


def test_a_missing_camera_is_named_by_its_place(swing: Path) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'side'") as caught:
        planned(swing, camera=["free", "sied"])
    assert caught.value.path == ("camera", 1)


def test_a_picture_that_the_backend_cannot_hold_is_refused(swing: Path, backend: WorkingBackend) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    assert check_drawing(ViewOptions(size=SIZE), model, backend) == []
    with pytest.raises(UsageError, match="too large"):
        check_drawing(ViewOptions(size=(backend.max_size + 1, 48)), model, backend)


KINDS = ["geom", "site", "joint", "tendon", "actuator", "flex", "skin"]


@pytest.mark.parametrize("kind", KINDS)
def test_groups_are_those_of_their_own_kind(kind: str) -> None:
    options = visual_of(ViewOptions(**{f"{kind}group": (1, 4)})).options()  # type: ignore[arg-type]
    untouched = mujoco.MjvOption()
    for other in KINDS:
        groups, default = (getattr(value, f"{other}group").tolist() for value in (options, untouched))
        assert groups == ([0, 1, 0, 0, 1, 0] if other == kind else default)


def test_flags_frames_and_labels_reach_the_visualizer() -> None:
    options = visual_of(ViewOptions(show="joint", hide="texture", frame_axes="body", label="geom")).options()
    assert options.flags[mujoco.mjtVisFlag.mjVIS_JOINT] == 1
    assert options.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] == 0
    assert (options.frame, options.label) == (mujoco.mjtFrame.mjFRAME_BODY, mujoco.mjtLabel.mjLABEL_GEOM)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"show": "nonsense"}, "no visual flag 'nonsense'"),
        ({"show": "joint", "hide": "joint"}, "joint"),
        ({"seg_by": "colour", "view": "seg"}, "no segmentation 'colour'"),
        ({"depth_range": (-1, 2), "view": "depth"}, "depth_range: .*two depths in metres"),
        ({"camera": ["a", "b", "a"]}, "camera: give at least one, and each only once"),
        ({"view": ()}, "view: give at least one, and each only once"),
        ({"label": "nobody"}, "nobody"),
    ],
)
def test_a_view_that_cannot_be_is_refused_without_a_model(values: dict[str, object], message: str) -> None:
    with pytest.raises(MjrunError, match=message):
        check_view(ViewOptions(**values))  # type: ignore[arg-type]


def test_every_name_of_a_segmentation_and_of_a_renderer_is_known() -> None:
    assert tuple(RENDERERS) == NAMES
    for name in groupings():
        check_segmentation_name(name)
        check_view(ViewOptions(view="seg", seg_by=name))
    with pytest.raises(UnknownNameError, match="did you mean 'body'"):
        check_segmentation_name("bdy")
