"""Writes MCAP files: messages of any number of channels, with an index of their times."""

from collections.abc import Mapping
from typing import Any, BinaryIO

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from mcap.well_known import MessageEncoding, SchemaEncoding  # pyright: ignore[reportMissingImports]
from mcap.writer import Writer  # pyright: ignore[reportMissingImports]

from mjrun.dataclass import dataclass
from mjrun.version import __version__


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
