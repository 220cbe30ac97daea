"""The content of untrusted HDF5 files: limits that are checked before datasets are read, and strings.

Strings of variable length are read without HDF5's own library, which hangs or crashes on damaged heaps. See "Global
Heap", "Object Headers" and "The Attribute Message" in the HDF5 File Format Specification.
"""

import math
import struct
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import h5py

from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError

HEAP = struct.Struct("<4sB3xQ")  # begin of a heap: signature, version, size
HEAP_OBJECT = struct.Struct("<HHIQ")  # begin of a text in it: index, uses, nothing, size
REFERENCE = struct.Struct("<IQI")  # to a text: its length, the address of its heap, its index there
ADDRESS = struct.Struct("<QQ")  # of a block: address, size
OLD_HEADER = struct.Struct("<BxHII4x")  # begin of an object header: version, messages, references, size
OLD_MESSAGE = struct.Struct("<HHB3x")  # begin of a message in it: type, size, flags
NEW_MESSAGE = struct.Struct("<BHB")
ATTRIBUTE = struct.Struct("<BBHHH")  # version, flags, sizes of name, type and shape
ATTRIBUTES_ELSEWHERE, ATTRIBUTE_MESSAGE, CONTINUATION = 0x15, 0x0C, 0x10  # types of messages
UNDEFINED = b"\xff" * 8  # address
FIXED_STRING, VARIABLE_LENGTH = 3, 9  # classes of types
SIZES = (8, 8)  # bytes of addresses and of lengths
MOST_BLOCKS = 1000  # of an object header
LARGEST = 2**28  # bytes of a block, which is read whole


def require_own_content(path: Path, what: str, dataset: h5py.Dataset, file: BinaryIO | None = None) -> None:
    """Checks that the content of a dataset is in its file, and does not expand out of proportion.

    Args:
      what: the dataset in messages.
      file: the open file, where its path does not lead to it.

    Raises:
      FileError: it is in another file, or one chunk of it, which is read whole, is too large.
    """
    if dataset.is_virtual or dataset.external:
        raise FileError(path, f"{what} is in another file, which is not read")
    require_expandable(path, math.prod(dataset.chunks or (1,)) * dataset.dtype.itemsize, file)


class StringHeap:
    """The heap of a file, which holds its strings of variable length.

    Args:
      file: the open file.
      base: the place in it to which addresses are relative.
    """

    def __init__(self, file: BinaryIO, base: int) -> None:
        self._file, self._base = file, base
        self._objects = lru_cache(maxsize=2)(self._read)

    def text(self, length: int, address: int, index: int) -> str:
        """Returns the text of a reference.

        Raises:
          ValueError: the heap is damaged.
        """
        if not length:
            return ""
        content = self._objects(address).get(index, b"")
        if len(content) < length:
            raise ValueError("a text is missing from its heap")
        return content[:length].decode("utf-8", "replace")

    def _read(self, address: int) -> dict[int, bytes]:
        """Returns the texts in the heap at an address, encoded, by their index."""
        signature, version, size = HEAP.unpack(content_at(self._file, self._base + address, HEAP.size))
        if signature != b"GCOL" or version != 1 or size > LARGEST:
            raise ValueError("a heap of strings is damaged")
        self._file.seek(self._base + address)
        heap = self._file.read(size)  # the file may end within what is free
        texts: dict[int, bytes] = {}
        at = HEAP.size
        while at + HEAP_OBJECT.size <= len(heap):
            index, _, _, length = HEAP_OBJECT.unpack_from(heap, at)
            at += HEAP_OBJECT.size
            if not index:  # what follows is free
                break
            if at + length > len(heap):
                raise ValueError("a heap of strings is damaged")
            texts[index] = heap[at : at + length]
            at += length + -length % 8
        return texts


def content_at(file: BinaryIO, place: int, count: int) -> bytes:
    """Returns `count` bytes of a file; raises ValueError if it ends before, or if they are too many."""
    if place + count > file.seek(0, 2) or not 0 <= count <= LARGEST:
        raise ValueError("it ends early")
    file.seek(place)
    return file.read(count)


