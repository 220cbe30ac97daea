"""A condition ends a simulation at the first step at which it holds, in every output."""

import csv
import io
from pathlib import Path

import mujoco
import pytest

from mjrun.errors import UsageError
from mjrun.outputs.event_detection import final_timeline
from mjrun.outputs.export import Export
from mjrun.outputs.image import Image
from mjrun.outputs.keyframe import Keyframe
from mjrun.outputs.perform import preview
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation

FALL = """<mujoco><option timestep="0.01"/><worldbody><body name="ball" pos="0 0 2"><joint name="drop" type="slide"
axis="0 0 1"/><geom name="ball" size=".1"/></body></worldbody></mujoco>"""


def falling(tmp_path: Path, until: str | None = None, **options: object) -> Simulation:
    path = tmp_path / "fall.xml"
    path.write_text(FALL)
    return Simulation(str(path), **{"duration": 1, "until": until, **options})  # type: ignore[arg-type]


def first_step_below(height: float) -> int:
    """Steps a bare loop."""
    model = mujoco.MjModel.from_xml_string(FALL)
    data = mujoco.MjData(model)
    step = 0
    while data.qpos[0] >= height:
        mujoco.mj_step(model, data)
        step += 1
    return step


def rows(simulation: Simulation, path: Path, every: int = 1) -> list[list[str]]:
    Trace(simulation, str(path), every=every).run()
    return list(csv.reader(io.StringIO(path.read_text())))[1:]


def test_a_trace_ends_at_the_first_step_at_which_the_condition_holds(tmp_path: Path) -> None:
    end = first_step_below(-0.5)
    whole = rows(falling(tmp_path), tmp_path / "whole.csv")
    until = falling(tmp_path, "qpos/drop < -0.5")
    assert rows(until, tmp_path / "part.csv") == whole[: end + 1]
    expected = [*whole[: end + 1 : 7], *([] if end % 7 == 0 else [whole[end]])]
    assert rows(until, tmp_path / "thin.csv", every=7) == expected


class Rising:
    """A controller that pushes harder with each call."""

    calls = 0

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.calls += 1
        data.qfrc_applied[:] = self.calls


def test_the_search_for_the_end_leaves_the_memory_of_a_controller_alone(tmp_path: Path) -> None:
    whole = rows(falling(tmp_path, controller=Rising()), tmp_path / "whole.csv")
    controller = Rising()
    part = rows(falling(tmp_path, "qpos/drop < -0.1", controller=controller), tmp_path / "part.csv")
    assert part == whole[: len(part)]
    assert controller.calls == len(part) < len(whole)


def test_a_condition_that_never_holds_leaves_the_duration(tmp_path: Path) -> None:
    simulation = falling(tmp_path, "qpos/drop > 0")
    assert final_timeline(simulation, simulation.load()) == simulation.timeline(simulation.load())


@pytest.mark.parametrize("text", ["time >= 0.3", "xpos(ball).z < 1.6", "contact_force/normal/x > 1 or time >= 0.3"])
def test_a_condition_reads_every_column_of_the_model(tmp_path: Path, text: str) -> None:
    simulation = falling(tmp_path, text)
    assert final_timeline(simulation, simulation.load()).steps == (29 if "xpos" in text else 30)


def test_a_video_lasts_until_the_condition_holds(tmp_path: Path) -> None:
    plan = preview([Video(falling(tmp_path, "time > 0.495"), str(tmp_path / "fall.mp4"), fps=10)])
    assert (plan.steps, plan.outputs[0].count) == (50, 5)


def test_a_simulation_that_fails_before_its_end_has_its_duration(tmp_path: Path) -> None:
    simulation = falling(tmp_path, "qpos/drop > 1e12", qvel={"drop": 9e9}, duration=2)
    assert final_timeline(simulation, simulation.load()).steps == 200


def test_an_unknown_column_of_the_condition_is_an_error_of_the_option(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no column 'qpos/drip'") as raised:
        Trace(falling(tmp_path, "qpos/drip < 0"), str(tmp_path / "t.csv")).run()
    assert raised.value.path == ("until",)


def test_a_condition_on_the_initial_state_leaves_one_frame(tmp_path: Path) -> None:
    simulation = falling(tmp_path, "time >= 0")
    plan = preview([Video(simulation, str(tmp_path / "still.mp4"), speed=0.1)])
    assert (plan.steps, plan.outputs[0].count) == (0, 1)
    scene = Export(simulation, str(tmp_path / "still.glb")).run()
    assert (scene.frames, scene.steps) == (1, 0)
    assert not scene.warnings


def test_a_simulation_that_would_fail_after_its_end_has_no_warnings(tmp_path: Path) -> None:
    simulation = falling(tmp_path, "time >= 1", qvel={"drop": 9e9}, duration=2)
    assert not Trace(simulation, str(tmp_path / "t.csv")).run().warnings


def test_images_and_keyframes_after_the_end_are_refused(tmp_path: Path) -> None:
    end = first_step_below(-0.5)
    for ended in (falling(tmp_path, "qpos/drop < -0.5"), falling(tmp_path, "qpos/drop < -0.5", duration=0.1)):
        for request in (
            Image(ended, f"{tmp_path}/a.png", step=end + 1, size=(16, 16)),
            Keyframe(ended, f"{tmp_path}/a.xml", step=end + 1),
        ):
            with pytest.raises(
                UsageError, match=r"^step: .* s is after the end of the simulation, at .* s, where until"
            ):
                request.run()
        assert Keyframe(ended, f"{tmp_path}/b.xml", step=end).run().step == end
    with pytest.raises(UsageError, match=r"^time: 3 s is after the end"):
        Image(ended, f"{tmp_path}/a.png", time=3, size=(16, 16)).run()
