"""MCAP exports, read by the reader of another project and compared with MuJoCo."""

import json
import struct
import subprocess
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.errors import SimulationError, UsageError
from mjrun.model.table_column import Column
from mjrun.outputs.exports import FORMATS
from mjrun.outputs.exports.mcap import topic_names
from mjrun.outputs.trace import Trace
from mjrun.timeline import nanoseconds
from tests.cases import mjcf
from tests.formats.mcap import files
from tests.formats.mcap.files import Received

FPS, STEPS_OF_A_FRAME = 25, 20
CAMERAS = ["side", "orbit:lookat=ball,azimuth=80..120,elevation=-60,distance=2"]
TIP = mjcf("tip")


def exported(folder: Path, model: str = TIP, **options: Any) -> Path:
    """Exports half a second of a model."""
    (folder / "model.xml").write_text(model)
    simulation = mjrun.Simulation(folder / "model.xml", duration=0.5, key="spin" if model == TIP else None)
    mjrun.Export(simulation, str(folder / "a.mcap"), fps=FPS, **options).run()
    return folder / "a.mcap"


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An export with a camera."""
    folder = tmp_path_factory.mktemp("export")
    return exported(folder, camera=CAMERAS, size=(160, 119), rate=500)


def instants() -> list[tuple[int, mujoco.MjData]]:
    """Returns the time [ns] and an MjData of each frame, of a bare loop."""
    model = mujoco.MjModel.from_xml_string(TIP)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    found = []
    for step in range(int(0.5 * FPS * STEPS_OF_A_FRAME) + 1):
        if step % STEPS_OF_A_FRAME == 0 and len(found) < 13:
            copy = mujoco.MjData(model)
            mujoco.mj_copyData(copy, model, data)
            mujoco.mj_forward(model, copy)
            found.append((2_000_000 * step, copy))
        mujoco.mj_step(model, data)
    return found


def pose(transform: Any) -> list[float]:
    place, turn = transform.translation, transform.rotation
    return [place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z]


def test_transforms_and_joints_are_those_of_a_bare_loop_at_exact_times(export: Path) -> None:
    truth = instants()
    transforms, joints = files.messages(export, "/tf"), files.messages(export, "/joint_states")
    assert [message.time for message in transforms] == [message.time for message in joints] == [t for t, _ in truth]
    for (time, data), transform, joint in zip(truth, transforms, joints, strict=True):
        read = {each.child_frame_id: each for each in transform.content.transforms}
        assert list(read) == ["arm", "body:2", "ball", "other", "camera/side", "camera/orbit"]
        assert {each.parent_frame_id for each in read.values()} == {"world"}
        assert [pose(each) for each in read.values()][:4] == np.hstack([data.xpos, data.xquat])[1:].tolist()
        assert {each.timestamp.ToNanoseconds() for each in read.values()} == {time}
        states = [[each.position, each.velocity, each.acceleration, each.effort] for each in joint.content.joints]
        assert [each.name for each in joint.content.joints] == ["hinge", "slide"]
        fields = [data.qpos, data.qvel, data.qacc, data.qfrc_actuator]
        assert states == np.stack([field[:2] for field in fields], axis=1).tolist()


def test_messages_are_stored_in_the_order_of_their_times(export: Path) -> None:
    times = files.stored_times(export)
    assert times == sorted(times)
    assert (times[0], times[-1]) == (0, 5 * 10**8)


def test_contacts_are_the_arrows_that_mujoco_draws(export: Path) -> None:
    model = mujoco.MjModel.from_xml_string(TIP)
    option, scene = mujoco.MjvOption(), mujoco.MjvScene(model, 100)
    option.flags[:] = 0
    option.flags[mujoco.mjtVisFlag.mjVIS_CONTACTFORCE] = 1
    compared = 0
    for message, (_, data) in zip(files.messages(export, "/contacts"), instants(), strict=True):
        mujoco.mjv_updateScene(model, data, option, None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL, scene)
        arrows = mujoco.mjtGeom.mjGEOM_ARROW, mujoco.mjtGeom.mjGEOM_ARROW2  # the latter between two moving bodies
        drawn = [geom for geom in scene.geoms[: scene.ngeom] if geom.type in arrows and geom.size[2] > 1e-6]
        (entity,) = message.content.entities
        assert entity.frame_id == "world"
        for arrow, geom in zip(entity.arrows, drawn, strict=True):
            place, turn, tip = arrow.pose.position, arrow.pose.orientation, np.empty(3)
            mujoco.mju_rotVecQuat(tip, np.array([1.0, 0, 0]), np.array([turn.w, turn.x, turn.y, turn.z]))
            assert [place.x, place.y, place.z] == pytest.approx(geom.pos, abs=1e-6)
            assert tip == pytest.approx(geom.mat[:, 2], abs=1e-5)
            assert arrow.shaft_length + arrow.head_length == pytest.approx(geom.size[2], rel=1e-5)
            assert arrow.shaft_diameter == pytest.approx(2 * geom.size[0], rel=1e-5)
            compared += 1
    assert compared > 5


ROPE = """
<mujoco><worldbody><site name="a" pos="0 0 1"/><body pos=".5 0 1"><freejoint/><geom size=".05"/><site name="b"/></body>
</worldbody><tendon><spatial width=".01"><site site="a"/><site site="b"/></spatial></tendon></mujoco>
"""


def test_a_rope_follows_its_ends(tmp_path: Path) -> None:
    path = exported(tmp_path, ROPE)
    bodies = [message.content.transforms[0].translation for message in files.messages(path, "/tf")]
    ropes = [message.content.entities[0].lines[0].points for message in files.messages(path, "/scene/shapes")]
    for place, points in zip(bodies, ropes, strict=True):
        ends = sorted([point.x, point.y, point.z] for point in points)
        assert ends[0] == pytest.approx([0, 0, 1], abs=1e-6)
        assert ends[-1] == pytest.approx([place.x, place.y, place.z], abs=1e-6)
    assert bodies[-1].z < 0.5


def test_the_table_of_contacts_has_their_geoms_and_forces(export: Path) -> None:
    compared = 0
    for message, (_, data) in zip(files.messages(export, "/contacts/table"), instants(), strict=True):
        for index, (row, contact) in enumerate(zip(message.content.rows, data.contact, strict=True)):
            force = np.empty(6)
            mujoco.mj_contactForce(data.model, data, index, force)
            named = [data.model.geom(geom).name or f"geom:{geom}" for geom in contact.geom]
            assert [row.geom1, row.geom2] == named
            assert [row.force_normal, row.force_tangent1, row.force_tangent2] == force[:3].tolist()
            assert [row.dist, row.pos_x, row.pos_y, row.pos_z] == [contact.dist, *contact.pos]
            compared += 1
    assert compared > 5


def test_measured_values_are_those_of_a_trace_with_their_units(export: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(export.parent / "model.xml", duration=0.5, key="spin")
    blocks: list[np.ndarray] = []
    names: list[Column] = []
    trace = Trace(simulation, str(tmp_path / "t.csv"), rows_to=lambda columns: names.extend(columns) or blocks.append)
    trace.run()
    values, units = np.concatenate(blocks), {column.name: column.unit for column in names}
    received: dict[str, list[Received]] = {}
    for message in files.messages(export):
        if message.topic.startswith("/trace/"):
            received.setdefault(message.topic, []).append(message)
    assert list(received) == ["/trace/qpos", "/trace/qvel", "/trace/ctrl", "/trace/energy", "/trace/contact"]
    compared = {"time"}
    for rows in received.values():
        assert [row.time for row in rows] == [nanoseconds(step * Fraction(1, 500)) for step in range(251)]
        for field in rows[0].content.DESCRIPTOR.fields:
            column = rows[0].metadata[f"column/{field.name}"]
            read = np.array([getattr(row.content, field.name) for row in rows])
            expected = np.ascontiguousarray(values[:, [column.name for column in names].index(column)])
            assert read.tobytes() == expected.tobytes()
            assert rows[0].metadata[f"unit/{field.name}"] == units[column]
            compared.add(column)
    assert compared == {*units}


def glb(content: bytes) -> dict[str, Any]:
    """Returns the JSON of a GLB."""
    magic, _, size, length, _ = struct.unpack_from("<4sIIII", content)
    assert (magic, size) == (b"glTF", len(content))
    return json.loads(content[20 : 20 + length])


def matrix(position: Sequence[float], quaternion: Sequence[float]) -> np.ndarray:
    """Returns a transform `(4, 4)`; the quaternion begins with w."""
    rotation, made = np.empty(9), np.eye(4)
    mujoco.mju_quat2Mat(rotation, np.array(quaternion, float))
    made[:3, :3], made[:3, 3] = rotation.reshape(3, 3), position
    return made


def transform_of(node: dict[str, Any]) -> np.ndarray:
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    return matrix(node.get("translation", [0, 0, 0]), [w, x, y, z])


def test_the_geoms_of_the_models_are_where_mujoco_places_them(export: Path) -> None:
    (scene,) = files.messages(export, "/scene")
    assert scene.time == 0
    models = {entity.frame_id: glb(entity.models[0].data) for entity in scene.content.entities}
    assert set(models) == {"world", "arm", "body:2", "ball", "other"}
    y_up_to_z_up = matrix([0, 0, 0], [np.sqrt(0.5), np.sqrt(0.5), 0, 0])  # how viewers turn a glTF
    compared = set[int]()
    for message, (_, data) in zip(files.messages(export, "/tf"), instants(), strict=True):
        poses = {each.child_frame_id: pose(each) for each in message.content.transforms}
        for frame, model in models.items():
            root, *parts = model["nodes"]
            place = poses.get(frame, [0, 0, 0, 1, 0, 0, 0])
            above = matrix(place[:3], place[3:]) @ y_up_to_z_up @ transform_of(root)
            for part in (part for part in parts if part["extras"]["kind"] == "geom"):
                index, found = part["extras"]["id"], above @ transform_of(part)
                assert found[:3, 3] == pytest.approx(data.geom_xpos[index], abs=1e-6)
                assert found[:3, :3].ravel() == pytest.approx(data.geom_xmat[index], abs=1e-6)
                compared.add(index)
    assert compared == {0, 1, 2, 3, 4}
    arm = models["arm"]
    (accessor,) = (each for each in arm["accessors"] if "min" in each and each["type"] == "VEC3")
    assert np.array(accessor["max"]) * arm["nodes"][1]["scale"] == pytest.approx([0.2, 0.1, 0.05])
    assert not {"cameras", "animations", "extensions"} & {*arm}


def test_the_facts_of_the_manifest_are_metadata(export: Path) -> None:
    facts = files.metadata(export)["mjrun"]
    assert facts["mjrun"] == mjrun.__version__
    assert json.loads(facts["model"])["path"].endswith("model.xml")
    assert json.loads(facts["options"])["fps"] == FPS


def frames_of(stream: bytes, width: int, height: int) -> np.ndarray:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "h264", "-i", "-", "-fps_mode", "passthrough"]
    done = subprocess.run(
        [*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], input=stream, stdout=subprocess.PIPE, check=True
    )
    return np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3)


@pytest.mark.gl
@pytest.mark.parametrize("camera", ["side", "orbit"])
def test_the_green_ball_is_where_its_transform_the_camera_s_and_the_calibration_place_it(
    export: Path, camera: str
) -> None:
    video = files.messages(export, f"/camera/{camera}/video")
    calibrations = files.messages(export, f"/camera/{camera}/calibration")
    times = [message.time for message in video]
    assert times == [message.time for message in calibrations] == [time for time, _ in instants()]
    assert {message.content.frame_id for message in (*video, *calibrations)} == {f"camera/{camera}"}
    pictures = frames_of(b"".join(message.content.data for message in video), 160, 120)
    for picture, seen, poses in zip(pictures, calibrations, files.messages(export, "/tf"), strict=True):
        frames = {each.child_frame_id: np.array(pose(each)) for each in poses.content.transforms}
        eye, rotation = frames[f"camera/{camera}"], np.empty(9)
        mujoco.mju_quat2Mat(rotation, eye[3:])
        local = rotation.reshape(3, 3).T @ (frames["ball"][:3] - eye[:3])
        u, v, w = np.array(seen.content.P).reshape(3, 4) @ [*local, 1]
        assert (seen.content.width, seen.content.height) == (160, 120)
        green = (picture[..., 1] > 90) & (picture[..., 0] < 70) & (picture[..., 2] < 70)
        rows, columns = np.nonzero(green)
        assert len(rows) > 20
        assert (columns.mean(), rows.mean()) == pytest.approx((u / w, v / w), abs=2)


@pytest.mark.gl
@pytest.mark.parametrize(("images", "magic"), [("jpeg", b"\xff\xd8"), ("png", b"\x89PNG")])
def test_images_may_be_separate(tmp_path: Path, images: str, magic: bytes) -> None:
    path = exported(tmp_path, camera=["side"], size=(48, 32), images=images, probe=["energy"], rate=50)
    received = files.messages(path, "/camera/side/image")
    assert len(received) == 13
    assert {(message.content.format, message.content.data[: len(magic)]) for message in received} == {(images, magic)}
    assert len(files.messages(path, "/trace/energy")) == 26
    assert not files.messages(path, "/trace/qpos")


HOSTILE = """
<mujoco><worldbody>
  <body name="a&#10;b"><freejoint name="&#27;[31m"/><geom size=".1"/></body>
  <body name="a\\nb" pos="0 0 1"><joint name="&#x202e;" type="slide"/><geom size=".1"/></body>
  <body name="body:4" pos="0 0 2"><geom size=".1"/></body><body pos="0 0 3"><geom size=".1"/></body>
  <body name="camera/x" pos="0 0 4"/><camera name="x"/><camera name="é/../x y"/>
