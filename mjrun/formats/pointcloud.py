"""Point clouds: what pictures saw, as coloured points in the world, in a PLY file."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from mjrun.errors import FileError, UsageError, clean
from mjrun.formats.publishing import Completable, StagedFile
from mjrun.model.rendered_view import RenderedView, Segment

SUFFIX = ".ply"
TYPES = {"<f4": "float", "u1": "uchar", "<i4": "int"}
PLACE = (("x", "<f4"), ("y", "<f4"), ("z", "<f4"))
COLOR = (("red", "u1"), ("green", "u1"), ("blue", "u1"))
LABEL = (("label", "<i4"),)
COUNT = 20  # digits that a number of points may have


class PointCloudWriter(Completable):
    """Writes the points of pictures, those of several one after the other, to a binary little-endian PLY file.

    A point is where the ray through the centre of a pixel ends; pixels in which nothing is seen have none.
    Opening it proves that the output can be written. Leave the context without `publish` and no trace of the
    file is left.

    Args:
      legend: of the pictures, if each point shall tell as `label` which thing in it it belongs to.

    Raises:
      UsageError: the output is no `.ply`.
      FileError: the output cannot be written.
    """

    def __init__(self, output: str, legend: Sequence[Segment] | None = None) -> None:
        if Path(output).suffix.lower() != SUFFIX:
            raise UsageError(f"{output}: a point cloud is a PLY file, and its name ends in {SUFFIX}")
        self.count = 0
        self._fields = [*PLACE, *COLOR, *(LABEL if legend is not None else ())]
        self._legend = legend or ()
        self._target = StagedFile(Path(output))
        try:
            self._file = Path(self._target.path).open("wb")  # noqa: SIM115  (closed by close)
            self._file.write(self._header())
        except OSError as error:
            self._target.discard()
            raise self._unwritable(error) from None

    def write(self, picture: RenderedView) -> None:
        """Adds the points of a picture, which has depth and colours, and ids if points are labelled.

        Raises:
          FileError: the disk is full.
        """
        points = self._points(picture)
        try:
            self._file.write(points.tobytes())
        except OSError as error:
            raise self._unwritable(error) from None
        self.count += len(points)

    def complete(self) -> None:
        try:
            self._file.seek(0)
            self._file.write(self._header())
            self._file.close()
        except OSError as error:
            raise self._unwritable(error) from None

    def publish(self) -> list[Path]:
        """Ends the file, puts it in its place, and says which that is.

        Raises:
          FileError: it cannot be written.
        """
        self.finish()
        return self._target.publish()

    def close(self) -> None:
        """Removes what is not published."""
        with contextlib.suppress(OSError):  # what it still holds need not be written
            self._file.close()
        self._target.discard()

    def __enter__(self) -> "PointCloudWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _points(self, picture: RenderedView) -> np.ndarray:
        """A structured array `(n,)`, row by row."""
        depth, rgb, ids = picture.depth, picture.rgb, picture.ids
        labelled = LABEL[0] in self._fields
        if depth is None or rgb is None or (labelled and ids is None):
            raise ValueError("a picture for a point cloud needs depth and rgb, and ids for labels")
        seen = np.isfinite(depth)
        places = picture.calibration.unproject(np.where(seen, depth, 0.0))[seen]
        columns = [*places.T, *rgb[seen].T, *([ids[seen]] if labelled and ids is not None else [])]
        points = np.empty(len(places), np.dtype(self._fields))
        for (name, _), column in zip(self._fields, columns, strict=True):
            points[name] = column
        return points

    def _header(self) -> bytes:
        """Of the same length for every count: a comment makes up for its digits."""
        number = str(self.count)
        lines = ["ply", "format binary_little_endian 1.0"]
        lines += [f"comment world coordinates in metres{' ' * (COUNT - len(number))}"]
        lines += [f"comment label {i}: {thing.type} '{_plain(thing.name)}'" for i, thing in enumerate(self._legend)]
        lines += [f"element vertex {number}", *(f"property {TYPES[kind]} {name}" for name, kind in self._fields)]
        return "\n".join([*lines, "end_header", ""]).encode("ascii")

    def _unwritable(self, error: OSError) -> FileError:
        return FileError(self._target.shown, f"cannot be written: {error.strerror or error}")


def _plain(name: str) -> str:
    """`name` in printable ASCII."""
    return clean(name).encode("ascii", "backslashreplace").decode()
