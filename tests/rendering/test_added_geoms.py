"""Trails and ghosts: their geoms, against closed forms and MuJoCo's own scenes."""

import pickle
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from mjrun.camera.targets import ObjectTrajectory, identify_objects, object_paths
from mjrun.errors import UnknownNameError
from mjrun.rendering.added_geoms import WIDENING, Decoration, Ghost, Trail, ramp, trails
from mjrun.rendering.visual import Visual
from tests.cases import mjcf

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
MODEL = mujoco.MjModel.from_xml_string(mjcf("gravityless"))
WIDTH = 0.004


def saved(data: mujoco.MjData) -> np.ndarray:
    state = np.empty(mujoco.mj_stateSize(MODEL, STATE))
    mujoco.mj_getState(MODEL, data, state, STATE)
    return state


def recorded(frames: int, steps: int = 4) -> list[np.ndarray]:
    """States of the arm turning at 3 rad/s and the ball drifting at .5 m/s, `steps` of 10 ms apart."""
    data = mujoco.MjData(MODEL)
    mujoco.mj_resetDataKeyframe(MODEL, data, 0)
    states = []
    for _ in range(frames):
        states.append(saved(data))
        mujoco.mj_step(MODEL, data, nstep=steps)
    return states


def scene_of(state: np.ndarray, room: int = 2000, visual: Visual | None = None) -> mujoco.MjvScene:
    data = mujoco.MjData(MODEL)
    mujoco.mj_setState(MODEL, data, state, STATE)
    mujoco.mj_forward(MODEL, data)
    scene, options = mujoco.MjvScene(MODEL, room), (visual or Visual()).options()
    mujoco.mjv_updateScene(MODEL, data, options, None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL.value, scene)
    return scene


def added(decoration: Decoration, index: int, room: int = 2000) -> list[mujoco.MjvGeom]:
    scene = mujoco.MjvScene(MODEL, room)
    decoration.add(scene, index)
    return list(scene.geoms[: scene.ngeom])


def ends(geoms: list[mujoco.MjvGeom]) -> np.ndarray:
    """Where connectors begin and end `(n, 2, 3)`."""
    half = np.array([geom.mat[:, 2] * geom.size[2] for geom in geoms])
    middle = np.array([geom.pos for geom in geoms])
    return np.stack([middle - half, middle + half], axis=1)


def circle(frames: int, speed: float = 2.0) -> ObjectTrajectory:
    """Once round a circle of radius 1 m in a plane, at 30 frames a second."""
    t = np.arange(frames) / 30
    positions = np.stack([np.cos(speed * t), np.sin(speed * t), 0 * t], axis=1)
    velocities = speed * np.stack([-np.sin(speed * t), np.cos(speed * t), 0 * t], axis=1)
    return ObjectTrajectory(t, positions, velocities)


# --- paths ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "name", "place"), [("body", "arm", 0), ("body", "hand", 0.4), ("site", "tip", 0.5), ("geom", "rod", 0.25)]
)
def test_the_path_of_something_that_turns_is_a_circle_at_constant_speed(kind: str, name: str, place: float) -> None:
    (path,) = object_paths(MODEL, identify_objects(f"{kind}:{name}" if kind != "body" else name, MODEL), recorded(20))
    angle = 3 * np.arange(20) * 0.04
    assert path.times == pytest.approx(np.arange(20) * 0.04)
    zero = np.zeros(20)
    assert path.positions == pytest.approx(place * np.stack([-np.sin(angle), zero, -np.cos(angle)], 1) + [0, 0, 1])
    assert path.velocities == pytest.approx(3 * place * np.stack([-np.cos(angle), zero, np.sin(angle)], 1), abs=1e-9)


def test_velocities_are_the_differences_of_positions_over_a_short_time() -> None:
    close = recorded(3, steps=1)
    for path in object_paths(MODEL, identify_objects("palm,ball,mark", MODEL), close):
        difference = (path.positions[2] - path.positions[0]) / 0.02
        assert path.velocities[1] == pytest.approx(difference, rel=1e-3, abs=1e-3)


def test_between_its_frames_a_path_is_the_cubic_through_positions_and_velocities() -> None:
    factors = np.random.default_rng(1).normal(size=(4, 3))
    times = np.array([0, 0.5, 0.6, 2])
    powers = np.stack([times**k for k in range(4)], axis=1)
    slopes = np.stack([k * times ** max(k - 1, 0) for k in range(4)], axis=1)
    path = ObjectTrajectory(times, powers @ factors, slopes @ factors)
    between = np.linspace(0, 2, 33)
    assert path.at(between) == pytest.approx(np.stack([between**k for k in range(4)], axis=1) @ factors)


