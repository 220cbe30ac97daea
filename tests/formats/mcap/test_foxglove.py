"""Messages of Foxglove's schemas, parsed by protobuf and compared with MuJoCo."""

from typing import Any

import mujoco
import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.formats import mcap
from mjrun.formats.mcap import Schema
from mjrun.model.camera_images import CameraCalibration
from mjrun.scene_graph.meshes import LineSegments, TriangleSurface
from tests.formats.mcap.files import decoded

LATE = 3 * 10**9 + 123_456_789


def time_of(stamp: Any) -> int:
    return stamp.ToNanoseconds()


def test_transforms_have_their_time_and_every_digit() -> None:
    messages = mcap.TransformMessages("world", ["a", "b"])
    for time in (LATE, 0):  # a message does not keep the time of the one before
        positions, turns = np.random.default_rng(time).random((2, 3)), np.random.default_rng(time).random((2, 4))
        read = decoded(mcap.TRANSFORMS, messages.encode(time, positions, turns)).transforms
        assert [(each.parent_frame_id, each.child_frame_id) for each in read] == [("world", "a"), ("world", "b")]
        assert [time_of(each.timestamp) for each in read] == [time, time]
        assert [each.HasField("timestamp") for each in read] == [True, True]
        places = [each.translation for each in read]
        assert [[place.x, place.y, place.z] for place in places] == positions.tolist()
        assert [[q.w, q.x, q.y, q.z] for q in (each.rotation for each in read)] == turns.tolist()


def test_joints_have_position_velocity_acceleration_and_effort() -> None:
    messages = mcap.JointMessages(["knee", "slide"])
    states = np.array([[1.0, 2], [3, 4], [5, 6], [7, 8]])
    read = decoded(mcap.JOINTS, messages.encode(LATE, *states))
    assert time_of(read.timestamp) == LATE
    values = [[joint.position, joint.velocity, joint.acceleration, joint.effort] for joint in read.joints]
    assert [joint.name for joint in read.joints] == ["knee", "slide"]
    assert values == states.T.tolist()


def test_a_scene_has_a_model_that_moves_with_each_frame_and_stays() -> None:
    entity, other = decoded(mcap.SCENE, mcap.scene(0, {"torso": b"glTF", "foot": b"glTF2"})).entities
    assert (entity.frame_id, entity.id, entity.frame_locked) == ("torso", "torso", True)
    assert entity.lifetime.ToNanoseconds() == 0  # for ever
    (model,) = entity.models
    assert (model.data, model.media_type) == (b"glTF", "model/gltf-binary")
    assert [model.scale.x, model.scale.y, model.scale.z] == [1, 1, 1]
    assert model.pose.orientation.w == 1
    assert other.models[0].data == b"glTF2"


@settings(max_examples=30)
@given(st.lists(st.tuples(*3 * [st.floats(-5, 5)]).filter(lambda v: np.linalg.norm(v) > 1e-3), max_size=4))
def test_an_arrow_points_along_its_vector_and_is_as_long(vectors: list[tuple[float, float, float]]) -> None:
    style = mcap.ArrowStyle(0.02, [0.1, 0.2, 0.3, 0.4])
    array = np.array([*vectors, (-2, 0, 0), (-1, 1e-12, 0)])
    read = decoded(mcap.SCENE, mcap.arrows(LATE, "world", "contacts", array + 1, array, style))
    (entity,) = read.entities
    assert (entity.frame_id, entity.id, time_of(entity.timestamp)) == ("world", "contacts", LATE)
    for arrow, vector in zip(entity.arrows, array, strict=True):
        turn, tip = arrow.pose.orientation, np.empty(3)
        length = arrow.shaft_length + arrow.head_length
        mujoco.mju_rotVecQuat(tip, np.array([length, 0, 0]), np.array([turn.w, turn.x, turn.y, turn.z]))
        assert tip == pytest.approx(vector, abs=1e-8)
        assert [arrow.pose.position.x, arrow.pose.position.y, arrow.pose.position.z] == (vector + 1).tolist()
        assert arrow.shaft_diameter < arrow.head_diameter
        assert [arrow.color.r, arrow.color.g, arrow.color.b, arrow.color.a] == style.color


