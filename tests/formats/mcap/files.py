"""Reads MCAP files with the reader of another project, which checks every checksum."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader  # pyright: ignore[reportMissingImports]
from mcap_protobuf.decoder import DecoderFactory  # pyright: ignore[reportMissingImports]

from mjrun.formats.mcap import Schema


def decoded(schema: Schema, content: bytes) -> Any:
    """Parses a message by nothing but its schema, as a viewer does."""
    pool = DescriptorPool()
    waiting = {file.name: file for file in FileDescriptorSet.FromString(schema.files).file}
    while waiting:
        known = [file for file in waiting.values() if not {*file.dependency} & {*waiting}]
        for file in known:
            pool.Add(waiting.pop(file.name))
    message = GetMessageClass(pool.FindMessageTypeByName(schema.name))()
    message.ParseFromString(content)
    return message


class Received(NamedTuple):
    """A decoded message; its time is in nanoseconds."""

    topic: str
    time: int
    sequence: int
    content: Any
    schema: str
    metadata: dict[str, str]


def messages(path: Path, *topics: str) -> list[Received]:
    """Reads the messages of some topics, or all, in order of time."""
    return list(_messages(path, topics))


def _messages(path: Path, topics: tuple[str, ...]) -> Iterator[Received]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded_messages: Any = reader.iter_decoded_messages(topics=topics or None)
        for schema, channel, message, content in decoded_messages:
            assert message.publish_time == message.log_time
            yield Received(channel.topic, message.log_time, message.sequence, content, schema.name, channel.metadata)


def stored_times(path: Path) -> list[int]:
    """Reads the times of all messages in the order in which they are stored [ns]."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]


def summary(path: Path) -> Any:
    """Reads the summary at the end of a file."""
    with path.open("rb") as file:
        return make_reader(file, validate_crcs=True).get_summary()


def metadata(path: Path) -> dict[str, dict[str, str]]:
    """Reads all metadata records by their names."""
    with path.open("rb") as file:
        return {record.name: record.metadata for record in make_reader(file, validate_crcs=True).iter_metadata()}


def attachments(path: Path) -> dict[str, bytes]:
    """Reads all attachments by their names."""
    with path.open("rb") as file:
        return {record.name: record.data for record in make_reader(file, validate_crcs=True).iter_attachments()}
