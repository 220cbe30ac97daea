"""Scripts found in a model, and the poses they give: against the tutorial's formulas and closed forms."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.camera.pose import CameraPose, pose_of, rotation
from mjrun.camera.rigs.free_camera import FreeRig, OrbitRig, TrackRig
from mjrun.camera.rigs.look import LookRig
from mjrun.camera.rigs.model import ModelRig
from mjrun.camera.rigs.rig import BLENDS, EasedNumber, Rig, Shake, ShotBlend
from mjrun.camera.script import CameraScript, FramedObject, Shot
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.errors import MjrunError, ModelError
from mjrun.model.state import save
from tests.cases import mjcf

MODEL = mujoco.MjModel.from_xml_string(mjcf("box_with_cameras"))
SIZE = (160, 90)


def place(time: float) -> np.ndarray:
    """Where the box is [m]."""
    return np.array([0.3 * time, 0.2 * math.sin(3 * time), 0.1 + time * time / 9])


def states(times: Sequence[float], spin: float = 50.0) -> Iterator[np.ndarray]:
    """The box on its way, turning by `spin` [deg/s]."""
    data = mujoco.MjData(MODEL)
    for time in times:
        half = math.radians(spin * time) / 2
        data.qpos[:3], data.qpos[3:], data.time = place(time), [math.cos(half), 0, 0, math.sin(half)], time
        yield save(MODEL, data)


def course(*shots: Shot) -> BoundCameraScript:
    return BoundCameraScript(CameraScript("a", shots), MODEL, SIZE)


def poses_of(
    shots: Sequence[Shot], times: Sequence[float], ends: Sequence[float], spin: float = 50.0
) -> list[CameraPose]:
    """The poses at `times` of shots that end at `ends`; the video is at half the speed."""
    spans = list(itertools.pairwise([0.0, *ends]))
    return list(course(*shots).poses(states(times, spin), times, [2 * t for t in times], spans))


def around(
    distance: float, azimuth: float, elevation: float = 0.0, target: tuple[float, float, float] = (0, 0, 0)
) -> FreeRig:
    return FreeRig(target, EasedNumber.still(distance), EasedNumber.still(azimuth), EasedNumber.still(elevation))


def test_the_last_video_of_mujoco_s_tutorial() -> None:
    throw = 0.9
    orbit = OrbitRig("geom:floor", EasedNumber.still(0.9), EasedNumber(140, 240, "cosine"), EasedNumber.still(-30))
    track = TrackRig("geom:box", EasedNumber.still(0.08), EasedNumber.still(280), EasedNumber.still(-10))
    times = np.arange(0, 2, 1 / 60)
    found = poses_of([Shot(orbit), Shot(track, blend=ShotBlend("sigmoid", 0.3))], list(times), (throw, 2))
    data, camera, scene = mujoco.MjData(MODEL), mujoco.MjvCamera(), mujoco.MjvScene(MODEL, 1)
    mujoco.mjv_defaultCamera(camera)
    for pose, time, state in zip(found, times, states(list(times)), strict=True):
        mujoco.mj_setState(MODEL, data, state, mujoco.mjtState.mjSTATE_INTEGRATION.value)
        mujoco.mj_forward(MODEL, data)
        s = 1 / (1 + np.exp(-(time - throw) / 0.3))  # mix(), unit_cos(), cam_motion() of the tutorial
        azimuth0 = 140 + 100 * (0.5 - np.cos(np.pi * np.clip(time / throw, 0, 1)) / 2)
        distance, azimuth, elevation = (1 - s) * np.array([0.9, azimuth0, -30]) + s * np.array([0.08, 280, -10])
        lookat = (1 - s) * data.geom("floor").xpos + s * data.geom("box").xpos
        a, e = np.radians([azimuth, elevation])
        forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        assert pose.position == pytest.approx(lookat - distance * forward, abs=1e-9)
        assert pose.forward == pytest.approx(forward, abs=1e-9)
        camera.distance, camera.azimuth, camera.elevation, camera.lookat[:] = distance, azimuth, elevation, lookat
        mujoco.mjv_updateCamera(MODEL, data, camera, scene)
        assert pose.position == pytest.approx(pose_of(scene).position, abs=1e-6)
        assert pose.rotation == pytest.approx(pose_of(scene).rotation, abs=1e-6)
        assert pose.frustum == pose_of(scene).frustum


def test_cameras_follow_what_mj_forward_computes() -> None:
    times = [k / 5 for k in range(9)]
    data, camera, scene = mujoco.MjData(MODEL), mujoco.MjvCamera(), mujoco.MjvScene(MODEL, 1)
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED.value, MODEL.camera("com").id
    tracking, following = (poses_of([Shot(rig)], times, (2,)) for rig in (ModelRig("com"), TrackRig("subtree:box")))
    for track, follow, state in zip(tracking, following, states(times), strict=True):
        mujoco.mj_setState(MODEL, data, state, mujoco.mjtState.mjSTATE_INTEGRATION.value)
        mujoco.mj_forward(MODEL, data)
        mujoco.mjv_updateCamera(MODEL, data, camera, scene)
        assert track.position == pytest.approx(pose_of(scene).position, abs=1e-6)
        assert follow.lookat == pytest.approx(data.body("box").subtree_com, abs=1e-9)


def test_a_cut_is_at_the_first_frame_of_the_new_shot() -> None:
    shots = [Shot(around(1, 0)), Shot(around(2, 0)), Shot(around(3, 0))]
    found = poses_of(shots, [0, 0.5, 0.999, 1, 1.5, 2, 9], (1, 2, 3))
    assert [pose.distance for pose in found] == [1, 1, 1, 2, 2, 3, 3]


def test_a_ramp_lasts_as_long_as_its_shot_and_holds_outside_of_it() -> None:
    moving = FreeRig((0, 0, 0), EasedNumber(1, 3), EasedNumber.still(0), EasedNumber.still(0))
    shots = [
        Shot(around(5, 0)),
        Shot(moving, blend=ShotBlend("linear", 2)),
        Shot(around(9, 0), blend=ShotBlend("linear", 2)),
    ]
    found = poses_of(shots, [1.5, 2, 2.5, 3, 5, 6, 6.5, 7.5], (2, 7, 10))
    weight = 0.25  # of the second shot at 1.5 s, which has not moved then
    expected = [(1 - weight) * 5 + weight * 1, (5 + 1) / 2, 0.25 * 5 + 0.75 * 1.2, 1.4, 2.2, 2.6, 2.1 + 0.25 * 9]
    assert [pose.distance for pose in found] == pytest.approx([*expected, 0.25 * 3 + 0.75 * 9])


@given(st.floats(0, 3))
def test_blends_that_overlap_are_folded_in_order(time: float) -> None:
    shots = [
        Shot(around(1, 0, 0)),
        Shot(around(2, 40, -20, (1, 2, 3)), blend=ShotBlend("cosine", 2)),
        Shot(around(5, 70, 10, (0, 1, 0)), blend=ShotBlend("sigmoid", 0.4)),
    ]
    pose = poses_of(shots, [time], (1, 1.5, 3))[0]
    window = np.clip((time - 1) / 2 + 0.5, 0, 1)
    first, second = (1 - math.cos(math.pi * window)) / 2, 1 / (1 + math.exp(-(time - 1.5) / 0.4))

    def folded(a: float, b: float, c: float) -> float:
        ab = a + first * (b - a)
        return ab + second * (c - ab)

    assert pose.distance == pytest.approx(folded(1, 2, 5))
    assert pose.rotation == pytest.approx(rotation(folded(0, 40, 70), folded(0, -20, 10)), abs=1e-9)
    assert pose.lookat == pytest.approx(np.array([folded(0, 1, 0), folded(0, 2, 1), folded(0, 3, 0)]), abs=1e-9)


@given(st.floats(-400, 400), st.floats(-400, 400), st.floats(0, 1))
def test_a_blend_goes_the_short_way(start: float, end: float, share: float) -> None:
    shots = [Shot(around(1, start)), Shot(around(1, end), blend=ShotBlend("linear", 2))]
    pose = poses_of(shots, [2 * share], (1, 2))[0]
    way = (end - start + 180) % 360 - 180
    if abs(way) < 179.999:
        assert pose.rotation == pytest.approx(rotation(start + share * way, 0), abs=1e-9)


def apart(one: CameraPose, other: CameraPose) -> float:
    """How far two poses are from each other: in place [m], or in direction of any of their axes [rad]."""
    turned = np.linalg.norm(one.rotation - other.rotation, axis=0).max()
    return max(float(np.linalg.norm(one.position - other.position)), float(turned))


rigs = st.one_of(
    st.builds(
        lambda d, a, da, e, heading: TrackRig(
            "box", EasedNumber.still(d), EasedNumber(a, a + da), EasedNumber(e, e / 2, "smooth"), heading
        ),
        st.floats(0.1, 3),
        st.floats(-400, 400),
        st.floats(-90, 90),
        st.floats(-80, 80),
        st.booleans(),
    ),
    st.builds(lambda x, y, z: LookRig((x, y, 2 + z), "box"), *[st.floats(-3, 3)] * 2, st.floats(0.5, 3)),
    st.just(ModelRig("top")),
)


@settings(deadline=None, max_examples=10)
@given(rigs, rigs, st.sampled_from(sorted(BLENDS)), st.floats(0.1, 1), st.floats(-700, 700))
@pytest.mark.slow
def test_nothing_jumps_where_two_shots_join(one: Rig, other: Rig, shape: str, width: float, spin: float) -> None:
    shots = [Shot(one), Shot(other, blend=ShotBlend(shape, width), roll=EasedNumber(-20, 50))]

    def steps(times: Sequence[float]) -> np.ndarray:
        return np.array(list(itertools.starmap(apart, itertools.pairwise(poses_of(shots, times, (1, 2), spin)))))

    times = np.linspace(1 - 0.7 * width, 1 + 0.7 * width, 100)
    coarse = steps(times.tolist())
    fastest = np.sort(np.argsort(coarse)[-3:])
    closer = np.unique([*times, *np.linspace(times[fastest], times[fastest + 1], 11).ravel()])
    fine, begins = steps(closer.tolist()), np.searchsorted(closer, times[fastest])
    for k, begin in zip(fastest, begins, strict=True):
        # Looked at ten times closer a motion is slower, a jump is not.
        assert fine[begin : begin + 10].max() < 0.5 * coarse[k] + 1e-5


def test_a_blend_does_not_change_its_mind_when_the_short_way_does() -> None:
    chase = TrackRig("box", EasedNumber.still(1), EasedNumber.still(0), EasedNumber.still(0), heading=True)
    times = [float(t) for t in np.arange(0.5, 1.5, 1e-3)]
    spin = 170.0  # at 1 s the two are 170 degrees apart, soon after 180 and more
    found = poses_of([Shot(around(1, 0)), Shot(chase, blend=ShotBlend("cosine", 1))], times, (1, 2), spin)
    assert max(itertools.starmap(apart, itertools.pairwise(found))) < 0.02
    for pose, time in zip(found, times, strict=True):
        share = (1 - math.cos(math.pi * (time - 0.5))) / 2
        assert pose.rotation == pytest.approx(rotation(share * spin * time, 0), abs=1e-9)


def test_an_orbit_is_not_unwound_by_a_blend_that_began_long_ago() -> None:
    orbit = OrbitRig((0, 0, 0), EasedNumber.still(1), EasedNumber(0, 1080), EasedNumber.still(0))
    times = [float(t) for t in np.arange(0, 4, 0.01)]
    shots = [Shot(orbit), Shot(around(1, 30), blend=ShotBlend("sigmoid", 0.5))]
    found = poses_of(shots, times, (3, 4))
    for pose, time in zip(found, times, strict=True):
        angle, weight = min(360 * time, 1080), 1 / (1 + math.exp(-(time - 3) / 0.5))
        assert pose.rotation == pytest.approx(rotation(angle + weight * (1080 + 30 - angle), 0), abs=1e-9)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_blend_away_from_a_camera_that_looks_down_is_smooth_although_down_has_no_azimuth(side: int) -> None:
    times = [float(t) for t in np.arange(0, 2, 0.01)]
    shots = [Shot(ModelRig("top")), Shot(around(1, 90 + 60 * side, -30), blend=ShotBlend("cosine", 2))]
    found = poses_of(shots, times, (1, 2))
    assert max(itertools.starmap(apart, itertools.pairwise(found))) < 0.05
    half = poses_of(shots, [1], (1, 2))[0]
    assert half.rotation == pytest.approx(rotation(90 + 30 * side, -60), abs=1e-5)


def test_a_blend_follows_a_camera_that_nods_over_the_pole_where_its_azimuth_turns_about() -> None:
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco>
          <statistic center="0 0 0" extent="1"/>
          <worldbody><body><joint axis="1 0 0"/><geom size=".1"/><camera name="eye" pos="0 0 1"/></body></worldbody>
        </mujoco>
        """
    )
    data, times, found = mujoco.MjData(model), [float(t) for t in np.arange(0, 2, 0.01)], []
    for time in times:
        data.qpos[0] = time - 0.9  # upside down before 0.9 s
        found.append(save(model, data))
    shots = [Shot(ModelRig("eye")), Shot(around(1, 120, -30), blend=ShotBlend("cosine", 2))]
    poses = list(BoundCameraScript(CameraScript("a", shots), model, SIZE).poses(found, times, times, [(0, 1), (1, 2)]))
    assert max(itertools.starmap(apart, itertools.pairwise(poses))) < 0.05


