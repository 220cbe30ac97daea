"""LeRobot datasets, read by pandas, PyAV and lerobot-doctor."""

import gc
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pytest

from mjrun.errors import FileError, UsageError
from mjrun.formats.codecs import encoding
from mjrun.formats.episodes import CameraVideoLayout, EpisodeRows, lerobot
from mjrun.formats.output_writer import publish_together
from tests.formats.episodes.made_episodes import FPS, LAYOUT, NUMBERS, SIZE, episode, episodes, images, written

LENGTHS = [10, 13, 16, 19]


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def rows(folder: Path) -> list[dict[str, Any]]:
    paths = sorted((folder / "meta/episodes").rglob("*.parquet"))
    return pandas.concat(map(pandas.read_parquet, paths)).to_dict("records")


def test_the_tables_hold_the_numbers_of_the_episodes(tmp_path: Path) -> None:
    written("lerobot", tmp_path, NUMBERS, episodes(range(4)))
    data = pandas.read_parquet(tmp_path / "data/chunk-000/file-000.parquet")
    made = [episode(seed) for seed in range(4)]
    assert data["index"].tolist() == list(range(sum(LENGTHS)))
    assert data["episode_index"].tolist() == [index for index, count in enumerate(LENGTHS) for _ in range(count)]
    assert data["task_index"].tolist() == [index % 2 for index, count in enumerate(LENGTHS) for _ in range(count)]
    for number, (_, part) in enumerate(data.groupby("episode_index")):
        observations = np.stack(part["observation.state"].tolist())
        np.testing.assert_array_equal(observations, made[number].observations[:-1].astype(np.float32))
        np.testing.assert_array_equal(part["action"], made[number].actions[:, 0].astype(np.float32))
        np.testing.assert_array_equal(part["next.reward"], made[number].rewards.astype(np.float32))
        np.testing.assert_array_equal(part["timestamp"], (np.arange(len(part)) / float(FPS)).astype(np.float32))
        assert part["next.done"].tolist() == [False] * (len(part) - 1) + [True]
        assert part["next.truncated"].tolist()[-1] == (number % 2 == 1)
        assert any(part["next.success"].tolist()) == (number == 2)
    tasks = pandas.read_parquet(tmp_path / "meta/tasks.parquet")
    assert [(tasks.iloc[i].name, tasks.iloc[i].task_index) for i in range(2)] == [("walk", 0), ("stand", 1)]


def test_statistics_of_the_dataset_and_of_each_episode_are_those_of_numpy(tmp_path: Path) -> None:
    written("lerobot", tmp_path, LAYOUT, episodes(range(3), tmp_path))
    stats = json.loads((tmp_path / "meta/stats.json").read_text())
    states = [episode(seed).observations[:-1].astype(np.float32) for seed in range(3)]
    for values, found in ((np.concatenate(states), stats["observation.state"]), (states[1], _row_stats(tmp_path, 1))):
        assert found["count"] == [len(values)]
        np.testing.assert_allclose(found["mean"], values.mean(axis=0, dtype=float))
        np.testing.assert_allclose(found["std"], values.std(axis=0, dtype=float))
        np.testing.assert_allclose(found["q99"], np.quantile(values, 0.99, axis=0), rtol=1e-6)
    pixels = np.concatenate([images(seed, len(episode(seed))) for seed in range(3)]) / 255
    np.testing.assert_allclose(stats["observation.images.front"]["std"], np.full((3, 1, 1), pixels.std()))


def _row_stats(folder: Path, index: int) -> dict[str, Any]:
    prefix = "stats/observation.state/"
    return {key.removeprefix(prefix): value for key, value in rows(folder)[index].items() if key.startswith(prefix)}


