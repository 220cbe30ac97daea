"""Files that a page shows: within it, or beside it if they are large."""

import base64
import os
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from mjrun.errors import FileError

MEGABYTE = 1_000_000
# What browsers show, by suffix.
IMAGES = {
    ".png": "image/png",
    ".apng": "image/apng",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".gif": "image/gif",
    ".webp": "image/webp",
    ".svg": "image/svg+xml",
}
VIDEOS = {".mp4": "video/mp4", ".m4v": "video/mp4", ".webm": "video/webm", ".mov": "video/mp4"}


@dataclass(frozen=True)
class PageFile:
    """A file that a page shows.

    Attributes:
      path: as it was given.
      kind: its media type; None for what a browser does not show.
      address: its content as a data URI, or where it is as seen from the page.
      size: bytes; None of a folder.
    """

    path: str
    kind: str | None
    address: str
    size: int | None

    @property
    def is_embedded(self) -> bool:
        """Whether the page holds it."""
        return self.address.startswith("data:")


def page_file(path: str, page: str, limit: float) -> PageFile:
    """The file at `path` as the page at `page` shows it.

    Args:
      limit: the size up to which it is embedded [MB].

    Raises:
      FileError: there is none, or it cannot be read.
    """
    file = Path(path)
    kind = (IMAGES | VIDEOS).get(file.suffix.lower())
    try:
        size = None if file.is_dir() else file.stat().st_size
        if kind and size is not None and size <= limit * MEGABYTE:
            content = base64.b64encode(file.read_bytes()).decode()
            return PageFile(path, kind, f"data:{kind};base64,{content}", size)
    except OSError as error:
        raise FileError(file, f"cannot be read: {error.strerror or error}") from None

    beside = os.path.relpath(os.path.realpath(file), Path(os.path.realpath(page)).parent)
    return PageFile(path, kind if size is not None else None, f"./{quote(beside)}", size)