def test_fields_of_view_are_blended_by_their_tangents() -> None:
    shots = [Shot(around(1, 0), fovy=EasedNumber.still(90)), Shot(ModelRig("top"), blend=ShotBlend("linear", 2))]
    found = poses_of(shots, [0, 0.5, 1, 2], (1, 2))
    tangents = [math.tan(math.radians(pose.frustum.fovy / 2)) for pose in found]
    one, other = 1, math.tan(math.radians(30))
    assert tangents == pytest.approx([one, 0.75 * one + 0.25 * other, (one + other) / 2, other])
    assert [pose.frustum.width for pose in found] == [0, 0, 0, 0]


def test_heights_of_orthographic_cameras_are_blended_too() -> None:
    shots = [Shot(ModelRig("flat")), Shot(ModelRig("flatter"), blend=ShotBlend("linear", 2))]
    found = poses_of(shots, [0, 0.5, 1, 2], (1, 2))
    assert [pose.frustum.fovy for pose in found] == pytest.approx([2, 2.5, 3, 4])
    assert all(pose.frustum.orthographic for pose in found)


def test_perspective_is_that_of_all_shots() -> None:
    assert course(Shot(around(1, 0)), Shot(ModelRig("top"))).perspective
    assert not course(Shot(around(1, 0)), Shot(ModelRig("flat"))).perspective
    assert [p.frustum.orthographic for p in poses_of([Shot(around(1, 0)), Shot(ModelRig("flat"))], [0, 1], (1, 2))] == [
        0,
        1,
    ]