def test_every_frame_is_where_its_time_in_the_video_says(tmp_path: Path) -> None:
    import av

    written("lerobot", tmp_path, LAYOUT, episodes(range(4), tmp_path))
    with av.open(str(tmp_path / "videos/observation.images.front/chunk-000/file-000.mp4")) as container:
        frames = {round(frame.time, 9): frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)}
    key = "videos/observation.images.front"
    for seed, row in enumerate(rows(tmp_path)):
        for index, image in enumerate(images(seed, row["length"])):
            shown = frames[round(row[f"{key}/from_timestamp"] + index / float(FPS), 9)]
            assert abs(shown.astype(int) - image).max() <= 2
        assert row[f"{key}/to_timestamp"] == row[f"{key}/from_timestamp"] + row["length"] / float(FPS)


def test_lerobot_doctor_finds_no_failure(tmp_path: Path) -> None:
    written("lerobot", tmp_path / "dataset", LAYOUT, episodes(range(4), tmp_path))
    command = [Path(sys.executable).with_name("lerobot-doctor"), "check", tmp_path / "dataset", "--ci"]
    report = json.loads(
        subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("lerobot-doctor:")[0]
    )
    assert report["summary"]["FAIL"] == 0
    assert report["total_frames"] == sum(LENGTHS)
    passed = [check["name"] for check in report["checks"] if check["severity"] == "PASS"]
    assert {"Metadata & Format Compliance", "Temporal Consistency", "Video Integrity", "Feature Consistency"} <= {
        *passed
    }


def test_a_continued_dataset_has_the_bytes_of_one_made_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lerobot, "MEGABYTE", 20)  # a file holds few episodes
    at_once, continued = tmp_path / "at once", tmp_path / "continued"
    written("lerobot", at_once, LAYOUT, episodes(range(6), tmp_path))
    for start, end in ((0, 1), (1, 3), (3, 3), (3, 6)):
        written("lerobot", continued, LAYOUT, episodes(range(start, end), tmp_path), start)
    assert files(continued) == files(at_once)
    assert {"data/chunk-000/file-002.parquet", "videos/observation.images.front/chunk-000/file-001.mp4"} <= {
        *files(at_once)
    }


def test_episodes_of_a_process_that_was_killed_as_it_published_them_are_not_counted_twice(tmp_path: Path) -> None:
    at_once, continued = tmp_path / "at once", tmp_path / "continued"
    written("lerobot", at_once, LAYOUT, episodes(range(3), tmp_path))
    # the list of known episodes, which is published last, had only the first
    for start, end in ((0, 1), (1, 3), (1, 3)):
        written("lerobot", continued, LAYOUT, episodes(range(start, end), tmp_path), start)
    assert files(continued) == files(at_once)
    written("lerobot", continued, LAYOUT, episodes([2], tmp_path), 1)  # not the second, whose task is another
    assert [*pandas.read_parquet(continued / "meta/tasks.parquet").index] == ["walk"]


def test_files_are_short_enough_for_times_of_32_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lerobot, "LONGEST", 1)  # [s], of 20 frames
    written("lerobot", tmp_path, LAYOUT, episodes([0, 0, 0, 1], tmp_path))
    key = "videos/observation.images.front"
    assert [row[f"{key}/file_index"] for row in rows(tmp_path)] == [0, 0, 1, 2]
    assert [row[f"{key}/from_timestamp"] for row in rows(tmp_path)] == [0, 0.5, 0, 0]
    with pytest.raises(FileError, match=r"an episode of 1.1 s is too long for LeRobot"):
        written("lerobot", tmp_path / "long", LAYOUT, episodes([4], tmp_path))
    assert not (tmp_path / "long").exists()


def test_names_and_commands_mean_nothing_in_the_card(tmp_path: Path) -> None:
    written("lerobot", tmp_path, NUMBERS, episodes([0]))
    card = (tmp_path / "README.md").read_text()
    assert "# &lt;script&gt;arm\n" in card
    assert "- command: mjrun export \\`x\\`\n" in card


def test_a_damaged_dataset_is_not_continued(tmp_path: Path) -> None:
    written("lerobot", tmp_path, NUMBERS, episodes(range(2)))
    (tmp_path / "data/chunk-000/file-000.parquet").write_bytes(b"PAR1")
    with pytest.raises(FileError, match="damaged"):
        written("lerobot", tmp_path, NUMBERS, episodes([2]), 2)


