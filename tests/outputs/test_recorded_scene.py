"""Theorems about the scenes of outputs at the instants of their frames."""

import math
from contextlib import ExitStack
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.camera.pose import contains
from mjrun.errors import MjrunError
from mjrun.options.rendering import SceneOptions
from mjrun.outputs.export import Export
from mjrun.outputs.output import PassContext
from mjrun.outputs.recorded_scene import (
    RecordedScene,
    camera_motions,
    check_scene,
    open_states,
    place_scene,
    plan_scene,
    state_taps,
)
from mjrun.physics.simulation_loop import run_with_taps
from mjrun.reporter import PythonApiReporter


def recorded(model: Path, stack: ExitStack, until: int, **options: object) -> RecordedScene:
    """Returns the frames of an export, recorded up to a step."""
    simulation = mjrun.Simulation(model, duration=0.5)
    job = Export(simulation, "a.glb", fps=10, **options)  # type: ignore[arg-type]
    loaded = simulation.load()
    context = PassContext(simulation, loaded, simulation.timeline(loaded), PythonApiReporter())
    plan = plan_scene(job, context, job.cameras)
    schedule, states = job.schedule_frames(plan, {}), open_states(plan, stack)
    run_with_taps(simulation.stepper(loaded), state_taps(plan, schedule, states), until)
    return place_scene(plan, schedule, states)


def test_states_times_and_cameras_belong_to_the_frames(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    with ExitStack() as stack:
        frames = recorded(swing, stack, 250, camera="look:from=0/-2/1,at=ball")
        assert [*frames.times] == [0, 0.1, 0.2, 0.3, 0.4]
        for index in range(5):
            mujoco.mj_forward(model, data)
            assert np.array_equal(frames.states[index][1 : 1 + model.nq], data.qpos)
            (pose,) = frames.poses[index]
            toward = data.body("ball").xpos - pose.position
            assert np.allclose(pose.forward, toward / np.linalg.norm(toward), atol=1e-6)
            mujoco.mj_step(model, data, nstep=50)


def test_frames_that_were_not_recorded_are_dropped(swing: Path) -> None:
    with ExitStack() as stack:
        frames = recorded(swing, stack, 120)
        assert [*frames.schedule.steps] == [0, 50, 100]
        assert len(frames.poses) == len(frames.times) == len(frames.schedule.speeds) == 3


def test_the_floor_is_below_ghosts_and_the_default_camera_sees_them(tmp_path: Path) -> None:
    rod = '<body><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5"/></body>'
    keys = '<keyframe><key qpos="1.5"/></keyframe>'
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{rod}</worldbody>{keys}</mujoco>")
    with ExitStack() as stack:
        scene = recorded(tmp_path / "m.xml", stack, 250, camera="auto", ghost=["key=0,offset=1/0/0", "offset=0/0/-1"])
        assert scene.model.body("stage floor").pos[2] == pytest.approx(-1.52)
        (pose,) = scene.poses[0]
        for point in ((1, 0, 0), (1 - 0.5 * math.sin(1.5), 0, -0.5 * math.cos(1.5)), (0, 0, -1.5)):
            assert contains(pose, np.array([point]), (1280, 720))


def test_a_floor_is_suggested_at_the_height_where_a_falling_model_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes = list[str]()
    monkeypatch.setattr(PythonApiReporter, "note", lambda _, text: notes.append(text))
    ball = '<body pos="0 0 .75"><freejoint/><geom size=".25"/></body>'
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    with ExitStack() as stack:
        recorded(tmp_path / "m.xml", stack, 250)
    assert [text for text in notes if " 0.5 adds a floor" in text]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"camera": ["a", "a"]}, "only once"),
        ({"stage": ["auto", "sky"]}, "stage"),
        ({"show": "nonsense"}, "visual flag"),
    ],
)
def test_impossible_scenes_are_refused_without_a_model(values: dict[str, object], message: str) -> None:
    with pytest.raises(MjrunError, match=message):
        check_scene(SceneOptions(**values))  # type: ignore[arg-type]


def test_an_unknown_camera_is_named(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    assert len(camera_motions(["side", "free"], (64, 48), model)) == 2
    with pytest.raises(MjrunError, match="did you mean 'side'"):
        camera_motions(["sied"], (64, 48), model)
