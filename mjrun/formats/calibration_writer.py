"""Writes calibration files: the camera of each image, in our own format and in those of vision tools.

They differ in the centre of the first pixel: (0.5, 0.5) in our format and in nerfstudio's, (0, 0) in OpenCV and
therefore in BOP and ROS, where the principal point is half a pixel less.
"""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, listing, option
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.model.camera_images import CameraCalibration

CENTER = 0.5  # centre of the first pixel
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # x right, y up, z backward


@dataclass(frozen=True)
class CalibrationEntry:
    """The entry of one image in a calibration file: its camera.

    Attributes:
      camera: name of the camera.
      lens: intrinsics and pose of the camera.
      frame: number of the frame in the video; 0 for an image.
      time: simulated time [s].
      file, depth: paths of the colour image and of the 16-bit depth image in millimetres, relative to the calibration
        file; empty if there is no such image.
    """

    camera: str
    lens: CameraCalibration
    frame: int = 0
    time: float = 0.0
    file: str = ""
    depth: str = ""


@dataclass(frozen=True)
class CalibrationFormat:
    """A format of calibration files.

    Attributes:
      encode: returns the text of one entry.
      head, tail: text before the first and after the last entry; `,` separates entries.
      one: `camera` if a file describes a single camera; `lens` if it describes a single constant lens.
      perspective: whether it describes perspective cameras only.
      image_files: whether it names the file of each image.
      millimetres: whether depth must be in 16-bit images of millimetres.
    """

    encode: Callable[[CalibrationEntry], str]
    head: str = ""
    tail: str = ""
    one: str = ""
    perspective: bool = True
    image_files: bool = False
    millimetres: bool = False


class CalibrationWriter(OutputWriter):
    """A writer of one calibration file, entry by entry. Opening it checks that the output can be written.

    Args:
      format: name in `FORMATS`: `mjrun`, `nerfstudio`, `bop` or `ros`.
      cameras: names of all cameras.
      orthographic: names of the cameras that are not in perspective.
      image_files: whether each image is in a separate file.
      coloured_depth: whether depth is rendered, but not in 16-bit images of millimetres.

    Raises:
      UsageError: the format cannot describe this; the message states why.
      FileError: the output cannot be written.
    """

    def __init__(
        self,
        output: str,
        format: str = "mjrun",  # noqa: A002
        cameras: Sequence[str] = (),
        orthographic: Sequence[str] = (),
        image_files: bool = True,
        coloured_depth: bool = False,
    ) -> None:
        if format not in FORMATS:
            raise UnknownNameError("calibration format", format, list(FORMATS))
        self._name, self._format = format, FORMATS[format]
        if self._format.one and len(cameras) > 1:
            raise self._refusal(f"a file describes one camera, not {len(cameras)}: {listing(cameras)}")
        self._check_image_file(image_files)
        if self._format.millimetres and coloured_depth:
            raise self._refusal(
                f"its depth is in 16-bit PNGs of millimetres; set {option('style')} to exact, or leave depth out"
            )
        for camera in orthographic:
            self._check_perspective(camera, perspective=False)
        self._first: CalibrationEntry | None = None
        super().__init__(StagedFile(Path(output)))
        with self.opening():
            self._file = self.open_file()
            self._file.write(self._format.head.encode())

    def write(self, entry: CalibrationEntry) -> None:
        """Adds the camera of an image.

        Raises:
          UsageError: the format cannot describe it.
          FileError: the disk is full.
        """
        self._check_perspective(entry.camera, entry.lens.perspective)
        self._check_image_file(entry.file != "")
        first, self._first = self._first, self._first or entry
        if self._format.one == "lens" and first is not None:
            if _intrinsics(first.lens) != _intrinsics(entry.lens):
                raise self._refusal(f"a file describes one lens, and this one changes at frame {entry.frame}")
            return
        separator = "" if first is None else ",\n"
        with self.writing():
            self._file.write((separator + self._format.encode(entry)).encode())

    def finish(self) -> None:
        with self.writing():
            self._file.write(self._format.tail.encode())
            self._file.close()
        super().finish()

    def _check_perspective(self, camera: str, perspective: bool) -> None:
        if self._format.perspective and not perspective:
            raise self._refusal(f"it has no orthographic cameras, and {listing([camera])} is one")

    def _check_image_file(self, has_file: bool) -> None:
        if self._format.image_files and not has_file:
            reason = (
                f"it names the file of each colour image: write a folder of PNGs, of one view or {option('separate')}"
            )
            raise self._refusal(reason, instead=False)

    def _refusal(self, reason: str, *, instead: bool = True) -> UsageError:
        name = option("calibration_format")
        able = f"\n{name} mjrun can hold it" if instead else ""
        return UsageError(f"{name} {self._name}: {reason}{able}")


