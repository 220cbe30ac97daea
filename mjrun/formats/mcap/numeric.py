"""Messages of measured values: a flat protobuf type with a number for each column.

The rows of a block are serialized together: as every field has a fixed length, a message is an array of bytes.
https://protobuf.dev/programming-guides/encoding/
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet

from mjrun.formats.mcap.writer import Schema
from mjrun.model.table_column import Column

FIXED64 = 1  # wire type of a double
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
        fields = field_names(group, columns)
        self.schema = _schema(group, fields)
        self.metadata = {f"column/{field}": column.name for field, column in zip(fields, columns, strict=True)}
        self.metadata |= {f"unit/{field}": column.unit for field, column in zip(fields, columns, strict=True)}
        tags = [_varint(number << 3 | FIXED64) for number in range(1, len(fields) + 1)]
        self._template = np.frombuffer(b"".join(tag + bytes(8) for tag in tags), np.uint8)
        ends = np.cumsum([len(tag) + 8 for tag in tags])
        self._places = ends[:, None] + np.arange(-8, 0)  # of the bytes of each number

    def encode(self, values: np.ndarray) -> list[bytes]:
        """Serializes the rows `values` `(n, columns)` float64."""
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


def field_names(group: str, columns: Sequence[Column]) -> list[str]:
    """Returns names of fields that are valid and distinct in every language that protobuf generates code for."""
    names = (_identifier(group, column.name.partition("/")[2] or column.name) for column in columns)
    # In JSON and in C++, names that only differ in case and underscores collide.
    return list(distinct(names, "_", lambda name: name.replace("_", "").lower()))


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


def _schema(group: str, fields: Sequence[str]) -> Schema:
    files = FileDescriptorSet()
    name = "".join(word.capitalize() for word in _identifier("column", group).split("_"))
    file = files.file.add(name=f"mjrun/{name}.proto", package="mjrun", syntax="proto3")
    message = file.message_type.add(name=name)
    kind, label = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.LABEL_OPTIONAL
    for number, field in enumerate(fields, 1):
        message.field.add(name=field, number=number, type=kind, label=label)
    return Schema(f"mjrun.{name}", files.SerializeToString(deterministic=True))


def _varint(number: int) -> bytes:
    parts = bytearray()
    while number > 0x7F:
        parts.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*parts, number])