def test_objects_to_follow_are_named_by_commas_each_once() -> None:
    assert identify_objects("hand,site:tip,ball,hand", MODEL) == [("body", 2), ("site", 1), ("body", 3)]
    with pytest.raises(UnknownNameError, match="no object 'hnad'"):
        identify_objects("ball,hnad", MODEL)
    with pytest.raises(UnknownNameError, match="no object ''"):
        identify_objects("ball,", MODEL)


# --- trails -----------------------------------------------------------------------------------------


def test_a_trail_is_one_line_along_the_path_up_to_the_object() -> None:
    path = circle(90)
    line = ends(added(Trail(path, WIDTH), 60))
    assert line[0, 0] == pytest.approx(path.positions[0], abs=1e-6)
    assert line[-1, 1] == pytest.approx(path.positions[60], abs=1e-6)
    assert line[1:, 0] == pytest.approx(line[:-1, 1], abs=1e-6)
    middles = line.mean(axis=1)
    astray = np.abs(1 - np.linalg.norm(middles[:, :2], axis=1))
    assert astray.max() < WIDENING * WIDTH / 5
    turned = np.unwrap(np.arctan2(middles[:, 1], middles[:, 0]))
    assert (np.diff(turned) > 0).all()
    assert turned[-1] == pytest.approx(60 / 30 * 2, abs=0.1)


def test_what_is_drawn_of_the_past_is_the_same_in_every_frame() -> None:
    trace = Trail(circle(60), WIDTH, limit=30)
    now, later = ends(added(trace, 30)), ends(added(trace, 50))
    assert len(later) > len(now) > 5
    assert np.array_equal(now[:-1], later[: len(now) - 1])


def test_a_trail_is_wider_and_warmer_where_the_object_was_faster() -> None:
    t = np.arange(61) / 30
    ahead = np.array([1.0, 0, 0])
    path = ObjectTrajectory(t, t[:, None] ** 2 / 2 * ahead, t[:, None] * ahead)  # ever faster along a line
    geoms = added(Trail(path, WIDTH), 60)
    radii = [geom.size[0] for geom in geoms]
    assert (np.diff(radii) > 0).all()
    assert radii[0] == pytest.approx(WIDTH, rel=0.1)
    assert radii[-1] == pytest.approx(WIDENING * WIDTH, rel=0.1)
    first, last = geoms[0].rgba, geoms[-1].rgba
    assert first[:3] == pytest.approx(ramp(np.zeros(1))[0], abs=0.05)
    assert last[:3] == pytest.approx(ramp(np.ones(1))[0], abs=0.05)
    assert first[2] > first[0]
    assert last[0] > last[2]


def test_a_straight_path_at_one_speed_is_one_capsule() -> None:
    t = np.arange(100) / 30
    ahead = np.array([0.3, 0.4, 0])
    assert len(added(Trail(ObjectTrajectory(t, t[:, None] * ahead, np.tile(ahead, (100, 1))), WIDTH), 99)) == 1


def wild(frames: int) -> ObjectTrajectory:
    random = np.random.default_rng(0)
    return ObjectTrajectory(
        np.arange(frames) / 30, random.normal(size=(frames, 3)), random.normal(size=(frames, 3)) * 9
    )


@pytest.mark.parametrize("span", [None, 0.5])
def test_however_wild_the_path_capsules_are_limited(span: float | None) -> None:
    trace = Trail(wild(400), WIDTH, span=span, limit=50)
    counts = [len(added(trace, index)) for index in range(0, 400, 7)]
    assert max(counts) <= trace.geoms == 50
    assert max(counts) > 40


@pytest.mark.parametrize("room", [0, 1, 20])
def test_in_a_scene_that_is_full_the_newest_part_is_drawn(room: int) -> None:
    trace = Trail(wild(40), WIDTH)
    whole = added(trace, 39)
    assert len(whole) > 20
    part = added(trace, 39, room=room)
    assert len(part) == room
    assert [list(geom.pos) for geom in part] == [list(geom.pos) for geom in whole[len(whole) - room :]]