</worldbody></mujoco>
"""


def test_hostile_names_become_distinct_frames_fields_and_topics(tmp_path: Path) -> None:
    path = exported(tmp_path, HOSTILE)
    received = files.messages(path)
    frames = [each.child_frame_id for each in files.messages(path, "/tf")[0].content.transforms]
    assert frames == ["a\\nb", "a\\nb_2", "body:4", "body:4_2", "camera/x"]
    assert all(message.topic.isascii() for message in received)
    assert files.messages(path, "/joint_states")[0].content.joints[0].name.isprintable()
    fields = {
        field.name
        for message in received
        if message.topic == "/trace/qpos"
        for field in message.content.DESCRIPTOR.fields
    }
    assert all(field.isidentifier() and field.isascii() for field in fields)


def test_cameras_have_distinct_topics_of_plain_letters() -> None:
    names = ["orbit:azimuth=1", "orbit:azimuth=2", "é/../x y", "\x1b", "0"]
    assert topic_names(names) == ["orbit", "orbit_2", "x_y", "camera", "0"]


def test_a_model_that_holds_nothing_makes_a_valid_file(tmp_path: Path) -> None:
    path = exported(tmp_path, '<mujoco><statistic meanmass="0"/></mujoco>')
    assert files.summary(path).statistics.message_count > 0


def test_an_unstable_simulation_leaves_no_file_unless_part_of_it_is_kept(tmp_path: Path, exploding: Path) -> None:
    simulation = mjrun.Simulation(exploding, key="fast", duration=2)
    for keep in (False, True):
        job = mjrun.Export(simulation, str(tmp_path / "a.mcap"), keep_partial=keep)
        with pytest.raises(SimulationError):
            job.run()
        assert (tmp_path / "a.mcap").exists() == keep
    kept = files.messages(tmp_path / "a.mcap", "/trace/qpos")
    assert 0 < kept[-1].time < 2 * 10**9


def test_an_option_that_the_format_does_not_support_is_refused(tmp_path: Path, swing: Path) -> None:
    assert FORMATS["mcap"].options == {"probe", "rate", "images"}
    with pytest.raises(UsageError, match=r"probe does not apply to glb\nit applies to mcap"):
        mjrun.Export(mjrun.Simulation(swing), str(tmp_path / "a.glb"), probe=["energy"]).run()
    with pytest.raises(UsageError, match=r"images requires camera"):
        mjrun.Export(mjrun.Simulation(swing), str(tmp_path / "a.mcap"), images="png").run()
