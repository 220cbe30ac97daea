"""Files of tensors: read, and refused where damaged."""

import json
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.policy.safetensors_file import read_safetensors
from tests.policy.leapp_packages import tensors


def test_tensors_have_names_shapes_and_values(tmp_path: Path) -> None:
    arrays = {"a/b": np.arange(6, dtype=np.float32).reshape(1, 2, 3), "c": np.ones((0, 2), np.float32)}
    read = read_safetensors(tensors(tmp_path / "a.safetensors", arrays))
    assert {name: array.tolist() for name, array in read.items()} == {"a/b": arrays["a/b"].tolist(), "c": []}


def file(header: object, content: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + content


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff" * 8,
        file([1]),
        file({"a": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}, b"1234"),
        file({"a": {"dtype": "F32", "shape": [3], "data_offsets": [0, 8]}}, b"12345678"),
        file({"a": {"dtype": "F8", "shape": [8], "data_offsets": [0, 8]}}, b"12345678"),
        file({"a": {"dtype": "F32", "shape": [1]}}),
        file({"a": {"dtype": "F32", "shape": [-1], "data_offsets": [8, 0]}}, b"12345678"),
    ],
)
def test_what_is_damaged_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.safetensors").write_bytes(content)
    with pytest.raises(FileError, match="cannot be read as safetensors"):
        read_safetensors(tmp_path / "a.safetensors")
