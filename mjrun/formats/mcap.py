"""MCAP: a log of messages on topics, each with a time in nanoseconds, with protobuf schemas (https://mcap.dev).

Messages hold measured values, with a number or a text for each column, or follow Foxglove's schemas: transforms,
joints, models, arrows, cameras and their images. Positions are in metres, quaternions
`(qw, qx, qy, qz)`, times in nanoseconds. Cameras have the axes of OpenCV: x right, y down, z forward.
https://docs.foxglove.dev/docs/sdk/schemas
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO

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
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.well_known import MessageEncoding, SchemaEncoding  # pyright: ignore[reportMissingImports]
from mcap.writer import Writer  # pyright: ignore[reportMissingImports]

from mjrun.dataclass import dataclass
from mjrun.errors import clean
from mjrun.formats.calibration_writer import centered_matrix
from mjrun.model.camera_images import CameraCalibration
from mjrun.model.names import distinct
from mjrun.model.table_column import Column
from mjrun.scene_graph.meshes import LineSegments, TriangleSurface
from mjrun.version import __version__

FIXED64, LENGTH = 1, 2  # wire types of a double, and of a text or a message
MOST = 4000  # fields in a message; protobuf's own limit is 64 KiB, with some bytes for each field
SECOND = 10**9  # [ns]
GLB = "model/gltf-binary"
LINE_LIST = LinePrimitive.LINE_LIST  # each two points are the ends of a line
HEAD_SHARE, HEAD_WIDTH = 0.3, 2  # length of an arrow's head in its length, and its width in shaft diameters


@dataclass(frozen=True)
class Schema:
    """The type of the messages of a channel.

    Attributes:
      name: full name of the type: `foxglove.SceneUpdate`.
      files: a serialized FileDescriptorSet with the file of the type and those that it imports.
    """

    name: str
    files: bytes

    @classmethod
    def of(cls, message: type[Message]) -> "Schema":
        """Returns the schema of a generated class."""
        files = FileDescriptorSet()
        waiting, known = [message.DESCRIPTOR.file], set[str]()
        while waiting:
            file = waiting.pop()
            if file.name not in known:
                known.add(file.name)
                file.CopyToProto(files.file.add())
                waiting += file.dependencies
        return cls(message.DESCRIPTOR.full_name, files.SerializeToString(deterministic=True))


class McapWriter:
    """A writer that streams messages to an open file, which may be a pipe.

    Messages may arrive in any order; those that arrive one after another are compressed together in chunks of a
    megabyte. The same messages give the same bytes. Methods raise OSError when the file cannot be written.

    Args:
      facts: texts about the making of the file, stored as the metadata record `mjrun`.

    Attributes:
      messages: the number of messages so far.
    """

    def __init__(self, file: BinaryIO, facts: Mapping[str, str]) -> None:
        counting: Any = _CountingFile(file)
        self._writer = Writer(counting, enable_data_crcs=True)
        self._schemas: dict[Schema, int] = {}
        self._sequences: dict[int, int] = {}
        self._writer.start(library=f"mjrun {__version__}")
        self._writer.add_metadata("mjrun", dict(facts))

    @property
    def messages(self) -> int:
        return sum(self._sequences.values())

    def add_channel(self, topic: str, schema: Schema, metadata: Mapping[str, str] | None = None) -> int:
        """Adds a channel for messages of one type, and returns its number."""
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema.name, SchemaEncoding.Protobuf, schema.files)
        facts = dict(metadata or {})
        channel = self._writer.register_channel(topic, MessageEncoding.Protobuf, self._schemas[schema], facts)
        self._sequences[channel] = 0
        return channel

    def write(self, channel: int, time: int, message: bytes) -> None:
        """Adds a serialized message at a time [ns]."""
        self._writer.add_message(channel, time, message, publish_time=time, sequence=self._sequences[channel])
        self._sequences[channel] += 1

    def attach(self, name: str, media_type: str, content: bytes) -> None:
        """Adds a file."""
        self._writer.add_attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=content)

    def finish(self) -> None:
        """Writes the index, without which readers refuse the file."""
        self._writer.finish()


class _CountingFile:
    """A file that knows its position, even if it is a pipe."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._position = file, 0

    def write(self, content: bytes) -> None:
        self._file.write(content)
        self._position += len(content)

    def tell(self) -> int:
        return self._position


class NumericMessages:
    """Messages with the values of columns of one group: `qpos` of `qpos/left_knee` and `qpos/torso/x`.

    Args:
      columns: columns of the group, from one to `MOST`.

    Attributes:
      schema: the type `mjrun.Qpos`, whose fields are doubles called `left_knee` and `torso_x`.
      metadata: the column and the unit of each field: `column/left_knee`, `unit/left_knee`.
    """

    def __init__(self, group: str, columns: Sequence[Column]) -> None:
        fields = field_names(group, [column.name.partition("/")[2] or column.name for column in columns])
        self.schema = _schema(group, fields, columns)
        self.metadata = _metadata(fields, columns)
        self._fields = _DoubleFields(range(1, len(fields) + 1))

    def encode(self, values: np.ndarray) -> list[bytes]:
        """Serializes the rows `values` `(n, columns)` float64."""
        return self._fields.encode(values)