def test_roll_and_field_of_view_are_ramps_of_their_shot() -> None:
    shot = Shot(around(1, 20, -10), roll=EasedNumber(0, 90, "in"), fovy=EasedNumber(20, 60))
    poses = poses_of([shot], [0, 1, 2], (2,))
    assert [pose.angles[2] for pose in poses] == pytest.approx([0, 22.5, 90])
    assert [pose.frustum.fovy for pose in poses] == pytest.approx([20, 40, 60])
    assert all(pose.position == pytest.approx(poses[0].position) for pose in poses)


def test_a_shake_turns_the_camera_about_itself_by_time_of_the_video() -> None:
    shot = Shot(around(1, 20, -10), shake=Shake(angle=0.5, frequency=2, seed=4))
    video_times = [k / 10 for k in range(1200)]
    still = poses_of([replace(shot, shake=None)], [0.0], (1,))[0]
    times = [k / 1000 for k in range(1200)]
    found = list(course(shot).poses(states(times), times, video_times, [(0, 2)]))
    angles = [np.subtract(pose.angles, still.angles)[:2] * [math.cos(math.radians(10)), 1] for pose in found]
    assert np.std(angles, axis=0) == pytest.approx([0.5, 0.5], rel=0.15)
    assert all(np.array_equal(pose.position, still.position) for pose in found)
    slower = list(course(shot).poses(states([0.0] * 1200), [0.0] * 1200, video_times, [(0, 2)]))
    assert all(np.array_equal(a.rotation, b.rotation) for a, b in zip(found, slower, strict=True))


