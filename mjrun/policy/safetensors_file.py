"""Tensors in a file of the format safetensors: a header in JSON, and the numbers after it.

Source: https://huggingface.co/docs/safetensors, "Format".
"""

import json
from pathlib import Path
from typing import cast

import numpy as np

from mjrun.formats.input_file import decoding, opened

SUFFIXES = (".safetensors",)
TYPES = {
    "F64": "<f8",
    "F32": "<f4",
    "F16": "<f2",
    "I64": "<i8",
    "I32": "<i4",
    "I16": "<i2",
    "I8": "i1",
    "U8": "u1",
    "BOOL": "?",
}
HEADER = 8  # bytes that say how long the header is
LONGEST = 100_000_000  # bytes of a header


def read_safetensors(path: Path) -> dict[str, np.ndarray]:
    """The tensors at `path`, by name.

    Raises:
      FileError: it cannot be read, is damaged, or holds a type that NumPy lacks.
    """
    with opened(path, "file of tensors", SUFFIXES) as file, decoding(path, "cannot be read as safetensors"):
        length = int.from_bytes(file.read(HEADER), "little")
        if length > LONGEST:
            raise ValueError("its header is too long")
        text = file.read(length)
        if len(text) < length:
            raise ValueError("it ends within its header")
        header = cast("dict[str, dict[str, object]]", json.loads(text))
        content = file.read()
        return {name: _tensor(entry, content) for name, entry in header.items() if name != "__metadata__"}


def _tensor(entry: dict[str, object], content: bytes) -> np.ndarray:
    start, end = cast("list[int]", entry["data_offsets"])
    if not 0 <= start <= end <= len(content):
        raise ValueError("a tensor is outside of the file")
    return np.frombuffer(content[start:end], TYPES[str(entry["dtype"])]).reshape(cast("list[int]", entry["shape"]))
