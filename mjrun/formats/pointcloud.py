"""Point clouds: the visible points of images, with their colours, in a PLY file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, clean
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.model.camera_images import CameraImages, SegmentedObject

SUFFIX = ".ply"
TYPES = {"<f4": "float", "u1": "uchar", "<i4": "int"}
PLACE = (("x", "<f4"), ("y", "<f4"), ("z", "<f4"))
COLOR = (("red", "u1"), ("green", "u1"), ("blue", "u1"))
LABEL = (("label", "<i4"),)
COUNT = 20  # most digits in the number of points


class PointCloudWriter(OutputWriter):
    """A writer of the points of images, one image after another, to a binary little-endian PLY file.

    A point is the end of the ray through the centre of a pixel; pixels of the background have none. Opening the writer
    checks that the output can be written.

    Args:
      legend: legend of the images, if each point gets a `label`, the index of its segment.

    Raises:
      UsageError: the output does not end in `.ply`.
      FileError: the output cannot be written.
    """

    def __init__(self, output: str, legend: Sequence[SegmentedObject] | None = None) -> None:
        if Path(output).suffix.lower() != SUFFIX:
            message = f"{clean(output)}: a point cloud is a PLY file; its name must end in {SUFFIX}"
            raise UsageError(message, path=("pointcloud",))
        self.count = 0
        self._fields = [*PLACE, *COLOR, *(LABEL if legend is not None else ())]
        self._legend = legend or ()
        super().__init__(StagedFile(Path(output)))
        with self.opening():
            self._file = self.open_file()
            self._file.write(self._header())

    def write(self, view: CameraImages) -> None:
        """Adds the points of an image with depth and colours, and with ids if points are labelled.

        Raises:
          FileError: the disk is full.
        """
        points = self._points(view)
        with self.writing():
            self._file.write(points.tobytes())
        self.count += len(points)

    def finish(self) -> None:
        with self.writing():
            self._file.seek(0)
            self._file.write(self._header())
            self._file.close()
        super().finish()

    def _points(self, view: CameraImages) -> np.ndarray:
        """Returns the points as a structured array `(n,)`, row by row."""
        depth, rgb, ids = view.depth, view.rgb, view.ids
        labelled = LABEL[0] in self._fields
        if depth is None or rgb is None or (labelled and ids is None):
            raise ValueError("an image for a point cloud needs depth and rgb, and ids for labels")
        seen = np.isfinite(depth)
        places = view.calibration.unproject(np.where(seen, depth, 0.0))[seen]
        columns = [*places.T, *rgb[seen].T, *([ids[seen]] if labelled and ids is not None else [])]
        points = np.empty(len(places), np.dtype(self._fields))
        for (name, _), column in zip(self._fields, columns, strict=True):
            points[name] = column
        return points

    def _header(self) -> bytes:
        """Returns the header, which has the same length for every count: a comment is padded."""
        number = str(self.count)
        lines = ["ply", "format binary_little_endian 1.0"]
        lines += [f"comment world coordinates in metres{' ' * (COUNT - len(number))}"]
        lines += [
            f"comment label {i}: {segment.type} '{_plain(segment.name)}'" for i, segment in enumerate(self._legend)
        ]
        lines += [f"element vertex {number}", *(f"property {TYPES[kind]} {name}" for name, kind in self._fields)]
        return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _plain(name: str) -> str:
    """Returns `name` in printable ASCII."""
    return clean(name).encode("ascii", "backslashreplace").decode()
