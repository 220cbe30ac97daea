"""Hostile models: the files to write, and the right results of mjrun. All files are generated."""

import os
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

Codes = frozenset[int]
LOADED: Codes = frozenset({0})
REFUSED: Codes = frozenset({3})
EITHER = LOADED | REFUSED
RUNS: Codes = frozenset({0, 4})  # of a model that loads: it is simulated, or becomes unstable
DRAWN: Codes = frozenset({0, 4, 5})  # it is drawn, unstable at its start, or told that it cannot be drawn
USAGE: Codes = frozenset({2})


@dataclass(frozen=True)
class Link:
    """A symbolic link."""

    to: str


class Fifo:
    """A named pipe."""


class Socket:
    """A socket of the file system."""


class Folder:
    """An empty folder."""


Content = str | bytes | Link | Fifo | Socket | Folder | Callable[[], bytes]


@dataclass(frozen=True)
class Form:
    """One hostile model.

    Attributes:
      name: a unique description.
      files: the files to write, by path.
      model: the file that commands get.
      loads: exit codes of a command that only loads it; None where MuJoCo's own verdict decides.
      runs: exit codes of a simulation, if it loads.
      drawn: true if it is rendered as well.
      draws: exit codes of rendering it, if it loads.
    """

    name: str
    files: Mapping[str, Content]
    model: str = "model.xml"
    loads: Codes | None = None
    runs: Codes = RUNS
    drawn: bool = False
    draws: Codes = DRAWN

    def write(self, folder: Path) -> None:
        """Writes its files into a folder."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            match content:
                case str():
                    path.write_text(content, encoding="utf-8", newline="")
                case bytes():
                    path.write_bytes(content)
                case Link():
                    path.symlink_to(content.to)
                case Fifo():
                    os.mkfifo(path)
                case Socket():
                    with socket.socket(socket.AF_UNIX) as server:
                        server.bind(str(path))
                case Folder():
                    path.mkdir()
                case _:
                    path.write_bytes(content())


def mjcf(inner: str, attributes: str = "") -> str:
    """Returns a model around some elements."""
    return f"<mujoco{attributes and ' '}{attributes}>\n{inner}\n</mujoco>\n"


def simple(
    name: str,
    inner: str,
    loads: Codes | None = None,
    files: Mapping[str, Content] | None = None,
    runs: Codes = RUNS,
    drawn: bool = False,
) -> Form:
    """Returns a form that is one MJCF with these elements, and the files that it names."""
    return Form(name, {"model.xml": mjcf(inner), **(files or {})}, loads=loads, runs=runs, drawn=drawn)
