"""The limits of a process that works on untrusted files, the option `--untrusted`.

Paths are checked before they are opened, whether the kernel confines the process or not.
"""

import os
from functools import cache
from pathlib import Path

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, option

VARIABLE = "MJRUN_CONFINEMENT"  # the environment variable with the limits, for the processes that a confined one starts
CHECKS = "checks of paths"
MAGIC = "/proc/"  # a folder whose links may lead to places of other processes
LINKS = 40  # the number of links that the system follows in a path


@dataclass(frozen=True)
class Confinement:
    """The limits of a confined process.

    Attributes:
      roots: the folders in which models and documents may name files.
      files: files and folders that the user has named, which may be read, too.
      written: the folders that outputs are written in.
      temporary: the folder of temporary files.
      by: the mechanism that prevents reading and writing other files.
      network: the mechanism that prevents network access; empty without one.
      own_port: the descriptor of a socket at the only port that it can connect to, if it serves; otherwise −1.
    """

    roots: tuple[str, ...]
    files: tuple[str, ...] = ()
    written: tuple[str, ...] = ()
    temporary: str = ""
    by: str = CHECKS
    network: str = ""
    own_port: int = -1

    def allows(self, path: str | Path) -> bool:
        """Returns whether a model or a document may name the file `path`, which need not exist."""
        real = _real(path)
        return any(is_within(real, place) for place in (*self.roots, *self.files, self.temporary))

    def facts(self) -> dict[str, object]:
        """Returns the limits as a report states them."""
        return {"roots": list(self.roots), "files": self.by, "network": self.network or "not confined"}


def confinement() -> Confinement | None:
    """Returns the limits of this process; None if it is not confined."""
    text = os.environ.get(VARIABLE)
    return _parsed(text) if text else None


def require_unconfined(what: str) -> None:
    """Checks that this process is not confined.

    Args:
      what: a sentence about something that confinement forbids, `x.py:f is code`.

    Raises:
      UsageError: it is confined.
    """
    if confinement():
        raise UsageError(f"{what}, which {option('untrusted')} does not allow")


def is_readable(path: str | Path) -> bool:
    """Returns whether a model or a document may name the file `path`: always, unless this process is confined."""
    limits = confinement()
    return limits is None or limits.allows(path)


def is_writable(path: str | Path) -> bool:
    """Returns whether outputs may be written at `path`: anywhere, unless this process is confined."""
    limits = confinement()
    return limits is None or any(is_within(_real(path), place) for place in (*limits.written, limits.temporary))


def depends_on_processes(path: str | Path) -> bool:
    """Returns whether the existence of a path depends on other processes, because it leads through /proc."""
    return f"{_real(path) or MAGIC}/".startswith(MAGIC)


OUTSIDE = "is outside the folder that files are read from"


def advice() -> str:
    """Returns the remedy for a model or a document that names a file outside."""
    return (
        f"{option('untrusted')} reads files next to the model and files that you name; {option('root')} sets the folder"
    )


@cache
def _parsed(text: str) -> Confinement:
    import json

    values = json.loads(text)
    roots, files, written = (tuple(map(str, values.pop(name))) for name in ("roots", "files", "written"))
    return Confinement(roots, files, written, **values)


def _real(path: str | Path) -> str:
    """Returns the target of a path, which need not exist; empty for a link of a process, or for too many links.

    `os.path.realpath` follows the links of /proc: a path could then reveal which processes exist.
    """
    links, place = 0, "/"
    waiting = os.path.join(os.getcwd(), path).split("/")[::-1]  # noqa: PTH109, PTH118 – unchanged, including ..
    while waiting:
        name = waiting.pop()
        if name == "..":
            place = os.path.dirname(place)  # noqa: PTH120
        elif name not in ("", "."):
            place = os.path.join(place, name)  # noqa: PTH118
            try:
                target = os.readlink(place)  # noqa: PTH115
            except (OSError, ValueError):  # it is not a link, does not exist, or cannot be the name of a file
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
    """Returns whether a path is that of a folder, or of something below it, as written."""
    return bool(folder) and (path == folder or path.startswith(folder.rstrip("/") + "/"))
