"""The calibration file of a drawing: the camera that each picture was taken with."""

import os
from collections.abc import Sequence
from pathlib import Path

from mjrun.camera.calibration import lens
from mjrun.camera.motion import CameraMotion
from mjrun.camera.pose import Pose
from mjrun.formats.calibration_writer import CalibrationEntry, CalibrationWriter
from mjrun.options.view import ViewOptions
from mjrun.outputs.drawing_files import DrawingFile, camera_names

FRAME_NAME = "%06d.png"  # in a folder


class DrawingCalibration:
    """Writes the calibration file of a drawing. Opening it proves that it can be written.

    Args:
      motions: of the cameras.
      files: of the drawing, which the calibration file refers to.
      numbers: whether depth is in 16-bit pictures.

    Raises:
      UsageError: the format cannot describe this drawing.
      FileError: the file cannot be written.
    """

    def __init__(
        self, options: ViewOptions, motions: Sequence[CameraMotion], files: Sequence[DrawingFile], numbers: bool
    ) -> None:
        assert options.calibration is not None
        self._folder, self._size = Path(options.calibration).parent, options.size
        self._names = camera_names(options)
        single = [(file.path, file.panels[0]) for file in files if len(file.panels) == 1]
        self._files = {(p.camera, p.view): path for path, p in single if numbers or p.view != "depth"}
        orthographic = [name for name, motion in zip(self._names, motions, strict=True) if not motion.perspective]
        pictures = all(_is_picture(file.path) for file in files)
        coloured = "depth" in options.view and not numbers
        self.writer = CalibrationWriter(
            options.calibration, options.calibration_format, self._names, orthographic, pictures, coloured
        )

    def write(self, poses: Sequence[Pose], frame: int, time: float) -> None:
        """Adds the calibration of every camera at a frame; `time` is simulated [s]."""
        for camera, pose in enumerate(poses):
            file, depth = (self._file(camera, view, frame) for view in ("rgb", "depth"))
            self.writer.write(CalibrationEntry(self._names[camera], lens(pose, self._size), frame, time, file, depth))

    def _file(self, camera: int, view: str, frame: int) -> str:
        """The picture of a frame, as seen from the calibration file; empty for none."""
        path = self._files.get((camera, view), "")
        if not path or not _is_picture(path):
            return ""
        if path.endswith("/") or not Path(path).suffix:
            path = str(Path(path) / FRAME_NAME)
        name = path % frame if "%" in Path(path).name else path
        return os.path.relpath(name, self._folder)


def _is_picture(path: str) -> bool:
    """Whether each frame is in a file of its own."""
    return path != "-" and (path.endswith("/") or Path(path).suffix.lower() in ("", ".png", ".jpg", ".jpeg", ".webp"))
