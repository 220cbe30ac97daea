"""Mirrors of files below another folder, under their absolute paths, which on Windows begin with a drive or a share."""

import re
from pathlib import Path, PurePath
from typing import TypeVar

VERBATIM = "\\\\?\\"  # the prefix of paths that Windows does not parse
SHARE = "UNC"  # Windows writes \\?\UNC\server\share for the share \\server\share

P = TypeVar("P", Path, PurePath)


def mirrored(root: P, path: P) -> P:
    r"""Returns the place below `root` that mirrors an absolute path: `ROOT\C\models` for `C:\models`."""
    drive = path.drive.removeprefix(VERBATIM)
    if drive.startswith("\\\\"):
        drive = f"{SHARE}\\{drive}"
    names = filter(None, drive.replace(":", "").split("\\"))
    return root.joinpath(*names, *path.parts[1:])


def with_original_paths(text: str, root: PurePath, folder: PurePath) -> str:
    """Returns a text with the originals of the paths below `root`, relative to `folder` if they are in it."""
    text = re.sub(rf"{_spelled(mirrored(root, folder))}[\\/]", "", text)
    if not folder.drive:
        return text.replace(str(root), "")
    drive = rf"(?:[\\/](?:{SHARE}(?=[\\/])|([A-Za-z])(?=[\\/])))?"
    return re.sub(_spelled(root) + drive, lambda match: f"{match[1]}:" if match[1] else "\\", text)


def _spelled(path: PurePath) -> str:
    """Returns a pattern for a path; on Windows, programs write slashes or backslashes."""
    separator = r"[\\/]" if path.drive else "/"
    return separator.join(re.escape(part.rstrip("\\/")) for part in path.parts)