def test_a_shake_is_blended_with_its_shot() -> None:
    shaken = Shot(around(1, 0), blend=ShotBlend("linear", 2), shake=Shake(angle=5))
    for time, share in ((0, 0), (0.5, 0.25), (1, 0.5), (2, 1)):
        pose = poses_of([Shot(around(1, 0)), shaken], [time], (1, 2))[0]
        whole = poses_of([replace(shaken, blend=None)], [time], (3,))[0]
        assert pose.angles[:2] == pytest.approx(np.multiply(share, whole.angles[:2]), abs=0.02)


def corners(data: mujoco.MjData) -> np.ndarray:
    """Those of the boxes of all geoms of the box `(16, 3)`."""
    found = []
    for geom in (1, 2):
        center, half = MODEL.geom_aabb[geom, :3], MODEL.geom_aabb[geom, 3:]
        for signs in itertools.product((-1, 1), repeat=3):
            found.append(data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ (center + half * signs))
    return np.array(found)


FITTED = [
    Shot(around(5, 30, -20)),
    Shot(LookRig((0, -1, 2), "box"), roll=EasedNumber.still(20)),
    Shot(ModelRig("flat")),
]


@pytest.mark.parametrize("size", [(160, 90), (90, 160)])
@pytest.mark.parametrize("shot", FITTED)
def test_what_is_fitted_stays_whole_in_the_picture(shot: Shot, size: tuple[int, int]) -> None:
    times = [k / 10 for k in range(20)]
    fitted = BoundCameraScript(CameraScript("a", [replace(shot, fit=FramedObject("box", 1.3))]), MODEL, size)
    data = mujoco.MjData(MODEL)
    for pose, state in zip(fitted.poses(states(times), times, times, [(0, 2)]), states(times), strict=True):
        mujoco.mj_setState(MODEL, data, state, mujoco.mjtState.mjSTATE_INTEGRATION.value)
        mujoco.mj_forward(MODEL, data)
        x, y, back = ((corners(data) - pose.position) @ pose.rotation).T
        half = pose.frustum.top if pose.frustum.orthographic else pose.frustum.top / pose.frustum.near * -back
        shares = np.abs([x / half * size[1] / size[0], y / half])
        assert shares.max() == pytest.approx(1 / 1.3, rel=1e-6)
        points = corners(data)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        assert pose.lookat == pytest.approx(middle, abs=1e-9)