def test_unsupported_layouts_are_refused() -> None:
    lerobot.check(LAYOUT)
    with pytest.raises(UsageError, match="whole numbers of frames per second, not 66"):
        lerobot.check(replace(LAYOUT, fps=Fraction(200, 3)))
    for size, codec, message in (
        ((33, 16), "h264", "even sides"),
        ((32, 8), "h264", "16x16"),
        (SIZE, "h264rgb", "not of h264rgb"),
    ):
        camera = CameraVideoLayout("front", size, encoding("a.mp4", codec=codec))
        with pytest.raises(UsageError, match=message):
            lerobot.check(replace(LAYOUT, cameras=[camera]))


def test_files_are_whole_when_they_are_published(tmp_path: Path) -> None:
    with ExitStack() as stack:
        publish_together(lerobot.write(stack, tmp_path / "dataset", LAYOUT, episodes(range(2), tmp_path)))
        published = files(tmp_path / "dataset")
    assert files(tmp_path / "dataset") == published


@pytest.mark.parametrize("size", [20, 50])  # of a table of one episode, or of a few
def test_episodes_name_the_file_that_holds_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    monkeypatch.setattr(lerobot, "ROWS", 1)
    monkeypatch.setattr(lerobot, "MEGABYTE", size)
    written("lerobot", tmp_path, NUMBERS, episodes(range(6)))
    paths = sorted((tmp_path / "meta/episodes").rglob("*.parquet"))
    assert len(paths) > 1
    for number, path in enumerate(paths):
        assert path.name == f"file-{number:03d}.parquet"
        assert {*pandas.read_parquet(path)["meta/episodes/file_index"]} == {number}


def test_a_full_file_of_a_continued_dataset_keeps_its_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at_once, continued = tmp_path / "at once", tmp_path / "continued"
    sizes = list[int]()
    make_room = lerobot._TableFiles.make_room

    def measured(self: lerobot._TableFiles, size: int) -> None:
        sizes.append(size)
        make_room(self, size)

    with monkeypatch.context() as patch:
        patch.setattr(lerobot._TableFiles, "make_room", measured)
        written("lerobot", tmp_path / "measured", NUMBERS, episodes(range(2)))
    monkeypatch.setattr(lerobot, "DATA_SIZE", sum(sizes[:2]))  # which two episodes fill to the last byte
    monkeypatch.setattr(lerobot, "MEGABYTE", 1)
    written("lerobot", at_once, NUMBERS, episodes(range(3)))
    for start, end in ((0, 2), (2, 3)):
        written("lerobot", continued, NUMBERS, episodes(range(start, end)), start)
    assert files(continued) == files(at_once)


def test_a_long_episode_is_one_group_of_rows(tmp_path: Path) -> None:
    schema = pyarrow.schema({"index": pyarrow.int64()})
    lengths = [2**20 + 1, 3]
    tables = [pyarrow.table({"index": np.arange(count)}, schema=schema) for count in lengths]
    with ExitStack() as stack:
        made = lerobot._TableFiles(stack, tmp_path, lerobot.DATA, schema)
        places = [made.add(table) for table in tables]
        publish_together(made.finish())
    rows = [
        {"episode_index": index, "data/chunk_index": 0, "data/file_index": place} for index, place in enumerate(places)
    ]
    with ExitStack() as stack:
        read = lerobot._TableFiles(stack, tmp_path, lerobot.DATA, schema)
        assert [table.num_rows for _, table in read.read(rows)] == lengths


@pytest.mark.filterwarnings("error")  # of exceptions that Python ignores
def test_an_episode_that_fails_leaves_nothing_behind(tmp_path: Path) -> None:
    def failing() -> Iterator[EpisodeRows]:
        yield episode(0)
        raise FileError("episode", "is damaged")

    with pytest.raises(FileError, match="is damaged"):
        written("lerobot", tmp_path / "dataset", NUMBERS, failing())
    gc.collect()
    assert not any(tmp_path.iterdir())