def test_no_arrows_replace_those_from_before() -> None:
    none = np.empty((0, 3))
    style = mcap.ArrowStyle(0.02, [1, 1, 1, 1])
    read = decoded(mcap.SCENE, mcap.arrows(0, "world", "contacts", none, none, style))
    assert [entity.id for entity in read.entities] == ["contacts"]
    assert not read.entities[0].arrows


def test_shapes_have_their_points_and_colours() -> None:
    surface = TriangleSurface(np.eye(4, 3), np.array([[0, 1, 2], [0, 2, 3]]), (1, 0, 0, 1))
    segments = LineSegments(np.arange(12.0).reshape(2, 2, 3), 0.01, (0, 0.5, 0, 1))
    content = mcap.shapes(LATE, "world", "shapes", [surface, segments])
    (entity,) = decoded(mcap.SCENE, content).entities
    assert (entity.id, entity.frame_id, time_of(entity.timestamp)) == ("shapes", "world", LATE)
    (triangles,), (lines,) = entity.triangles, entity.lines
    assert [[point.x, point.y, point.z] for point in triangles.points] == np.eye(4, 3).tolist()
    assert list(triangles.indices) == [0, 1, 2, 0, 2, 3]
    assert [[point.x, point.y, point.z] for point in lines.points] == np.arange(12.0).reshape(4, 3).tolist()
    assert (lines.thickness, lines.DESCRIPTOR.enum_types_by_name["Type"].values_by_number[lines.type].name) == (
        0.01,
        "LINE_LIST",
    )
    assert (triangles.color.r, lines.color.g, triangles.pose.orientation.w) == (1, 0.5, 1)


def test_a_calibration_projects_points_to_the_pixels_that_render_them() -> None:
    lens = CameraCalibration((64, 47), 50.0, 51.0, 31.0, 24.0, np.eye(4), 0.01, 50.0)
    read = decoded(mcap.CALIBRATION, mcap.calibration(LATE, "camera/side", lens, (64, 48)))
    assert (read.width, read.height, read.frame_id, time_of(read.timestamp)) == (64, 48, "camera/side", LATE)
    assert (read.distortion_model, list(read.D)) == ("plumb_bob", [0.0] * 5)
    assert np.array(read.R).reshape(3, 3).tolist() == np.eye(3).tolist()
    point = np.array([0.2, -0.1, 1.5])
    u, v, w = np.array(read.P).reshape(3, 4) @ [*point, 1]
    # The centre of the first pixel is (0, 0) in OpenCV, and (0.5, 0.5) in mjrun.
    assert [u / w + 0.5, v / w + 0.5] == pytest.approx(lens.project(point[None])[0, :2])
    assert np.array(read.K).reshape(3, 3) @ point == pytest.approx([u, v, w])


def test_frames_of_videos_and_images_name_their_camera_and_format() -> None:
    video = decoded(mcap.VIDEO, mcap.video_frame(LATE, "camera/side", b"\0\0\0\1\x09"))
    assert (video.frame_id, video.format, video.data) == ("camera/side", "h264", b"\0\0\0\1\x09")
    assert time_of(video.timestamp) == LATE
    picture = decoded(mcap.IMAGE, mcap.image(LATE, "camera/side", b"\xff\xd8", "jpeg"))
    assert (picture.frame_id, picture.format, picture.data) == ("camera/side", "jpeg", b"\xff\xd8")
    assert time_of(picture.timestamp) == LATE


@pytest.mark.parametrize("schema", [mcap.SCENE, mcap.TRANSFORMS, mcap.JOINTS, mcap.VIDEO])
def test_a_schema_is_complete_and_each_file_is_in_it_once(schema: Schema) -> None:
    described = FileDescriptorSet.FromString(schema.files).file
    available = [file.name for file in described]
    assert len(set(available)) == len(available)
    assert {name for file in described for name in file.dependency} <= set(available)
