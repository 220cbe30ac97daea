"""Trails and ghosts, where they are drawn and how they move."""

import json
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.errors import MjrunError, ModelError, UnknownNameError, UsageError
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.decorations.ghost import OPACITY, GhostPlan, PlannedGhosts
from mjrun.outputs.decorations.trail import PlannedTrails
from mjrun.outputs.image import Image
from mjrun.outputs.recorded_scene import planned_decorations
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")

SIZE = (160, 120)


def ghosts(options: ViewOptions, model: mujoco.MjModel, simulation: Simulation | None = None) -> PlannedGhosts:
    (found,) = planned_decorations(options, model, simulation)
    assert isinstance(found, PlannedGhosts)
    return found


def test_a_trail_is_drawn_where_its_object_has_been(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, qvel={"ball/vx": -4})
    options = {"camera": "side", "size": SIZE, "time": 0.2, "calibration": f"{tmp_path}/c.json"}
    plain, trailed = tmp_path / "a.png", tmp_path / "b.png"
    Image(simulation, str(plain), **options).run()  # type: ignore[arg-type]
    Image(simulation, str(trailed), trail=["ball"], **options).run()  # type: ignore[arg-type]
    changed = (np.array(Pillow.open(plain)) != np.array(Pillow.open(trailed))).any(axis=2)
    rows, columns = np.nonzero(changed)
    (entry,) = json.loads((tmp_path / "c.json").read_text())["frames"]
    stepper = simulation.stepper(simulation.load())
    path = []
    for step in range(101):
        stepper.advance(step)
        path.append([*stepper.instant().body("ball").xpos, 1])
    u, v, w = np.array(entry["K"]) @ (np.linalg.inv(entry["world_from_camera"]) @ np.array(path).T)[:3]
    assert len(rows) > 20
    away = np.hypot(columns[:, None] + 0.5 - u / w, rows[:, None] + 0.5 - v / w).min(axis=1)
    assert away.max() < 4
    assert changed[int(v[0] / w[0]), int(u[0] / w[0])]


@pytest.mark.filterwarnings("ignore:trail, ghost")
def test_segmentation_and_depth_do_not_see_what_is_added(swing: Path, tmp_path: Path) -> None:
    for view in ("seg", "depth"):
        found = []
        for added in ({}, {"trail": ["ball"], "ghost": ["offset=0/0/.5"]}):
            options = {"view": view, "camera": "free", "time": 0.2, "size": SIZE, **added}
            Image(Simulation(swing), f"{tmp_path}/x.npy", **options).run()  # type: ignore[arg-type]
            found.append(np.load(tmp_path / "x.npy"))
        assert np.array_equal(*found)


def test_a_ghost_can_stand_in_a_pose_and_move_as_a_trace_says(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></worldbody>'
        '<keyframe><key name="up" qpos="1.5"/></keyframe></mujoco>'
    )
    Trace(Simulation(model, duration=0.5, qvel={"j": 2}), f"{tmp_path}/t.npz").run()
    found = ghosts(ViewOptions(ghost=[f"trace={tmp_path}/t.npz", "key=up,opacity=.5"]), model)
    trace = np.load(tmp_path / "t.npz")
    moving = found.ghosts[0].states(model, [0.0, 0.1, 0.101, 0.5, 9.0])
    standing = found.ghosts[1].states(model, [0.0])
    assert moving is not None
    assert standing is not None
    angles = trace["qpos/j"]
    assert [state[1] for state in moving] == [angles[0], angles[50], moving[2][1], angles[250], angles[250]]
    assert moving[2][1] == pytest.approx((angles[50] + angles[51]) / 2, abs=1e-15)
    assert standing[0][1] == 1.5
    assert found.ghosts[1].opacity == 0.5


def test_a_ghost_in_a_pose_that_is_not_finite_is_refused() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody>'
        '<keyframe><key name="lost" qpos="nan 0 0 1 0 0 0"/></keyframe></mujoco>'
    )
    with pytest.raises(ModelError, match=r"keyframe 'lost': qpos\[0\] is nan; it must be finite"):
        ghosts(ViewOptions(ghost=["key=lost"]), model)


