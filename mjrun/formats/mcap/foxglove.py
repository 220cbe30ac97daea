"""Messages of Foxglove's schemas, serialized: transforms, joints, models, arrows, cameras and their images.

Positions are in metres, quaternions `(qw, qx, qy, qz)`, times in nanoseconds. Cameras have the axes of OpenCV: x right,
y down, z forward. https://docs.foxglove.dev/docs/sdk/schemas
"""

from collections.abc import Mapping, Sequence

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration as CalibrationMessage  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate  # pyright: ignore[reportMissingImports]
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3  # pyright: ignore[reportMissingImports]
from google.protobuf.timestamp_pb2 import Timestamp

from mjrun.dataclass import dataclass
from mjrun.formats.calibration_writer import centered_matrix
from mjrun.formats.mcap.writer import Schema
from mjrun.model.rendered_view import CameraCalibration
from mjrun.scene_graph.soft_shapes import Segments, TriangleSurface

TRANSFORMS, JOINTS, SCENE = Schema.of(FrameTransforms), Schema.of(JointStates), Schema.of(SceneUpdate)
CALIBRATION, VIDEO, IMAGE = Schema.of(CalibrationMessage), Schema.of(CompressedVideo), Schema.of(CompressedImage)
SECOND = 10**9  # [ns]
GLB = "model/gltf-binary"
LINE_LIST = LinePrimitive.LINE_LIST  # each two points are the ends of a line
HEAD_SHARE, HEAD_WIDTH = 0.3, 2  # length of an arrow's head in its length, and its width in shaft diameters


class TransformMessages:
    """Messages with the poses of frames in one parent frame."""

    def __init__(self, parent: str, frames: Sequence[str]) -> None:
        self._message = FrameTransforms()
        self._parts: list[tuple[Timestamp, Vector3, Quaternion]] = []
        for frame in frames:
            transform = self._message.transforms.add(parent_frame_id=parent, child_frame_id=frame)
            self._parts.append((transform.timestamp, transform.translation, transform.rotation))

    def encode(self, time: int, positions: np.ndarray, quaternions: np.ndarray) -> bytes:
        """Serializes the poses at a time: `positions` `(n, 3)` and `quaternions` `(n, 4)`."""
        seconds, nanos = divmod(time, SECOND)
        rows = zip(self._parts, positions.tolist(), quaternions.tolist(), strict=True)
        for (timestamp, translation, rotation), position, turn in rows:
            timestamp.seconds, timestamp.nanos = seconds, nanos
            translation.x, translation.y, translation.z = position
            rotation.w, rotation.x, rotation.y, rotation.z = turn
        return self._message.SerializeToString()


class JointMessages:
    """Messages with the states of joints of one degree of freedom."""

    def __init__(self, names: Sequence[str]) -> None:
        self._message = JointStates()
        for name in names:
            self._message.joints.add(name=name)

    def encode(
        self,
        time: int,
        positions: np.ndarray,
        velocities: np.ndarray,
        accelerations: np.ndarray,
        efforts: np.ndarray,
    ) -> bytes:
        """Serializes the states at a time, each `(n,)` in [rad] or [m], and [N·m] or [N]."""
        _set_time(self._message.timestamp, time)
        states = np.stack([positions, velocities, accelerations, efforts], axis=1).tolist()
        for joint, (position, velocity, acceleration, effort) in zip(self._message.joints, states, strict=True):
            joint.position, joint.velocity = position, velocity
            joint.acceleration, joint.effort = acceleration, effort
        return self._message.SerializeToString()


def scene(time: int, models: Mapping[str, bytes]) -> bytes:
    """Serializes a scene of models that move with their frames.

    Args:
      models: a GLB for each frame. Its y axis is up: viewers turn it so that it becomes the z axis of the frame.
    """
    message = SceneUpdate()
    for frame, content in models.items():
        entity = message.entities.add(frame_id=frame, id=frame, frame_locked=True)
        _set_time(entity.timestamp, time)
        model = entity.models.add(data=content, media_type=GLB)
        _set(model.scale, x=1, y=1, z=1)
        _set(model.pose.position, x=0, y=0, z=0)
        _set(model.pose.orientation, w=1, x=0, y=0, z=0)
        _set(model.color, r=1, g=1, b=1, a=1)
    return message.SerializeToString()