def test_what_stands_still_leaves_no_trail() -> None:
    jitter = np.random.default_rng(0).normal(size=(50, 3)) * 1e-9
    path = ObjectTrajectory(np.arange(50) / 30, jitter, jitter)
    assert added(Trail(path, WIDTH), 49) == []
    assert added(Trail(circle(1), WIDTH), 0) == []
    assert added(Trail(circle(50), WIDTH), 0) == []


def test_a_trail_of_the_last_seconds_thins_out_to_where_the_object_was() -> None:
    path = circle(90)
    geoms = added(Trail(path, WIDTH, span=0.5), 80)
    line = ends(geoms)
    assert line[0, 0] == pytest.approx(path.positions[65], abs=1e-6)
    assert line[-1, 1] == pytest.approx(path.positions[80], abs=1e-6)
    radii = [geom.size[0] for geom in geoms]
    assert (np.diff(radii) > 0).all()
    assert radii[0] < radii[-1] / 3


def test_a_path_may_be_closer_than_the_frames() -> None:
    close, frames = circle(91), np.arange(0, 91, 10) / 30
    coarse = Trail(close, WIDTH, instants=frames)
    fine = Trail(close, WIDTH)
    for frame in range(10):
        assert [shape(geom) for geom in added(coarse, frame)] == [shape(geom) for geom in added(fine, 10 * frame)]


def test_a_trail_begins_with_the_recording_whatever_its_clock_shows() -> None:
    states = recorded(10)
    late = [np.concatenate([state[:1] + 1.5, state[1:]]) for state in states]  # the time is first in a state
    instants, objects = 0.04 * np.arange(10), identify_objects("site:tip", MODEL)
    (trail,), (other,) = trails(MODEL, objects, states, instants), trails(MODEL, objects, late, instants)
    for index in (2, 9):
        line = ends(added(trail, index))
        assert line[-1, 1] == pytest.approx(trail.path.positions[index], abs=1e-6)
        assert ends(added(other, index)) == pytest.approx(line, abs=1e-6)


def test_trails_of_one_model_share_one_scale_of_speed() -> None:
    fast, slow = trails(MODEL, identify_objects("site:tip,ball", MODEL), recorded(10))  # 1.5 m/s, .5 m/s
    widths = [added(each, 9)[0].size[0] for each in (fast, slow)]
    assert widths[0] / widths[1] == pytest.approx(WIDENING / (1 + (WIDENING - 1) / 3))


# --- ghosts -----------------------------------------------------------------------------------------


def moving(scene: mujoco.MjvScene, first: int = 0) -> list[mujoco.MjvGeom]:
    dynamic = mujoco.mjtCatBit.mjCAT_DYNAMIC
    return [geom for geom in scene.geoms[first : scene.ngeom] if geom.category == dynamic]


def shape(geom: mujoco.MjvGeom) -> tuple[object, ...]:
    return geom.type, geom.dataid, *geom.size, *geom.mat.ravel(), *geom.pos


@pytest.mark.parametrize("own", [False, True])
def test_a_ghost_is_what_moves_drawn_again_displaced_and_translucent(own: bool) -> None:
    now, other = recorded(10)[::9]
    scene = scene_of(now)
    before = scene.ngeom
    originals = moving(scene) if not own else moving(scene_of(other))
    Ghost(MODEL, [other] if own else None, offset=(1, 2, 3), opacity=0.5).add(scene, 0)
    ghosts = scene.geoms[before : scene.ngeom]
    assert 5 < len(ghosts) == len(originals)
    for ghost, original in zip(ghosts, originals, strict=True):
        original.pos = original.pos + np.array([1, 2, 3])
        assert shape(ghost) == pytest.approx(shape(original), abs=1e-6)
        assert ghost.rgba[3] == pytest.approx(original.rgba[3] / 2)


def test_the_last_state_of_a_ghost_stays() -> None:
    states = recorded(3)
    ghost = Ghost(MODEL, states)
    last = [shape(geom) for geom in added(ghost, 2)]
    assert [shape(geom) for geom in added(ghost, 99)] == last
    assert [shape(geom) for geom in added(ghost, 1)] != last


def test_a_ghost_shows_the_groups_that_are_shown_and_no_labels_or_frames() -> None:
    states = recorded(1)
    assert len(added(Ghost(MODEL, states, visual=Visual(label="geom", frame="body")), 0)) == len(
        added(Ghost(MODEL, states), 0)
    )
    assert added(Ghost(MODEL, states, visual=Visual(groups={"geom": (), "site": (), "tendon": ()})), 0) == []