@pytest.mark.parametrize(
    ("what", "kind", "said"),
    [
        ({"trail": ["bal"]}, UnknownNameError, "did you mean 'ball'"),
        ({"trail": ["ball"], "trail_span": 0}, UsageError, "not a positive number"),
        ({"ghost": ["colour=red"]}, UnknownNameError, "no setting 'colour' in ghost"),
        ({"ghost": ["offset=1/2"]}, UsageError, "a displacement x/y/z"),
        ({"ghost": ["opacity=2"]}, UsageError, "a number above 0 and up to 1"),
        ({"ghost": ["key=up"]}, UnknownNameError, "there are no keyframes"),
        ({"ghost": ["trace=no.csv"]}, MjrunError, "no such file"),
        ({"ghost": ["key=a,trace=b"]}, UsageError, "exclude each other"),
        ({"ghost": ["offset"]}, UsageError, "write offset=VALUE"),
        ({"ghost": ["opacity=.5,opacity=.6"]}, UsageError, "write opacity=VALUE once"),
        ({"ghost": ["swing.csv"]}, UnknownNameError, "did you mean 'trace=swing.csv' or 'recording=swing.csv'"),
    ],
)
def test_what_cannot_be_added_is_refused(
    swing: Path, tmp_path: Path, what: dict[str, object], kind: type, said: str
) -> None:
    with pytest.raises(kind, match=said):
        Image(Simulation(swing), f"{tmp_path}/a.png", size=SIZE, **what).run()  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def test_a_ghost_of_a_recording_is_where_a_bare_loop_was(swing: Path, tmp_path: Path) -> None:
    Recording(Simulation(swing, steps=100, qvel={"hinge": 3}), f"{tmp_path}/r.npz").run()
    model = mujoco.MjModel.from_xml_path(str(swing))
    options = ViewOptions(ghost=[f"recording={tmp_path}/r.npz,offset=1/-2/.5"], view="rgb")
    (ghost,) = ghosts(options, model).ghosts
    assert (ghost.offset, ghost.opacity) == ((1.0, -2.0, 0.5), OPACITY)
    states = ghost.states(model, [0.0, 0.1, 0.2])
    assert states is not None
    data = mujoco.MjData(model)
    data.joint("hinge").qvel = 3
    for state in states:
        assert state[1] == data.qpos[0]
        mujoco.mj_step(model, data, nstep=50)
    assert GhostPlan().states(model, [0.0]) is None  # it moves as the model does


def test_a_ghost_follows_a_table_of_others_by_the_map_of_the_simulation_or_its_own(tmp_path: Path, swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    (tmp_path / "log.csv").write_text("t,hip [deg]\n3,0\n3.1,90\n3.3,-90\n")
    (tmp_path / "own.map").write_text("time=t\nqpos/hinge=-'hip [deg]'*pi/180\n")
    simulation = Simulation(swing, map={"time": "t", "qpos/hinge": "'hip [deg]'*pi/180"}, steps=5)
    for setting, sign in (("", 1), (f",map={tmp_path}/own.map", -1)):
        options = ViewOptions(ghost=[f"trace={tmp_path}/log.csv{setting}"])
        found = ghosts(options, model, simulation)
        states = found.ghosts[0].states(model, [0.0, 0.05, 0.1, 0.2, 0.4])
        assert states is not None
        assert [state[1] for state in states] == pytest.approx(sign * np.pi / 4 * np.array([0, 1, 2, 0, -2]))
        assert any("3 s is time 0 here" in text for text in found.remarks)
    assert simulation.stepper(model).step == 0  # the map is not idle
    with pytest.raises(UsageError, match=r"^map requires a table for replay"):
        Simulation(swing, map="time=t", steps=5).stepper(model)
    Recording(Simulation(swing, steps=300), f"{tmp_path}/r.npz").run()
    replay = Simulation(swing, replay=f"{tmp_path}/r.npz", map=simulation.map)
    with pytest.raises(UsageError, match=r"^map requires a table for replay; a recording holds all of the state"):
        replay.stepper(model)
    ghosts(ViewOptions(ghost=[f"trace={tmp_path}/log.csv"]), model, replay)
    assert replay.stepper(model).step == 0
    for ghost, message in (
        (f"trace={tmp_path}/log.csv,map=none", "has no positions of this model"),
        ("map=none", "map requires trace=FILE"),
        ("offset=1,0,0", "write a point with slashes"),
        (f"trace={tmp_path}/log.csv,map={tmp_path}/no.map", "no such file"),
    ):
        with pytest.raises(MjrunError, match=message):
            ghosts(ViewOptions(ghost=[ghost]), model, simulation)


def test_a_trail_has_positions_closer_than_frames_of_a_video(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    timeline = Timeline.of_steps(Fraction(1, 500), 500)
    (trailed,) = planned_decorations(ViewOptions(trail=["ball,box", "ball"], trail_span="1/3"), model)
    assert isinstance(trailed, PlannedTrails)
    assert trailed.objects == [("body", model.body("ball").id), ("body", model.body("box").id)]
    assert trailed.span == pytest.approx(1 / 3)
    steps = trailed.steps(timeline)
    assert (steps[0], steps[-1]) == (0, 500)
    assert {later - step for step, later in pairwise(steps)} <= {2, 3}  # 1/240 s are 2.08 steps
    assert trailed.steps(Timeline.of_steps(Fraction(1, 500), 0)) == [0]


def test_only_requested_decorations_are_planned_in_the_order_of_the_options(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    assert planned_decorations(ViewOptions(), model) == []
    both = planned_decorations(ViewOptions(ghost=[""], trail=["ball"]), model)
    assert [type(each) for each in both] == [PlannedTrails, PlannedGhosts]


def test_what_is_wrong_is_named_by_its_place(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    for values, path in (({"trail": ["ball", "bal"]}, ("trail", 1)), ({"ghost": ["", "opacity=2"]}, ("ghost", 1))):
        with pytest.raises(UsageError) as caught:
            planned_decorations(ViewOptions(**values), model)  # type: ignore[arg-type]
        assert caught.value.path[:2] == path
