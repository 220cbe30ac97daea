"""Theorems about the example scenes: what they promise, against closed forms and plain MuJoCo."""

import runpy
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from mjrun.simulation.simulation import Simulation

Vector = NDArray[np.float64]

SCENES = Path(__file__).parents[1] / "scenes"
NAMES = (
    "arm",
    "car",
    "chaotic_pendulum",
    "dominos",
    "free_body",
    "friction_ramp",
    "humanoid",
    "pendulum",
    "pinata",
    "swing",
    "tippe_top",
)
ASPECTS = (16 / 9, 4 / 3)
GRAVITY = 9.81


def load(name: str, keyframe: str | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Loads a scene at its start, or at one of its keyframes, with all derived quantities computed."""
    model = mujoco.MjModel.from_xml_path(str(SCENES / f"{name}.xml"))
    data = mujoco.MjData(model)
    if keyframe is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    mujoco.mj_forward(model, data)
    return model, data


def run(model: mujoco.MjModel, data: mujoco.MjData, until: float) -> Iterator[None]:
    """Steps to the time `until`, and yields after every step."""
    while data.time < until - model.opt.timestep / 2:
        mujoco.mj_step(model, data)
        yield


def advance(model: mujoco.MjModel, data: mujoco.MjData, until: float) -> None:
    """Steps to the time `until`."""
    for _ in run(model, data, until):
        pass


def keyframes(name: str) -> list[str]:
    """Returns the names of the scene's keyframes."""
    model, _ = load(name)
    return [model.key(i).name for i in range(model.nkey)]


def normal_forces(model: mujoco.MjModel, data: mujoco.MjData) -> Vector:
    """Returns the normal force of every contact [N]."""
    wrench = np.zeros(6)
    forces = np.zeros(data.ncon)
    for i in range(data.ncon):
        mujoco.mj_contactForce(model, data, i, wrench)
        forces[i] = wrench[0]
    return forces


def bodies_in_contact(model: mujoco.MjModel, data: mujoco.MjData) -> set[frozenset[str]]:
    """Returns the pairs of bodies that touch."""
    return {
        frozenset(model.body(model.geom_bodyid[g]).name for g in (contact.geom1, contact.geom2))
        for contact in data.contact
    }


@dataclass(frozen=True)
class View:
    """A pinhole camera: its place, its axes (right, up, backwards) in columns, its vertical angle (rad)."""

    position: Vector
    axes: Vector
    angle: float

    def clearance(self, centres: Vector, radii: Vector, aspect: float) -> float:
        """Returns the least distance of the spheres from the four planes of the view, positive inside."""
        x, y, depth = self._coordinates(centres)
        up = np.tan(self.angle / 2)
        side = up * aspect
        inside_height = (depth * up - np.abs(y)) / np.hypot(1, up)
        inside_width = (depth * side - np.abs(x)) / np.hypot(1, side)
        return float(np.min(np.minimum(inside_height, inside_width) - radii))

    def share(self, centres: Vector, radii: Vector, aspect: float) -> float:
        """Returns the fraction of the image's height or width, whichever is larger, that the spheres cover."""
        x, y, depth = self._coordinates(centres)
        half_height = np.tan(self.angle / 2)
        shares = (
            (np.max((v + radii) / depth) - np.min((v - radii) / depth)) / (2 * half)
            for v, half in ((x, half_height * aspect), (y, half_height))
        )
        return float(max(shares))

    def _coordinates(self, points: Vector) -> tuple[Vector, Vector, Vector]:
        x, y, backwards = ((points - self.position) @ self.axes).T
        return x, y, -backwards


def named_view(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> View:
    """Returns the view through a camera of the model."""
    axes = data.cam_xmat[camera].reshape(3, 3)
    return View(data.cam_xpos[camera].copy(), axes, float(np.deg2rad(model.cam_fovy[camera])))


def free_view(model: mujoco.MjModel) -> View:
    """Returns the view through the free camera at the start of a video."""
    look = model.vis.global_
    azimuth, elevation = np.deg2rad(look.azimuth), np.deg2rad(look.elevation)
    forward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    position = model.stat.center - 1.5 * model.stat.extent * forward
    return View(position, np.column_stack((right, np.cross(right, forward), -forward)), float(np.deg2rad(look.fovy)))


def subject(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Vector, Vector]:
    """Returns centres and radii of the bounding spheres of visible geoms that can move."""
    moves = np.array([model.body_weldid[body] != 0 for body in model.geom_bodyid])
    shown = moves & (model.geom_group < 3)
    return data.geom_xpos[shown], model.geom_rbound[shown]


def test_the_folder_holds_exactly_the_scenes_tested_here() -> None:
    assert tuple(sorted(path.stem for path in SCENES.glob("*.xml"))) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_compiles_without_a_warning_under_a_name_of_its_own(
    name: str, recwarn: pytest.WarningsRecorder
) -> None:
    said: list[str] = []
    mujoco.set_mju_user_warning(said.append)
    try:
        model, _ = load(name)
    finally:
        mujoco.set_mju_user_warning(None)
    assert (said, list(recwarn)) == ([], [])
    assert model.names[: model.names.index(b"\0")].decode().replace(" ", "_") == name


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_opens_with_a_short_comment_on_what_to_try(name: str) -> None:
    text = (SCENES / f"{name}.xml").read_text(encoding="utf-8")
    comment, found, _ = text.removeprefix("<!--").partition("-->")
    assert text.startswith("<!--")
    assert found
    assert 2 <= len(comment.strip().splitlines()) <= 5
    assert "Try: " in comment


@pytest.mark.parametrize("name", NAMES)
def test_every_camera_frames_what_moves_in_a_scene_at_each_of_its_starts(name: str) -> None:
    for keyframe in (None, *keyframes(name)):
        model, data = load(name, keyframe)
        cameras = [model.camera(i).name for i in range(model.ncam)]
        assert cameras
        assert all(cameras)
        centres, radii = subject(model, data)
        views = [named_view(model, data, i) for i in range(model.ncam)] + [free_view(model)]
        for view, aspect in product(views, ASPECTS):
            assert view.clearance(centres, radii, aspect) > 0
            assert 0.2 < view.share(centres, radii, aspect) <= 1


@pytest.mark.parametrize("name", NAMES)
def test_keyframes_are_finite_unit_in_rotation_and_within_the_ranges(name: str) -> None:
    model, _ = load(name)
    for key in range(model.nkey):
        qpos = model.key_qpos[key]
        assert np.isfinite(qpos).all()
        assert np.isfinite(model.key_qvel[key]).all()
        for joint in range(model.njnt):
            address = model.jnt_qposadr[joint]
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
                assert np.linalg.norm(qpos[address + 3 : address + 7]) == pytest.approx(1)
            if model.jnt_limited[joint]:
                low, high = model.jnt_range[joint]
                assert low <= qpos[address] <= high
        for actuator in np.flatnonzero(model.actuator_ctrllimited):
            low, high = model.actuator_ctrlrange[actuator]
            assert low <= model.key_ctrl[key, actuator] <= high


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_no_scene_becomes_unstable_in_five_seconds_from_any_of_its_starts(name: str) -> None:
    for keyframe in (None, *keyframes(name)):
        model, data = load(name, keyframe)
        advance(model, data, 5)
        assert data.warning.number.sum() == 0
        assert np.isfinite(data.qpos).all()
        assert np.isfinite(data.qvel).all()


def test_the_box_on_the_swing_never_climbs_above_where_it_was_let_go() -> None:
    model, data = load("swing")
    start = data.body("box_and_sphere").xipos[2]
    heights = [data.body("box_and_sphere").xipos[2] for _ in run(model, data, 5)]
    radius = np.linalg.norm(model.body("box_and_sphere").ipos - model.joint("swing").pos)
    hinge = data.joint("swing").xanchor[2]
    assert max(heights) == pytest.approx(start, abs=0.005)
    assert min(heights) == pytest.approx(hinge - radius, abs=0.005)


def test_the_tippe_top_turns_over_within_seven_seconds() -> None:
    model, data = load("tippe_top", "spinning")
    offset = model.geom("stem").pos[2]
    assert data.geom("stem").xpos[2] - data.geom("ball").xpos[2] == pytest.approx(offset)
    advance(model, data, 7)
    assert data.geom("stem").xpos[2] - data.geom("ball").xpos[2] < -0.9 * offset


def energy_spread(timestep: float, until: float) -> float:
    """Returns the range of the total energy of the kicked chaotic pendulum [J]."""
    model, data = load("chaotic_pendulum", "kick")
    model.opt.timestep = timestep
    return float(np.ptp([data.energy.sum() for _ in run(model, data, until)]))


def test_the_kicked_chaotic_pendulum_keeps_its_energy_within_a_tenth_of_the_kick() -> None:
    model, data = load("chaotic_pendulum", "kick")
    _, kick = data.energy
    assert model.opt.timestep == 0.001
    assert data.joint("root").qvel == 10
    assert energy_spread(0.001, 10) < kick / 10


def test_a_shorter_step_lets_less_energy_leak_from_the_chaotic_pendulum() -> None:
    assert energy_spread(0.00025, 2) < energy_spread(0.001, 2) / 3


@pytest.mark.parametrize("keyframe", [None, "tumble"])
def test_the_free_body_ends_at_rest_on_contacts_that_carry_its_weight(keyframe: str | None) -> None:
    model, data = load("free_body", keyframe)
    advance(model, data, 3)
    weight = model.body("box_and_sphere").mass.item() * GRAVITY
    assert np.abs(data.qvel).max() < 1e-6
    assert normal_forces(model, data).sum() == pytest.approx(weight, rel=1e-6)


def ramp(wood: float | None = None) -> tuple[mujoco.MjModel, mujoco.MjData, Vector, float]:
    """Returns the ramp with this friction of its wooden box, the downhill direction, and the slope [rad]."""
    spec = mujoco.MjSpec.from_file(str(SCENES / "friction_ramp.xml"))
    if wood is not None:
        spec.geom("wood").friction[0] = wood
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    normal = data.geom("ground").xmat.reshape(3, 3)[:, 2]
    slope = float(np.arccos(normal[2]))
    return model, data, (normal[2] * normal - np.array([0, 0, 1])) / np.sin(slope), slope


def test_on_the_ramp_both_boxes_stop_because_their_friction_exceeds_the_slope() -> None:
    model, data, downhill, slope = ramp()
    assert np.tan(slope) == pytest.approx(0.3)
    assert np.tan(slope) < model.geom("wood").friction[0] < model.geom("rubber").friction[0]
    advance(model, data, 0.3)
    early = data.joint("wood").qvel[:3] @ downhill
    advance(model, data, 0.5)
    assert 0 < data.joint("wood").qvel[:3] @ downhill < early
    advance(model, data, 2)
    assert abs(data.joint("wood").qvel[:3] @ downhill) < 0.01
    rubber = data.body("rubber").xpos.copy()
    advance(model, data, 3)
    assert np.linalg.norm(data.body("rubber").xpos - rubber) < 0.005


def test_on_the_ramp_a_slippery_box_accelerates_as_the_closed_form_says() -> None:
    model, data, downhill, slope = ramp(wood=0.1)
    advance(model, data, 0.3)
    early = data.joint("wood").qvel[:3] @ downhill
    advance(model, data, 0.5)
    gained = data.joint("wood").qvel[:3] @ downhill - early
    assert gained / 0.2 == pytest.approx(GRAVITY * (np.sin(slope) - 0.1 * np.cos(slope)), rel=0.02)


def test_the_pinata_feels_the_bat() -> None:
    model, data = load("pinata")
    data.ctrl = 20
    bat_and_box = frozenset({"bat", "box_and_sphere"})
    struck, felt = [], []
    for _ in run(model, data, 3):
        struck.append(bat_and_box in bodies_in_contact(model, data))
        felt.append(np.linalg.norm(data.sensor("accelerometer").data))
    assert any(struck)
    assert max(felt[struck.index(True) :]) > 5 * GRAVITY


def test_the_pinata_left_alone_is_never_struck_and_calms_down_to_its_weight() -> None:
    model, data = load("pinata")
    for _ in run(model, data, 3):
        assert frozenset({"bat", "box_and_sphere"}) not in bodies_in_contact(model, data)
    felt = [np.linalg.norm(data.sensor("accelerometer").data) for _ in run(model, data, 6)]
    assert np.max(felt) < 2 * GRAVITY


def test_the_dominos_throw_the_box_within_three_seconds() -> None:
    model, data = load("dominos")
    start = data.body("box").xpos.copy()
    thrown = [data.time for _ in run(model, data, 3) if np.linalg.norm(data.joint("box").qvel[:3]) > 0.02]
    assert 0.5 < thrown[0] < 3
    assert np.linalg.norm(data.body("box").xpos - start) > 0.2
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (3840, 2160)


def driven(forward: float, turn: float) -> tuple[Vector, float, Vector]:
    """Returns position, angle turned [rad] and wheel torques of the car after three seconds."""
    model, data = load("car")
    data.ctrl = forward, turn
    heading = 0.0
    for _ in run(model, data, 3):
        heading += data.joint("car").qvel[5] * model.opt.timestep
    torques = np.array([data.sensor(wheel).data.item() for wheel in ("left", "right")])
    return data.body("car").xpos.copy(), heading, torques


def test_the_car_drives_straight_on_forward_alone() -> None:
    position, heading, torques = driven(0.5, 0)
    assert position[0] > 0.5
    assert abs(position[1]) < 0.05
    assert abs(heading) < 0.1
    assert torques == pytest.approx(np.array([0.25, 0.25]))


def test_the_car_turns_left_on_turn_and_right_on_its_opposite() -> None:
    position, left, torques = driven(0, 0.2)
    _, right, _ = driven(0, -0.2)
    assert left > 1
    assert right < -1
    assert np.linalg.norm(position[:2]) < 0.3
    assert torques == pytest.approx(np.array([-0.1, 0.1]))


def test_the_small_swing_of_the_pendulum_takes_as_long_as_its_closed_form_says() -> None:
    model, data = load("pendulum", "small")
    amplitude = data.joint("hinge").qpos.item()
    inertia = 1 * 1**2 + 2 / 5 * 1 * 0.1**2
    period = 2 * np.pi * np.sqrt(inertia / (1 * GRAVITY * 1)) * (1 + amplitude**2 / 16)
    samples = np.array([(data.time, data.sensor("angle").data.item()) for _ in run(model, data, 5.5 * period)])
    times, angles = samples.T
    before = np.flatnonzero((angles[:-1] > 0) & (angles[1:] <= 0))
    slopes = (angles[before + 1] - angles[before]) / (times[before + 1] - times[before])
    crossings = times[before] - angles[before] / slopes
    assert np.diff(crossings) == pytest.approx(np.full(5, period), rel=1e-5)


def test_the_pendulum_let_go_level_turns_all_its_height_into_speed() -> None:
    model, data = load("pendulum", "level")
    fastest = max(abs(data.sensor("rate").data.item()) for _ in run(model, data, 2))
    assert fastest == pytest.approx(np.sqrt(2 * GRAVITY / 1.004), rel=1e-4)


def test_half_the_weights_torque_balances_the_pendulum_at_thirty_degrees() -> None:
    model, data = load("pendulum")
    data.joint("hinge").qpos = np.pi / 6
    data.ctrl = GRAVITY / 2
    mujoco.mj_forward(model, data)
    assert data.joint("hinge").qacc == pytest.approx(0, abs=1e-9)


def test_the_arm_has_seven_driven_joints_each_within_its_range() -> None:
    model, _ = load("arm")
    assert (model.nu, model.njnt, model.nv) == (7, 7, 7)
    assert model.actuator_trnid[:, 0].tolist() == list(range(7))
    assert model.actuator_ctrlrange == pytest.approx(model.jnt_range)
    assert model.actuator_forcelimited.all()


@pytest.mark.parametrize("keyframe", ["home", "reach", "upright"])
def test_the_arm_holds_its_poses(keyframe: str) -> None:
    model, data = load("arm", keyframe)
    pose, tool = data.qpos.copy(), data.site("tool").xpos.copy()
    for _ in run(model, data, 2):
        assert np.abs(data.qpos - pose).max() < 1e-3
    assert np.linalg.norm(data.site("tool").xpos - tool) < 1e-3


def test_the_arm_travels_from_home_to_reach_and_stays_there() -> None:
    model, data = load("arm", "home")
    data.ctrl = model.key("reach").ctrl
    advance(model, data, 2)
    assert data.qpos == pytest.approx(model.key("reach").qpos, abs=1e-3)


def test_the_humanoid_is_driven_at_every_joint_and_weighs_what_its_size_suggests() -> None:
    model, _ = load("humanoid")
    assert model.nu == model.njnt - 1 == 22
    assert 25 < model.body_subtreemass[0] < 40
    assert {"stand", "squat", "jump"} <= set(keyframes("humanoid"))


@pytest.mark.parametrize("keyframe", [None, "stand", "squat"])
def test_the_humanoid_starts_with_both_soles_on_the_floor_and_nothing_else_touching(
    keyframe: str | None,
) -> None:
    model, data = load("humanoid", keyframe)
    for foot in ("left_foot", "right_foot"):
        sole = data.geom(foot).xpos[2] - model.geom(foot).size[2]
        assert abs(sole) < 0.001
        assert data.geom(foot).xmat[8] == pytest.approx(1, abs=1e-5)
    allowed = {frozenset({"world", foot}) for foot in ("left_foot", "right_foot")}
    assert bodies_in_contact(model, data) <= allowed
    assert all(contact.dist > -0.001 for contact in data.contact)


@pytest.mark.parametrize("keyframe", [None, "stand", "squat"])
def test_the_humanoid_keeps_its_pose_on_its_feet_and_its_soles_carry_it(keyframe: str | None) -> None:
    model, data = load("humanoid", keyframe)
    head = data.sensor("head_pos").data.copy()
    advance(model, data, 4)
    assert np.linalg.norm(data.sensor("head_pos").data - head) < 0.05
    carried = data.sensor("left_sole").data.item() + data.sensor("right_sole").data.item()
    assert carried == pytest.approx(model.body_subtreemass[0] * GRAVITY, rel=0.01)


def test_the_humanoid_jumps_clear_of_the_floor() -> None:
    model, data = load("humanoid", "jump")
    assert data.ncon == 0
    assert data.geom("left_foot").xpos[2] > 0.1
    rise = data.qvel[2] ** 2 / (2 * GRAVITY)
    com = data.sensor("com").data[2]
    peak = max(data.sensor("com").data[2] for _ in run(model, data, 0.4))
    assert peak == pytest.approx(com + rise, abs=0.01)


def test_the_swing_up_controller_lifts_what_its_motor_cannot() -> None:
    code = runpy.run_path(str(SCENES / "swing_up.py"))
    simulation = Simulation(SCENES / "pendulum.xml", controller=code["SwingUp"](), control_dt=0.01)
    model = simulation.load()
    stepper = simulation.stepper(model)
    assert code["LIMIT"] < 9.81 / 2  # [N m], the weight at the pivot when level
    for step in range(0, 6001, 10):
        stepper.advance(step)
        assert abs(stepper.instant().ctrl[0]) <= code["LIMIT"]
    assert abs(abs(stepper.instant().qpos[0]) - np.pi) < 0.01
    assert abs(stepper.instant().qvel[0]) < 0.01
