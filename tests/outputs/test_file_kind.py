"""The kind of a result, told from its file."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mjrun.errors import UsageError
from mjrun.outputs.diff import common_kind, kind_of
from tests.cases import cases


@cases("name, kind")
def test_the_suffix_says_the_kind(name: str, kind: str) -> None:
    assert kind_of(name) == kind


def test_the_content_says_the_kind_where_the_suffix_does_not(tmp_path: Path) -> None:
    np.savez(tmp_path / "table.npz", time=np.zeros(3))
    np.savez(tmp_path / "recording.npz", states=np.zeros((1, 1)), steps=np.zeros(1, int), facts=np.array("{}"))
    (tmp_path / "broken.npz").write_bytes(b"PK")
    one = Image.new("RGB", (8, 8))
    one.save(tmp_path / "still.webp")
    one.save(tmp_path / "moving.webp", save_all=True, append_images=[Image.new("RGB", (8, 8), "red")])
    kinds = {"table.npz": "table", "recording.npz": "recording", "broken.npz": "table"}
    kinds |= {"still.webp": "image", "moving.webp": "video", ".": "video"}
    assert {name: kind_of(str(tmp_path / name)) for name in kinds} == kinds


def test_two_kinds_are_refused() -> None:
    assert common_kind("a.csv", "b.npz") == "table"
    with pytest.raises(UsageError, match=r"a.csv is a table and b.png is an image: only results of the same kind"):
        common_kind("a.csv", "b.png")
