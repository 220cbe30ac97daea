"""MCAP files, read back by the reader of another project with all checksums."""

import io
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.stream_reader import StreamReader  # pyright: ignore[reportMissingImports]

from mjrun.formats import mcap
from mjrun.formats.mcap import McapWriter, NumericMessages
from mjrun.model.table_column import Column
from tests.formats.mcap import files

NUMBERS = NumericMessages("qpos", [Column(f"qpos/{index}", "rad") for index in range(30)])


def write(writer: McapWriter, count: int, start: int = 0) -> None:
    channel = writer.add_channel("/trace/qpos", NUMBERS.schema, NUMBERS.metadata)
    noise = np.random.default_rng(1).standard_normal((count, 30))
    for index, message in enumerate(NUMBERS.encode(noise)):
        writer.write(channel, start + 10 * index, message)


def fill(file: BinaryIO, count: int) -> None:
    writer = McapWriter(file, {})
    write(writer, count)
    writer.finish()


def publish(path: Path, count: int) -> None:
    with path.open("wb") as file:
        fill(file, count)


def test_messages_metadata_and_attachments_read_back_with_their_exact_times(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    late = 2**62 + 1  # a float has no such number
    with path.open("wb") as file:
        writer = McapWriter(file, {"command": "mjrun export", "seed": "0"})
        write(writer, 5_000, late)
        writer.attach("model.xml", "text/xml", b"<mujoco/>")
        writer.finish()
    assert writer.messages == 5_000
    received = files.messages(path)
    assert [message.time for message in received] == [late + 10 * index for index in range(5_000)]
    assert [message.sequence for message in received] == list(range(5_000))
    assert files.metadata(path) == {"mjrun": {"command": "mjrun export", "seed": "0"}}
    assert files.attachments(path) == {"model.xml": b"<mujoco/>"}
    statistics = files.summary(path).statistics
    assert (statistics.message_count, statistics.message_start_time) == (5_000, late)
    assert statistics.chunk_count > 1  # it was not kept in memory as a whole


def test_channels_of_one_type_share_its_schema(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file, {})
        for topic in ("/scene", "/contacts"):
            writer.write(writer.add_channel(topic, mcap.SCENE), 0, mcap.scene(0, {}))
        writer.finish()
    found = files.summary(tmp_path / "a.mcap")
    assert [schema.name for schema in found.schemas.values()] == ["foxglove.SceneUpdate"]
    assert sorted(channel.topic for channel in found.channels.values()) == ["/contacts", "/scene"]


def test_the_same_messages_give_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        publish(tmp_path / name, 100)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_pipe_gets_the_same_bytes_as_a_file(tmp_path: Path) -> None:
    publish(tmp_path / "a.mcap", 1000)
    reading, writing = os.pipe()
    with ThreadPoolExecutor(1) as pool, os.fdopen(reading, "rb") as end:
        received = pool.submit(end.read)
        with os.fdopen(writing, "wb") as file:
            fill(file, 1000)
        content = received.result()
    assert content == (tmp_path / "a.mcap").read_bytes()
    assert len(list(StreamReader(io.BytesIO(content), validate_crcs=True).records)) > 5
