"""Folders of ranges of points: processes that work on other points of a large study do not lengthen each other's lists.

A file that concerns a range of points has a name that begins with `STUDY-FIRST-LAST-`. It is in the smallest of some
nested folders `STUDY-FIRST-LAST.points` whose range contains its own, and beside these folders if none does. In small
studies, all files are in one folder.
"""

import re
from collections.abc import Callable, Iterator

from mjrun.dataclass import dataclass
from mjrun.formats.local_and_remote_folders import Folder

SUFFIX = ".points"
SIZES = (2**24, 2**16, 2**12)  # points in a folder, in those within it, and in those within these
NAMED = 16  # digits of the hash of a study in names
NAME = re.compile(rf"([0-9a-f]{{{NAMED}}})-(\d{{1,18}})-(\d{{1,18}})(?:-([0-9a-f]{{8,{NAMED}}}))?\.[a-z]+")


@dataclass(frozen=True)
class PointRange:
    """The range of points from `first` to `last`, which is included, of the study whose hash begins with `study`."""

    study: str
    first: int
    last: int

    @classmethod
    def of(cls, name: str) -> "PointRange | None":
        """Returns the range that the name of a file or a folder states."""
        match = NAME.fullmatch(name.rpartition("/")[2])
        return cls(match[1], int(match[2]), int(match[3])) if match else None

    def overlaps(self, first: int, last: int) -> bool:
        """Returns whether any of these points is in the range."""
        return self.first <= last and first <= self.last


class RangeFolders:
    """The folders of the ranges of one study, which has `points` points; names of files in them are relative paths.

    Args:
      folder: folder that contains them, and files of small studies.
      study: hash of everything that determines the results of all points.

    Attributes:
      window: points of a folder of innermost folders: as far as they go, a process looks at files of others at once.
    """

    def __init__(self, folder: Folder, study: str, points: int) -> None:
        self.folder, self.study = folder, study[:NAMED]
        self.window = SIZES[-2]
        self._sizes = [size for size in SIZES if size < points]

    def new_name(self, first: int, last: int, end: str) -> str:
        """Returns the name `STUDY-FIRST-LAST-END` of a file of points, whose folder is created.

        Raises:
          FileError: the folder cannot be created.
        """
        place = ""
        for size in self._sizes if first <= last else ():
            start = first // size * size
            if last >= start + size:
                break
            place += f"{self.study}-{start}-{start + size - 1}{SUFFIX}"
            (self.folder / place).create(is_cleaned=False)
            place += "/"
        return f"{place}{self.study}-{first}-{last}-{end}"

    def names(self, suffix: str, is_relevant: Callable[[PointRange], bool] = lambda _: True) -> list[str]:
        """Returns the names of files with a suffix, except those in folders of ranges that are not relevant.

        Raises:
          FileError: a folder cannot be read.
        """

        def within(folder: Folder, place: str) -> Iterator[str]:
            for name in folder.names((suffix, SUFFIX)):
                if not name.endswith(SUFFIX):
                    yield place + name
                elif (points := PointRange.of(name)) and is_relevant(points):
                    yield from within(folder / name, f"{place}{name}/")

        return [*within(self.folder, "")]

    def folders(self) -> list[Folder]:
        """Returns the folder and all those in it, inner ones first.

        Raises:
          FileError: a folder cannot be read.
        """

        def within(folder: Folder) -> Iterator[Folder]:
            for name in folder.names(SUFFIX):
                if PointRange.of(name):
                    yield from within(folder / name)
            yield folder

        return [*within(self.folder)]

    def remove_empty(self) -> None:
        """Removes folders of ranges that contain nothing.

        Raises:
          FileError: a folder cannot be read.
        """
        for folder in self.folders()[:-1]:
            folder.remove_if_empty()
