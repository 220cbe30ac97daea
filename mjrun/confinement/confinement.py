"""What a process may do that works on files nobody vouches for: `--untrusted`.

Where the kernel does not confine it, paths are checked before they are opened; they are everywhere.
"""

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mjrun.errors import UsageError, option

VARIABLE = "MJRUN_CONFINEMENT"  # by which the processes that a confined one starts know that they are
CHECKS = "checks of paths"
MAGIC = "/proc/"  # whose links lead where other processes are
LINKS = 40  # that the system follows in a path


@dataclass(frozen=True)
class Confinement:
    """What a confined process may do.

    Attributes:
      roots: the folders that models and documents may name files in.
      files: files and folders that the user has named, which may be read too.
      written: folders that outputs are written in.
      temporary: the folder of temporary files.
      by: what keeps it from reading and writing other files.
      network: what keeps it from the network; empty if nothing does.
      own_port: the descriptor of a socket at the port that it can connect to, where it serves; -1 elsewhere.
    """

    roots: tuple[str, ...]
    files: tuple[str, ...] = ()
    written: tuple[str, ...] = ()
    temporary: str = ""
    by: str = CHECKS
    network: str = ""
    own_port: int = -1

    def allows(self, path: str | Path) -> bool:
        """Whether a model or a document may name the file `path`, which need not exist."""
        real = _real(path)
        return any(is_within(real, place) for place in (*self.roots, *self.files, self.temporary))

    def facts(self) -> dict[str, object]:
        """What a report says of it."""
        return {"roots": list(self.roots), "files": self.by, "network": self.network or "not confined"}


def confinement() -> Confinement | None:
    """How this process is confined; None if it is not."""
    text = os.environ.get(VARIABLE)
    return _parsed(text) if text else None


def require_unconfined(what: str) -> None:
    """Checks that this process is not confined, which `what` does not go with.

    Raises:
      UsageError: it is.
    """
    if confinement():
        raise UsageError(f"{what}, which {option('untrusted')} does not allow")


def is_readable(path: str | Path) -> bool:
    """Whether a model or a document may name the file `path`: any, unless this process is confined."""
    limits = confinement()
    return limits is None or limits.allows(path)


def is_writable(path: str | Path) -> bool:
    """Whether outputs may be written at `path`: anywhere, unless this process is confined."""
    limits = confinement()
    return limits is None or any(is_within(_real(path), place) for place in (*limits.written, limits.temporary))


def tells_of_processes(path: str | Path) -> bool:
    """Whether what there is at a path depends on the processes that there are, since it leads through /proc."""
    return f"{_real(path) or MAGIC}/".startswith(MAGIC)


OUTSIDE = "lies outside the folder that files are read from"


def advice() -> str:
    """What to do when a model or a document names a file outside."""
    return f"{option('untrusted')} reads what is beside the model and what you name; {option('root')} chooses a folder"


@cache
def _parsed(text: str) -> Confinement:
    values = json.loads(text)
    roots, files, written = (tuple(map(str, values.pop(name))) for name in ("roots", "files", "written"))
    return Confinement(roots, files, written, **values)


def _real(path: str | Path) -> str:
    """Where a path leads, which need not exist; empty if it leads by a link of another process, or by too many.

    `os.path.realpath` follows the links of /proc: then a path would tell which processes there are.
    """
    links, place = 0, "/"
    waiting = os.path.join(os.getcwd(), path).split("/")[::-1]  # noqa: PTH109, PTH118 – as it is, with ..
    while waiting:
        name = waiting.pop()
        if name == "..":
            place = os.path.dirname(place)  # noqa: PTH120
        elif name not in ("", "."):
            place = os.path.join(place, name)  # noqa: PTH118
            try:
                target = os.readlink(place)  # noqa: PTH115
            except (OSError, ValueError):  # it is no link, or not there, or no file can be called so
                continue
            links += 1
            if place.startswith(MAGIC) or links > LINKS:
                return ""
            place = os.path.dirname(place)  # noqa: PTH120
            if target.startswith("/"):
                place = "/"
            waiting += target.split("/")[::-1]
    return place


def is_within(path: str, folder: str) -> bool:
    """Whether a path is that of a folder, or of what is below it, as they are written."""
    return bool(folder) and (path == folder or path.startswith(folder.rstrip("/") + "/"))