class TableMessages:
    """Messages with any number of rows of a table, whose columns are numbers and texts.

    Attributes:
      schema: a type with the repeated field `rows`, whose type has a field for each column.
      metadata: the column and the unit of each field of a row.
    """

    def __init__(self, name: str, columns: Sequence[Column]) -> None:
        fields = field_names(name, [column.name for column in columns])
        self.schema = _schema(name, fields, columns, repeated="rows")
        self.metadata = _metadata(fields, columns)
        self._numeric = [index for index, column in enumerate(columns) if not column.labels]
        self._numbers = _DoubleFields([index + 1 for index in self._numeric])
        self._texts = {
            index: [_delimited(index + 1, label.encode("utf-8", "replace")) for label in map(clean, column.labels)]
            for index, column in enumerate(columns)
            if column.labels
        }

    def encode(self, values: np.ndarray) -> bytes:
        """Serializes one message with the rows `values` `(n, columns)` float64; texts are indices, −1 for none."""
        rows: list[bytes] = []
        for row, numbers in zip(values, self._numbers.encode(values[:, self._numeric]), strict=True):
            texts = (encoded[int(row[index])] for index, encoded in self._texts.items() if row[index] >= 0)
            rows.append(_delimited(1, b"".join([*texts, numbers])))
        return b"".join(rows)


class _DoubleFields:
    """The doubles of a message, with these numbers of fields."""

    def __init__(self, numbers: Sequence[int]) -> None:
        tags = [_varint(number << 3 | FIXED64) for number in numbers]
        self._template = np.frombuffer(b"".join(tag + bytes(8) for tag in tags), np.uint8)
        ends = np.cumsum([len(tag) + 8 for tag in tags])
        self._places = ends[:, None] + np.arange(-8, 0)  # of the bytes of each number

    def encode(self, values: np.ndarray) -> list[bytes]:
        """Serializes each row of `values` `(n, numbers)`."""
        messages = np.tile(self._template, (len(values), 1))
        content = np.ascontiguousarray(values, "<f8").view(np.uint8)
        messages[:, self._places] = content.reshape(*values.shape, 8)
        return [message.tobytes() for message in messages]


def groups(columns: Sequence[Column]) -> dict[str, list[int]]:
    """Returns the positions of the columns of each group, which is the first part of their names.

    A group of more than `MOST` columns is divided: `qpos`, `qpos_2`.
    """
    positions: dict[str, list[int]] = {}
    for index, column in enumerate(columns):
        positions.setdefault(column.name.partition("/")[0], []).append(index)
    return {
        f"{group}_{start // MOST + 1}" if start else group: indices[start : start + MOST]
        for group, indices in positions.items()
        for start in range(0, len(indices), MOST)
    }


def field_names(group: str, names: Sequence[str]) -> list[str]:
    """Returns names of fields that are valid and distinct in every language that protobuf generates code for."""
    # In JSON and in C++, names that only differ in case and underscores collide.
    words = (_identifier(group, name) for name in names)
    return list(distinct(words, lambda name: name.replace("_", "").lower()))


def _identifier(group: str, text: str) -> str:
    words = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    return words if words[:1].isalpha() else "_".join(filter(None, [_identifier("column", group), words]))


def _schema(group: str, fields: Sequence[str], columns: Sequence[Column], repeated: str = "") -> Schema:
    """Returns the type of messages with these fields, or with a field that repeats a type with these fields."""
    files = FileDescriptorSet()
    name = "".join(word.capitalize() for word in _identifier("column", group).split("_"))
    file = files.file.add(name=f"mjrun/{name}.proto", package="mjrun", syntax="proto3")
    message = file.message_type.add(name=name)
    if repeated:
        row = f".mjrun.{name}.Row"
        kind, label = FieldDescriptorProto.TYPE_MESSAGE, FieldDescriptorProto.LABEL_REPEATED
        message.field.add(name=repeated, number=1, type=kind, label=label, type_name=row)
        message = message.nested_type.add(name="Row")
    for number, (field, column) in enumerate(zip(fields, columns, strict=True), 1):
        kind = FieldDescriptorProto.TYPE_STRING if column.labels else FieldDescriptorProto.TYPE_DOUBLE
        message.field.add(name=field, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL)
    return Schema(f"mjrun.{name}", files.SerializeToString(deterministic=True))


def _metadata(fields: Sequence[str], columns: Sequence[Column]) -> dict[str, str]:
    named = list(zip(fields, columns, strict=True))
    return {
        **{f"column/{field}": clean(column.name) for field, column in named},
        **{f"unit/{field}": column.unit for field, column in named},
    }


def _delimited(number: int, content: bytes) -> bytes:
    """Returns a field of a length, such as a text or a message."""
    return _varint(number << 3 | LENGTH) + _varint(len(content)) + content


def _varint(number: int) -> bytes:
    parts = bytearray()
    while number > 0x7F:
        parts.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*parts, number])


TRANSFORMS, JOINTS, SCENE = Schema.of(FrameTransforms), Schema.of(JointStates), Schema.of(SceneUpdate)
CALIBRATION, VIDEO, IMAGE = Schema.of(CalibrationMessage), Schema.of(CompressedVideo), Schema.of(CompressedImage)


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


def shapes(time: int, frame: str, name: str, parts: Sequence[TriangleSurface | LineSegments]) -> bytes:
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
