"""MCAP files, read back by the reader of another project with all checksums."""

import io
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader  # pyright: ignore[reportMissingImports]
from mcap.stream_reader import StreamReader  # pyright: ignore[reportMissingImports]

from mjrun.errors import FileError
from mjrun.formats.mcap import foxglove
from mjrun.formats.mcap.numeric import NumericMessages
from mjrun.formats.mcap.writer import McapWriter
from mjrun.model.table_column import Column
from tests.formats.mcap import files
from tests.formats.outputs import names

NUMBERS = NumericMessages("qpos", [Column(f"qpos/{index}", "rad") for index in range(30)])


def write(writer: McapWriter, count: int, start: int = 0) -> None:
    channel = writer.add_channel("/trace/qpos", NUMBERS.schema, NUMBERS.metadata)
    noise = np.random.default_rng(1).standard_normal((count, 30))
    for index, message in enumerate(NUMBERS.encode(noise)):
        writer.write(channel, start + 10 * index, message)


def publish(path: Path, count: int) -> None:
    with McapWriter(str(path), {}) as writer:
        write(writer, count)
        writer.publish()


def test_messages_metadata_and_attachments_read_back_with_their_exact_times(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    late = 2**62 + 1  # a float has no such number
    with McapWriter(str(path), {"command": "mjrun export", "seed": "0"}) as writer:
        write(writer, 5_000, late)
        writer.attach("model.xml", "text/xml", b"<mujoco/>")
        assert writer.messages == 5_000
        assert writer.publish() == [path]
    received = files.messages(path)
    assert [message.time for message in received] == [late + 10 * index for index in range(5_000)]
    assert [message.sequence for message in received] == list(range(5_000))
    assert files.metadata(path) == {"mjrun": {"command": "mjrun export", "seed": "0"}}
    assert files.attachments(path) == {"model.xml": b"<mujoco/>"}
    statistics = files.summary(path).statistics
    assert (statistics.message_count, statistics.message_start_time) == (5_000, late)
    assert statistics.chunk_count > 1  # it was not kept in memory as a whole


def test_channels_of_one_type_share_its_schema(tmp_path: Path) -> None:
    with McapWriter(str(tmp_path / "a.mcap"), {}) as writer:
        for topic in ("/scene", "/contacts"):
            writer.write(writer.add_channel(topic, foxglove.SCENE), 0, foxglove.scene(0, {}))
        writer.publish()
    found = files.summary(tmp_path / "a.mcap")
    assert [schema.name for schema in found.schemas.values()] == ["foxglove.SceneUpdate"]
    assert sorted(channel.topic for channel in found.channels.values()) == ["/contacts", "/scene"]


def test_the_same_messages_give_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        publish(tmp_path / name, 100)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


PIPED = """
from mjrun.formats.mcap.writer import McapWriter
from tests.formats.mcap.test_writer import write
with McapWriter(None, {}) as writer:
    write(writer, 1000)
    writer.publish()
"""


def test_a_pipe_gets_the_same_bytes_as_a_file(tmp_path: Path) -> None:
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", PIPED], stdout=subprocess.PIPE, check=True, cwd=root)
    publish(tmp_path / "a.mcap", 1000)
    assert done.stdout == (tmp_path / "a.mcap").read_bytes()
    assert len(list(StreamReader(io.BytesIO(done.stdout), validate_crcs=True).records)) > 5
    reader = make_reader(io.BytesIO(done.stdout), validate_crcs=True)
    assert sum(1 for _ in reader.iter_messages()) == 1000


def test_what_is_not_published_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_text("old")
    with McapWriter(str(tmp_path / "a.mcap"), {}) as writer:
        write(writer, 10)
    assert names(tmp_path) == ["a.mcap"]
    assert (tmp_path / "a.mcap").read_text() == "old"


def test_a_full_disk_is_reported_and_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**16, hard))
    try:
        with pytest.raises(FileError) as caught:
            publish(path, 5_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert str(caught.value) == f"{path}: cannot be written: File too large"
    assert names(tmp_path) == ["a.mcap"]
    assert path.read_text() == "old"
