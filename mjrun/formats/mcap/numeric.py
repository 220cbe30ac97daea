"""Messages of measured values: protobuf types with a number or a text for each column.

Numbers of a block of rows are serialized together: as their fields have a fixed length, they are an array of bytes.
https://protobuf.dev/programming-guides/encoding/
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet

from mjrun.errors import clean
from mjrun.formats.mcap.writer import Schema
from mjrun.model.table_column import Column

FIXED64, LENGTH = 1, 2  # wire types of a double, and of a text or a message
MOST = 4000  # fields in a message; protobuf's own limit is 64 KiB, with some bytes for each field


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
    return list(distinct(words, "_", lambda name: name.replace("_", "").lower()))


def distinct(names: Iterable[str], mark: str, key: Callable[[str], str] = str) -> Iterator[str]:
    """Yields names, with the lowest free number appended to those whose `key` occurred before: `a`, `a_2`."""
    taken = set[str]()
    for name in names:
        different, number = name, 1
        while key(different) in taken:
            number += 1
            different = f"{name}{mark}{number}"
        taken.add(key(different))
        yield different


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
