"""Opening of the files that a command has made, in the programs of the desktop."""

import os
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast

import click

from mjrun.errors import clean, option

PAGES = (".html", ".htm")
VIDEOS = (".mp4", ".webm", ".mkv", ".mov", ".gif", ".apng", ".webp")
IMAGES = (".png", ".jpg", ".jpeg", ".tiff", ".svg", ".pdf")
PATHS = ("path", "paths", "html", "files")  # keys of reports
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


def files_in(document: object) -> Iterator[str]:
    """Yields the paths in the JSON document of a report."""
    if isinstance(document, Mapping):
        for key, value in cast("Mapping[str, object]", document).items():
            if key not in PATHS:
                yield from files_in(value)
            elif isinstance(value, str):
                yield value
            elif isinstance(value, list | tuple):
                yield from map(str, cast("Sequence[object]", value))
    elif isinstance(document, list | tuple):
        for value in cast("Sequence[object]", document):
            yield from files_in(value)


def open_first(paths: Sequence[str]) -> str:
    """Opens the most telling of `paths`: a page, else a video, an image or any other; returns a warning, or nothing."""
    existing = [path for path in paths if Path(path).exists()]
    ranked = [path for suffixes in (PAGES, VIDEOS, IMAGES) for path in existing if path.lower().endswith(suffixes)]
    chosen = next(iter([*ranked, *existing]), None)
    if chosen is None:
        return f"{option('open')}: no file was made"
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in DISPLAYS):
        return f"{option('open')}: {clean(chosen)} is not shown: this session has no display"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # click does not wait for the program
        failed = click.launch(chosen)
    if failed:
        return f"{option('open')}: no program opens {clean(chosen)}; on Linux, install xdg-utils"
    return ""
