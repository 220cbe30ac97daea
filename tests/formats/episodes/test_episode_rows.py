"""Episodes that are stored and read."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats.episodes import NUMBERS, EpisodeRows
from tests.formats.episodes.made_episodes import episode


def test_a_stored_episode_is_read_unchanged(tmp_path: Path) -> None:
    made = episode(2, tmp_path)
    for name, content in made.files({"front": made.videos["front"].read_bytes()}):
        (tmp_path / name).write_bytes(content)
    read = EpisodeRows.read(tmp_path, ["front"])
    assert read.videos["front"].read_bytes() == made.videos["front"].read_bytes()
    for each in fields(read):
        if each.name != "videos":
            np.testing.assert_equal(getattr(read, each.name), getattr(made, each.name))


@pytest.mark.parametrize("content", [b"", b"PK", b"\x93NUMPY"])
def test_a_damaged_episode_is_reported(tmp_path: Path, content: bytes) -> None:
    (tmp_path / NUMBERS).write_bytes(content)
    with pytest.raises(FileError, match="cannot be read"):
        EpisodeRows.read(tmp_path, [])