def text_attributes(file: BinaryIO, item: Any) -> dict[str, str]:
    """Returns the attributes of an object that are one text, of fixed or variable length, by name.

    Args:
      file: the open file that contains the object.
      item: a group or a dataset of h5py.

    Raises:
      ValueError: they are stored in an unsupported way, or damaged.
    """
    archive = item.file
    if archive.id.get_create_plist().get_sizes() != SIZES:
        raise ValueError("its addresses have another size than 8 bytes")
    base = archive.userblock_size
    heap, texts = StringHeap(file, base), dict[str, str]()
    address: int = h5py.h5o.get_info(item.id).addr  # pyright: ignore[reportAttributeAccessIssue]
    for kind, message in _messages(file, base, address):
        if kind == ATTRIBUTE_MESSAGE:
            name, type_, shape, value = _attribute(message)
            if (text := _text(type_, shape, value, heap)) is not None:
                texts[name] = text
        elif kind == ATTRIBUTES_ELSEWHERE and not _has_only_messages(message):
            raise ValueError("its attributes are in dense storage; write it again with libver='earliest'")
    return texts


def _messages(file: BinaryIO, base: int, address: int) -> Iterator[tuple[int, bytes]]:
    """Yields the type and the content of each message in the header of the object at an address."""
    begin = content_at(file, base + address, 16)
    is_new = begin.startswith(b"OHDR")
    if is_new:
        flags = begin[5]
        at = base + address + 6 + 16 * bool(flags & 0x20) + 4 * bool(flags & 0x10)
        width = 1 << (flags & 3)
        blocks = [(at + width, int.from_bytes(content_at(file, at, width), "little"))]
    else:
        version, _, _, size = OLD_HEADER.unpack(begin)
        if version != 1:
            raise ValueError("an object header is damaged")
        flags = 0
        blocks = [(base + address + OLD_HEADER.size, size)]

    head, more = (NEW_MESSAGE, 2 * bool(flags & 4)) if is_new else (OLD_MESSAGE, 0)
    for number, (place, size) in enumerate(blocks):
        if number == MOST_BLOCKS:
            raise ValueError("an object header is damaged")
        block, at = content_at(file, place, size), 0
        while at + head.size + more <= len(block):
            kind, length, _ = head.unpack_from(block, at)
            at += head.size + more
            message = block[at : at + length]
            at += length
            if kind == CONTINUATION:
                following, count = ADDRESS.unpack(message[:16])
                # In new headers, a signature comes first and a checksum last.
                blocks.append((base + following + 4 * is_new, count - 8 * is_new))
            else:
                yield kind, message


def _has_only_messages(message: bytes) -> bool:
    """Returns whether a header stores all attributes of its object in messages, rather than in another heap."""
    at = 2 + 2 * (message[1] & 1)
    return message[at : at + 8] == UNDEFINED


def _attribute(message: bytes) -> tuple[str, bytes, bytes, bytes]:
    """Returns the name, the type, the shape and the value of an attribute, all but the name encoded."""
    version, flags, *sizes = ATTRIBUTE.unpack_from(message)
    at = ATTRIBUTE.size + (version == 3)
    parts: list[bytes] = []
    for size in sizes:
        parts.append(message[at : at + size])
        at += size + (-size % 8 if version == 1 else 0)
    if version > 1 and flags & 3:  # the type or the shape is in another object
        parts[1] = b""
    return parts[0].rstrip(b"\0").decode("utf-8", "replace"), parts[1], parts[2], message[at:]


def _text(type_: bytes, shape: bytes, value: bytes, heap: StringHeap) -> str | None:
    """Returns the value of an attribute that is one text; None for others."""
    if len(type_) < 8 or len(shape) < 2 or shape[1] != 0 or (shape[0] == 2 and shape[3:4] != b"\0"):
        return None
    kind = type_[0] & 15
    if kind == FIXED_STRING:
        size = int.from_bytes(type_[4:8], "little")
        return value[:size].partition(b"\0")[0].decode("utf-8", "replace")
    if kind == VARIABLE_LENGTH and type_[1] & 15 == 1:
        return heap.text(*REFERENCE.unpack_from(value))
    return None