def _intrinsics(lens: CameraCalibration) -> tuple[object, ...]:
    return lens.size, lens.fx, lens.fy, lens.cx, lens.cy


def centered_matrix(lens: CameraCalibration) -> np.ndarray:
    """Returns K `(3, 3)` for pixels whose centres are at whole numbers."""
    matrix = lens.matrix
    matrix[:2, 2] -= CENTER
    return matrix


def _json(**entry: object) -> str:
    return json.dumps({name: value for name, value in entry.items() if value != ""}, allow_nan=False)


def _mjrun(entry: CalibrationEntry) -> str:
    lens = entry.lens
    return _json(
        camera=entry.camera,
        frame=entry.frame,
        time=entry.time,
        file=entry.file,
        depth=entry.depth,
        size=lens.size,
        K=lens.matrix.tolist(),
        world_from_camera=lens.pose.tolist(),
        near=lens.near,
        far=lens.far,
        perspective=lens.perspective,
    )


def _nerfstudio(entry: CalibrationEntry) -> str:
    """Returns a frame of transforms.json (docs.nerf.studio, "Data conventions")."""
    lens = entry.lens
    return _json(
        file_path=entry.file,
        depth_file_path=entry.depth,
        time=entry.time,
        w=lens.size[0],
        h=lens.size[1],
        fl_x=lens.fx,
        fl_y=lens.fy,
        cx=lens.cx,
        cy=lens.cy,
        transform_matrix=(lens.pose @ OPENGL).tolist(),
    )


def _bop(entry: CalibrationEntry) -> str:
    """Returns an image of scene_camera.json (bop_toolkit, bop_datasets_format.md); lengths are in millimetres."""
    rotation = entry.lens.pose[:3, :3].T
    return f"{json.dumps(str(entry.frame))}: " + _json(
        cam_K=centered_matrix(entry.lens).ravel().tolist(),
        depth_scale=1.0,
        cam_R_w2c=rotation.ravel().tolist(),
        cam_t_w2c=(-1000 * rotation @ entry.lens.pose[:3, 3]).tolist(),
    )


def _ros(entry: CalibrationEntry) -> str:
    """Returns a file for camera_calibration_parsers; names of cameras are limited to letters, digits and `_`."""
    lens, matrix = entry.lens, centered_matrix(entry.lens)
    name = re.sub(r"[^A-Za-z0-9_]", "_", entry.camera)
    matrices = {
        "camera_matrix": matrix,
        "distortion_coefficients": np.zeros((1, 5)),
        "rectification_matrix": np.eye(3),
        "projection_matrix": np.column_stack([matrix, np.zeros(3)]),
    }
    lines = [f"image_width: {lens.size[0]}", f"image_height: {lens.size[1]}", f'camera_name: "{name}"']
    lines += ["distortion_model: plumb_bob"]
    for key, values in matrices.items():
        # YAML 1.1 reads 1e-05 as a text, and 1.0e-05 as a number.
        texts = map(repr, values.ravel().tolist())
        data = ", ".join(text if "." in text else text.replace("e", ".0e") for text in texts)
        lines += [f"{key}:", f"  rows: {values.shape[0]}", f"  cols: {values.shape[1]}", f"  data: [{data}]"]
    return "\n".join(lines) + "\n"


FORMATS = {
    "mjrun": CalibrationFormat(
        _mjrun,
        '{"format": "mjrun calibration", "version": 1, "axes": "opencv", "pixel_center": 0.5, "frames": [\n',
        "\n]}\n",
        perspective=False,
    ),
    "nerfstudio": CalibrationFormat(
        _nerfstudio,
        '{"camera_model": "OPENCV", "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "frames": [\n',
        "\n]}\n",
        image_files=True,
    ),
    "bop": CalibrationFormat(_bop, "{\n", "\n}\n", one="camera", millimetres=True),
    "ros": CalibrationFormat(_ros, one="lens"),
}
