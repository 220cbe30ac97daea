"""MCAP files, read back by the reader of another project with all checksums, their values by protobuf."""

import io
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.stream_reader import StreamReader  # pyright: ignore[reportMissingImports]

from mjrun.formats import mcap
from mjrun.formats.mcap import MOST, McapWriter, NumericMessages, TableMessages, field_names, groups
from mjrun.model.names import distinct
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


def decoded(messages: NumericMessages, content: bytes) -> dict[str, float]:
    message = files.decoded(messages.schema, content)
    return {field.name: getattr(message, field.name) for field in message.DESCRIPTOR.fields}


def test_every_number_reads_back_bit_for_bit() -> None:
    columns = [Column("qpos/left_knee", "rad"), Column("qpos/torso/x", "m"), Column("qpos/joint:3")]
    messages = NumericMessages("qpos", columns)
    values = np.array([[0.1, -0.0, 5e-324], [np.inf, np.nan, 1e308]])
    read = [decoded(messages, content) for content in messages.encode(values)]
    assert messages.schema.name == "mjrun.Qpos"
    assert [list(row) for row in read] == 2 * [["left_knee", "torso_x", "joint_3"]]
    assert np.array([list(row.values()) for row in read]).tobytes() == values.tobytes()
    assert messages.metadata["unit/left_knee"] == "rad"
    assert messages.metadata["column/torso_x"] == "qpos/torso/x"


@pytest.mark.parametrize("count", [15, 16, 2047, MOST])
def test_a_message_may_have_any_number_of_fields(count: int) -> None:
    messages = NumericMessages("userdata", [Column(f"userdata/{index}") for index in range(count)])
    values = np.arange(count, dtype=float)
    assert list(decoded(messages, messages.encode(values[None])[0]).values()) == values.tolist()


def test_rows_of_any_layout_are_encoded_alike() -> None:
    messages = NumericMessages("qvel", [Column("qvel/a"), Column("qvel/b")])
    values = np.arange(12.0).reshape(6, 2)
    assert messages.encode(np.asfortranarray(values)) == messages.encode(values)
    assert messages.encode(values[:0]) == []


@given(st.lists(st.text(max_size=4), min_size=1, max_size=8))
@settings(max_examples=30)
def test_any_names_give_valid_and_distinct_fields(names: list[str]) -> None:
    columns = [Column(f"qpos/{name}") for name in names]
    fields = field_names("qpos", names)
    assert len({field.replace("_", "").lower() for field in fields}) == len(names)
    messages = NumericMessages("qpos", columns)  # protobuf refuses names that it does not know
    assert list(decoded(messages, messages.encode(np.zeros((1, len(names))))[0])) == fields


def test_names_that_differ_in_case_only_stay_apart() -> None:
    names = ("knee", "Knee", "kn_ee", "1", "é", "reward")
    assert field_names("qpos", names) == ["knee", "Knee_2", "kn_ee_3", "qpos_1", "qpos", "reward"]
    assert field_names("reward", ["reward"]) == ["reward"]
    assert list(distinct(["a", "a", "a_2"])) == ["a", "a_2", "a_2_2"]


def test_a_table_has_rows_of_numbers_and_texts() -> None:
    columns = [Column("geom1", labels=("fl\x1boor", "ball")), Column("pos/x", "m"), Column("body", labels=("a",))]
    messages = TableMessages("contacts", columns)
    rows = files.decoded(messages.schema, messages.encode(np.array([[1, 0.25, -1], [0, -2.5, 0]]))).rows
    assert [(row.geom1, row.pos_x, row.body) for row in rows] == [("ball", 0.25, ""), ("fl\\x1boor", -2.5, "a")]
    assert not files.decoded(messages.schema, messages.encode(np.empty((0, 3)))).rows
    assert messages.metadata["unit/pos_x"] == "m"


def test_columns_are_grouped_by_the_first_part_of_their_names() -> None:
    columns = [Column("qpos/a"), Column("energy/total"), Column("qpos/b"), Column("reward")]
    assert groups(columns) == {"qpos": [0, 2], "energy": [1], "reward": [3]}
    many = groups([Column(f"qpos/{index}") for index in range(MOST + 2)])
    assert {group: (indices[0], len(indices)) for group, indices in many.items()} == {
        "qpos": (0, MOST),
        "qpos_2": (MOST, 2),
    }


def test_a_reader_of_files_decodes_the_values(tmp_path: Path) -> None:
    messages = NumericMessages("energy", [Column("energy/total", "J")])
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file, {})
        channel = writer.add_channel("/trace/energy", messages.schema, messages.metadata)
        for index, content in enumerate(messages.encode(np.array([[1.5], [2.5]]))):
            writer.write(channel, index, content)
        writer.finish()
    received = files.messages(tmp_path / "a.mcap", "/trace/energy")
    assert [message.content.total for message in received] == [1.5, 2.5]
    assert received[0].metadata == {"column/total": "energy/total", "unit/total": "J"}