@pytest.mark.parametrize("own", [False, True])
def test_a_ghost_leaves_out_flexes_of_which_a_scene_has_room_for_one(own: bool) -> None:
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco><worldbody>
          <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" mass="1"/>
          <body><freejoint/><geom size=".1"/></body>
        </worldbody></mujoco>
        """
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    scene = mujoco.MjvScene(model, 100)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), every, scene)
    before = [geom.type for geom in scene.geoms[: scene.ngeom]]
    assert mujoco.mjtGeom.mjGEOM_FLEX in before
    Ghost(model, [state] if own else None).add(scene, 0)
    assert [geom.type for geom in scene.geoms[len(before) : scene.ngeom]] == [mujoco.mjtGeom.mjGEOM_SPHERE]


def test_a_second_ghost_is_not_the_ghost_of_a_ghost() -> None:
    scene = scene_of(recorded(1)[0])
    first, ghost = scene.ngeom, Ghost(MODEL)
    ghost.add(scene, 0)
    second = scene.ngeom
    ghost.add(scene, 0)
    assert scene.ngeom - second == second - first


def test_a_ghost_says_how_much_room_it_needs_and_makes_do_with_less() -> None:
    states = recorded(1)
    scene = scene_of(states[0])
    before = scene.ngeom
    ghost = Ghost(MODEL)
    ghost.add(scene, 0)
    assert 30 < scene.ngeom - before <= ghost.geoms  # most of them a slack tendon
    small = scene_of(states[0], room=before + 3)
    ghost.add(small, 0)
    assert small.ngeom == before + 3


# --- both -------------------------------------------------------------------------------------------

DECORS: list[Callable[[], Decoration]] = [
    lambda: Trail(circle(30), 0.02),
    lambda: Ghost(MODEL, offset=(0, 0.3, 0)),
    lambda: Ghost(MODEL, recorded(2), offset=(0, 0.3, 0)),
]


@pytest.mark.parametrize("make", DECORS)
def test_decor_belongs_to_nothing_casts_no_shadow_and_has_no_label(make: Callable[[], Decoration]) -> None:
    scene = scene_of(recorded(1)[0], visual=Visual(label="geom"))
    before = scene.ngeom
    for geom in scene.geoms:
        geom.label = "stale"
    make().add(scene, 20)
    assert scene.ngeom > before
    for geom in scene.geoms[before : scene.ngeom]:
        assert (geom.objtype, geom.objid, geom.segid) == (mujoco.mjtObj.mjOBJ_UNKNOWN, -1, -1)
        assert (geom.label, geom.castshadow, geom.matid, geom.texid) == ("", 0, -1, -1)
        assert geom.category == mujoco.mjtCatBit.mjCAT_DECOR


@pytest.mark.parametrize("make", DECORS)
def test_decor_is_seen_in_colour_and_not_in_depth_or_segmentation(make: Callable[[], Decoration]) -> None:
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    with mujoco.Renderer(MODEL, 48, 64) as renderer:
        views = []
        for decorations in ([], [make()]):
            renderer.update_scene(data)
            for decoration in decorations:
                decoration.add(renderer.scene, 20)
            color = renderer.render()
            renderer.enable_segmentation_rendering()
            ids = renderer.render()
            renderer.enable_depth_rendering()
            depth = renderer.render()
            renderer.disable_depth_rendering()
            views.append((color, ids, depth))
    (plain, ids, depth), (decorated, same_ids, same_depth) = views
    assert (plain != decorated).any(axis=2).mean() > 0.005
    assert np.array_equal(ids, same_ids)
    assert np.array_equal(depth, same_depth)


@pytest.mark.parametrize("make", DECORS)
@pytest.mark.parametrize("used", [False, True])
def test_decor_can_be_sent_to_another_process_before_and_after_it_has_drawn(
    make: Callable[[], Decoration], used: bool
) -> None:
    decoration = make()
    if used:
        decoration.add(scene_of(recorded(1)[0]), 0)
    copy = pickle.loads(pickle.dumps(decoration))
    scenes = [scene_of(recorded(1)[0]) for _ in range(2)]
    for scene, each in zip(scenes, (decoration, copy), strict=True):
        each.add(scene, 20)
    mine, theirs = ([shape(geom) for geom in scene.geoms[: scene.ngeom]] for scene in scenes)
    assert mine == theirs