@dataclass(frozen=True)
class ArrowStyle:
    """The appearance of arrows.

    Attributes:
      diameter: diameter of the shaft [m].
      color: red, green, blue and opacity, from 0 to 1.
    """

    diameter: float
    color: Sequence[float]


def arrows(time: int, frame: str, name: str, starts: np.ndarray, vectors: np.ndarray, style: ArrowStyle) -> bytes:
    """Serializes arrows that replace those of the same `name` from before.

    Args:
      starts, vectors: `(n, 3)` in `frame` [m]; no vector is zero.
    """
    message = SceneUpdate()
    entity = message.entities.add(frame_id=frame, id=name)
    _set_time(entity.timestamp, time)
    lengths = np.linalg.norm(vectors, axis=1)
    turns = _from_x_axis(vectors / lengths[:, None])
    red, green, blue, opacity = style.color
    for (x, y, z), (qw, qx, qy, qz), length in zip(starts.tolist(), turns.tolist(), lengths.tolist(), strict=True):
        arrow = entity.arrows.add(
            shaft_length=(1 - HEAD_SHARE) * length,
            shaft_diameter=style.diameter,
            head_length=HEAD_SHARE * length,
            head_diameter=HEAD_WIDTH * style.diameter,
        )
        _set(arrow.pose.position, x=x, y=y, z=z)
        _set(arrow.pose.orientation, w=qw, x=qx, y=qy, z=qz)
        _set(arrow.color, r=red, g=green, b=blue, a=opacity)
    return message.SerializeToString()


def shapes(time: int, frame: str, name: str, parts: Sequence[TriangleSurface | Segments]) -> bytes:
    """Serializes surfaces and segments that replace those of the same `name` from before."""
    message = SceneUpdate()
    entity = message.entities.add(frame_id=frame, id=name)
    _set_time(entity.timestamp, time)
    for part in parts:
        if isinstance(part, TriangleSurface):
            written = entity.triangles.add(indices=part.faces.ravel().tolist())
            points = part.points
        else:
            written = entity.lines.add(type=LINE_LIST, thickness=part.width)
            points = part.ends.reshape(-1, 3)
        red, green, blue, opacity = part.rgba
        _set(written.color, r=red, g=green, b=blue, a=opacity)
        _set(written.pose.orientation, w=1)
        for x, y, z in points.tolist():
            written.points.add(x=x, y=y, z=z)
    return message.SerializeToString()


def calibration(time: int, frame: str, lens: CameraCalibration, size: tuple[int, int]) -> bytes:
    """Serializes the calibration of a perspective camera whose images have this `size`, padding included [pixels]."""
    matrix = centered_matrix(lens)
    message = CalibrationMessage(frame_id=frame, width=size[0], height=size[1], distortion_model="plumb_bob")
    _set_time(message.timestamp, time)
    message.D[:] = [0.0] * 5
    message.K[:] = matrix.ravel().tolist()
    message.R[:] = np.eye(3).ravel().tolist()
    message.P[:] = np.column_stack([matrix, np.zeros(3)]).ravel().tolist()
    return message.SerializeToString()


def video_frame(time: int, frame: str, access_unit: bytes) -> bytes:
    """Serializes the access unit in H.264 of a frame of a video, seen from the camera `frame`."""
    message = CompressedVideo(frame_id=frame, data=access_unit, format="h264")
    _set_time(message.timestamp, time)
    return message.SerializeToString()


def image(time: int, frame: str, content: bytes, format: str) -> bytes:  # noqa: A002  (the field's name)
    """Serializes an encoded image, `jpeg`, `png` or `webp`, seen from the camera `frame`."""
    message = CompressedImage(frame_id=frame, data=content, format=format)
    _set_time(message.timestamp, time)
    return message.SerializeToString()


def _from_x_axis(directions: np.ndarray) -> np.ndarray:
    """Returns the quaternions `(n, 4)` that turn the x axis to unit vectors `(n, 3)` on the shortest way."""
    x, y, z = directions.T
    turns = np.stack([1 + x, np.zeros_like(x), -z, y], axis=1)
    lengths = np.linalg.norm(turns, axis=1, keepdims=True)
    return np.where(lengths > 1e-9, turns / np.maximum(lengths, 1e-9), [0, 0, 0, 1])


def _set_time(field: Timestamp, time: int) -> None:
    field.seconds, field.nanos = divmod(time, SECOND)


def _set(field: object, **values: float) -> None:
    for name, value in values.items():
        setattr(field, name, value)