def test_frames_are_read_once_and_no_earlier_than_needed() -> None:
    read: list[float] = []

    def watched(times: Sequence[float]) -> Iterator[np.ndarray]:
        for time, state in zip(times, states(times), strict=True):
            read.append(time)
            yield state

    times = [k / 10 for k in range(30)]
    shots = [Shot(around(1, 0)), Shot(around(2, 0), blend=ShotBlend("linear", 0.4))]
    poses = course(*shots).poses(watched(times), times, times, [(0, 1), (1, 3)])
    for k in range(len(times)):
        next(poses)
        assert len(read) <= max(k + 2, 13)
    assert read == times
    assert next(poses, None) is None


def test_a_shot_without_length_and_a_video_of_one_frame_have_a_pose() -> None:
    moving = FreeRig((0, 0, 0), EasedNumber(1, 3), EasedNumber.still(0), EasedNumber.still(0))
    assert poses_of([Shot(moving)], [0], (0,))[0].distance == 1
    shots = [Shot(around(5, 0)), Shot(moving), Shot(around(7, 0))]
    assert [pose.distance for pose in poses_of(shots, [0, 1, 2], (1, 1, 2))] == [5, 7, 7]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: [Shot(ModelRig("tpo"))], "no camera 'tpo' (did you mean 'top'?)"),
        (lambda: [Shot(around(-1, 0))], "distance: '-1' is not a positive number of metres"),
        (
            lambda: [Shot(around(1, 0)), Shot(around(1, 0), blend="cubic")],
            "shape: 'cubic' is not one of cosine,",
        ),
        (lambda: [Shot(around(1, 0)), Shot(around(1, 0), blend=0)], "width: '0' is not a positive number"),
        (
            lambda: [Shot(around(1, 0)), Shot(ModelRig("flat"), blend=ShotBlend())],
            "shot 2: a camera with perspective and",
        ),
        (
            lambda: [Shot(around(1, 0), fovy=EasedNumber(20, 180))],
            "camera a: fovy: '180' is not an angle between 0 and 180 degrees",
        ),
        (lambda: [Shot(ModelRig("flat"), fovy=EasedNumber(0, 1))], "fovy: '0' is not a positive number of degrees"),
        (lambda: [Shot(around(1, 0), roll=EasedNumber(0, math.inf))], "roll: 'inf' is not finite"),
        (lambda: [Shot(around(1, 0), shake=Shake(angle=-1))], "angle: '-1' is not a number of at least 0"),
        (lambda: [Shot(around(1, 0), shake=Shake(frequency=0))], "frequency: '0' is not a positive number"),
        (lambda: [Shot(around(1, 0), shake=Shake(seed=-1))], "seed: '-1' is not a whole number of at least 0"),
        (lambda: [Shot(around(1, 0), fit=FramedObject("box", 0.9))], "margin: '0.9' is not a number of at least 1"),
        (lambda: [Shot(around(1, 0), fit="bxo")], "no object 'bxo' (did you mean 'box'?)"),
    ],
)
def test_a_wrong_script_is_refused_with_what_is_right(make: Callable[[], list[Shot]], message: str) -> None:
    with pytest.raises(MjrunError) as caught:
        course(*make())
    assert caught.value.exit_code == 2
    assert message in str(caught.value)


def test_a_camera_that_sees_nothing_is_reported_unless_the_shot_opens_it() -> None:
    text = '<mujoco><visual><global fovy="{}"/></visual><worldbody><geom size="1"/></worldbody></mujoco>'
    for fovy in ("nan", "-1"):
        model = mujoco.MjModel.from_xml_string(text.format(fovy))
        with pytest.raises(ModelError, match=r"^camera video has an empty view: its field of view or near plane is 0"):
            BoundCameraScript(CameraScript("video", (Shot(FreeRig()),)), model, SIZE)
        opened = Shot(FreeRig(), fovy=EasedNumber.still(45.0))
        motion = BoundCameraScript(CameraScript("video", (opened,)), model, SIZE)
        assert motion.pose(save(model, mujoco.MjData(model))).frustum.fovy == pytest.approx(45)
