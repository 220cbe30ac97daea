"""`--calibration FILE`: what each picture was seen through."""

import os
from collections.abc import Sequence
from pathlib import Path

from mjrun.camera.calibration import lens
from mjrun.camera.motion import CameraMotion
from mjrun.camera.pose import Pose
from mjrun.formats.calibration_writer import CalibrationEntry, CalibrationWriter
from mjrun.job.view import Drawing

FRAME = "%06d.png"  # in a folder


class Calibration:
    """The calibration file of a drawing. Opening it proves that it can be written.

    Args:
      output: of the drawing, whose files it names.
      numbers: whether depth is in 16-bit pictures.

    Raises:
      UsageError: the format cannot describe this drawing.
      FileError: the file cannot be written.
    """

    def __init__(self, job: Drawing, courses: Sequence[CameraMotion], output: str, numbers: bool) -> None:
        assert job.calibration is not None
        self._here, self._size = Path(job.calibration).parent, job.size
        self._names = job.names
        single = [(path, panels[0]) for path, panels in job.outputs(output) if len(panels) == 1]
        self._files = {(p.camera, p.view): path for path, p in single if numbers or p.view != "depth"}
        flat = [name for name, course in zip(self._names, courses, strict=True) if not course.perspective]
        pictures = all(_is_picture(path) for path, _ in job.outputs(output))
        coloured = "depth" in job.views and not numbers
        self.writer = CalibrationWriter(job.calibration, job.calibration_format, self._names, flat, pictures, coloured)

    def write(self, poses: Sequence[Pose], frame: int, time: float) -> None:
        """Adds what every camera saw a frame through; `time` is simulated [s]."""
        for camera, pose in enumerate(poses):
            file, depth = (self._file(camera, view, frame) for view in ("rgb", "depth"))
            self.writer.write(CalibrationEntry(self._names[camera], lens(pose, self._size), frame, time, file, depth))

    def _file(self, camera: int, view: str, frame: int) -> str:
        """The picture of a frame, as seen from the calibration file; empty for none."""
        path = self._files.get((camera, view), "")
        if not path or not _is_picture(path):
            return ""
        if path.endswith("/") or not Path(path).suffix:
            path = str(Path(path) / FRAME)
        name = path % frame if "%" in Path(path).name else path
        return os.path.relpath(name, self._here)


def _is_picture(path: str) -> bool:
    """Whether each frame is in a file of its own."""
    return path != "-" and (path.endswith("/") or Path(path).suffix.lower() in ("", ".png", ".jpg", ".jpeg", ".webp"))
