"""The kinds of results: table, recording, video, image or model."""

import zipfile
from pathlib import Path

from mjrun.diff.table_files import is_results
from mjrun.errors import UsageError, clean
from mjrun.formats import codecs, image_reader, tables
from mjrun.formats.input_file import is_folder
from mjrun.formats.recording import ARRAYS
from mjrun.formats.table_reader import STDIN

TABLE, RECORDING, VIDEO, IMAGE, MODEL = "table", "recording", "video", "image", "model"


def common_kind(a: str, b: str) -> str:
    """Returns the kind of both files.

    Raises:
      UsageError: they are of different kinds.
    """
    kinds = kind_of(a), kind_of(b)
    if kinds[0] != kinds[1]:
        facts = [f"{clean(path)} is {_with_article(kind)}" for path, kind in zip((a, b), kinds, strict=True)]
        raise UsageError(f"{' and '.join(facts)}: only results of the same kind can be compared")
    return kinds[0]


def kind_of(name: str) -> str:
    """Returns the kind of a file by its suffix, and of an archive or a .webp by its content.

    Any other file is a model. A folder is that of a study or an evaluation, or contains the frames of a video.
    """
    path, suffix = Path(name), Path(name).suffix.lower()
    if name == STDIN:
        return TABLE
    if suffix == ".npz":
        return RECORDING if _is_recording(path) else TABLE
    if suffix in tables.suffixes():
        return TABLE
    if is_folder(path):
        return TABLE if is_results(path) else VIDEO
    if suffix in image_reader.SUFFIXES and not (suffix == ".webp" and _is_animated(path)):
        return IMAGE
    return VIDEO if suffix in codecs.suffixes() else MODEL


def _is_recording(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return {f"{name}.npy" for name in ARRAYS} <= set(archive.namelist())
    except (OSError, ValueError, zipfile.BadZipFile):
        return False  # reading it as a table reports the fault


def _is_animated(path: Path) -> bool:
    """Returns whether a WebP file is animated: https://developers.google.com/speed/webp/docs/riff_container."""
    try:
        with path.open("rb") as file:
            head = file.read(21)
    except OSError:
        return False
    return head[12:16] == b"VP8X" and len(head) == 21 and bool(head[20] & 2)


def _with_article(kind: str) -> str:
    return f"{'an' if kind == IMAGE else 'a'} {kind}"
