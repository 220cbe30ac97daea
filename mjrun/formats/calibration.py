"""Calibration files: what each picture was seen through, in our own format and in those of vision tools.

They differ in where a pixel's centre lies. It is at (0.5, 0.5) for us and for nerfstudio; it is at (0, 0) for
OpenCV, and so for BOP and ROS: there the principal point is half a pixel less.
"""

import contextlib
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np

from mjrun.errors import FileError, UnknownNameError, UsageError, listing
from mjrun.formats.publishing import Completable, StagedFile
from mjrun.model.rendered_view import CameraCalibration

CENTER = 0.5  # of the first pixel
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # x right, y up, z backward


@dataclass(frozen=True)
class Exposure:
    """How one picture was taken.

    Attributes:
      camera: what it is called.
      frame: number in the film; 0 for a still.
      time: simulated [s].
      file, depth: the colour picture and the 16-bit depth picture in millimetres, as seen from the
        calibration file; empty for none.
    """

    camera: str
    lens: CameraCalibration
    frame: int = 0
    time: float = 0.0
    file: str = ""
    depth: str = ""


@dataclass(frozen=True)
class Format:
    """A kind of calibration file.

    Attributes:
      entry: one picture.
      head, tail: what stands before the first and after the last, `,` between two.
      one: `camera`, when a file describes one; `lens`, when it describes one that never changes.
      perspective: whether it can describe nothing else.
      pictures: whether it names the file of each picture.
    """

    entry: Callable[[Exposure], str]
    head: str = ""
    tail: str = ""
    one: str = ""
    perspective: bool = True
    pictures: bool = False
    millimetres: bool = False


class CalibrationWriter(Completable):
    """Writes one calibration file, entry by entry. Opening it proves that the output can be written.

    Leave the context without `publish` and no trace of the file is left.

    Args:
      format: of `FORMATS`: `mjrun`, `nerfstudio`, `bop` or `ros`.
      cameras: what the cameras of the film are called.
      orthographic: those of them that are not in perspective.
      pictures: whether each picture will be in a file of its own.
      coloured_depth: whether depth is drawn, but not in 16-bit pictures of millimetres.

    Raises:
      UsageError: the format cannot describe this; the message says why.
      FileError: the output cannot be written.
    """

    def __init__(
        self,
        output: str,
        format: str = "mjrun",  # noqa: A002  (the word users know)
        cameras: Sequence[str] = (),
        orthographic: Sequence[str] = (),
        pictures: bool = True,
        coloured_depth: bool = False,
    ) -> None:
        if format not in FORMATS:
            raise UnknownNameError("calibration format", format, list(FORMATS))
        self._name, self._format = format, FORMATS[format]
        if self._format.one and len(cameras) > 1:
            raise self._refusal(f"a file is about one camera, not {len(cameras)}: {listing(cameras)}")
        self._check_picture(pictures)
        if self._format.millimetres and coloured_depth:
            raise self._refusal("it speaks of depth in 16-bit PNGs of millimetres; add --style exact, or leave it out")
        for camera in orthographic:
            self._check_perspective(camera, perspective=False)
        self._first: Exposure | None = None
        self._target = StagedFile(Path(output))
        try:
            self._file = Path(self._target.path).open("w", encoding="utf-8")  # noqa: SIM115  (closed by close)
            self._file.write(self._format.head)
        except OSError as error:
            self._target.discard()
            raise self._unwritable(error) from None

    def write(self, exposure: Exposure) -> None:
        """Adds a picture.

        Raises:
          UsageError: the format cannot describe it.
          FileError: the disk is full.
        """
        self._check_perspective(exposure.camera, exposure.lens.perspective)
        self._check_picture(exposure.file != "")
        first, self._first = self._first, self._first or exposure
        if self._format.one == "lens" and first is not None:
            if _intrinsics(first.lens) != _intrinsics(exposure.lens):
                raise self._refusal(f"a file is about one lens, and this one changes at frame {exposure.frame}")
            return
        separator = "" if first is None else ",\n"
        try:
            self._file.write(separator + self._format.entry(exposure))
        except OSError as error:
            raise self._unwritable(error) from None

    def complete(self) -> None:
        try:
            self._file.write(self._format.tail)
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

    def __enter__(self) -> "CalibrationWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_perspective(self, camera: str, perspective: bool) -> None:
        if self._format.perspective and not perspective:
            raise self._refusal(f"it knows no orthographic camera, and {listing([camera])} is one")

    def _check_picture(self, has_file: bool) -> None:
        if self._format.pictures and not has_file:
            reason = "it names the file of each colour picture: write PNGs, as in -o frames/, of one view or --separate"
            raise self._refusal(reason, instead=False)

    def _refusal(self, reason: str, *, instead: bool = True) -> UsageError:
        able = "\n--calibration-format mjrun can say it" if instead else ""
        return UsageError(f"--calibration-format {self._name}: {reason}{able}")

    def _unwritable(self, error: OSError) -> FileError:
        return FileError(self._target.shown, f"cannot be written: {error.strerror or error}")


def _intrinsics(lens: CameraCalibration) -> tuple[object, ...]:
    return lens.size, lens.fx, lens.fy, lens.cx, lens.cy


def _centered(lens: CameraCalibration) -> np.ndarray:
    """K `(3, 3)` of pixels whose centres are at whole numbers."""
    matrix = lens.matrix
    matrix[:2, 2] -= CENTER
    return matrix


def _json(**entry: object) -> str:
    return json.dumps({name: value for name, value in entry.items() if value != ""}, allow_nan=False)


def _mjrun(exposure: Exposure) -> str:
    lens = exposure.lens
    return _json(
        camera=exposure.camera,
        frame=exposure.frame,
        time=exposure.time,
        file=exposure.file,
        depth=exposure.depth,
        size=lens.size,
        K=lens.matrix.tolist(),
        world_from_camera=lens.pose.tolist(),
        near=lens.near,
        far=lens.far,
        perspective=lens.perspective,
    )


def _nerfstudio(exposure: Exposure) -> str:
    """A frame of transforms.json (docs.nerf.studio, "Data conventions")."""
    lens = exposure.lens
    return _json(
        file_path=exposure.file,
        depth_file_path=exposure.depth,
        time=exposure.time,
        w=lens.size[0],
        h=lens.size[1],
        fl_x=lens.fx,
        fl_y=lens.fy,
        cx=lens.cx,
        cy=lens.cy,
        transform_matrix=(lens.pose @ OPENGL).tolist(),
    )


def _bop(exposure: Exposure) -> str:
    """A picture of scene_camera.json (bop_toolkit, bop_datasets_format.md); lengths are in millimetres."""
    rotation = exposure.lens.pose[:3, :3].T
    return f"{json.dumps(str(exposure.frame))}: " + _json(
        cam_K=_centered(exposure.lens).ravel().tolist(),
        depth_scale=1.0,
        cam_R_w2c=rotation.ravel().tolist(),
        cam_t_w2c=(-1000 * rotation @ exposure.lens.pose[:3, 3]).tolist(),
    )


def _ros(exposure: Exposure) -> str:
    """What camera_calibration_parsers reads; a camera's name may hold letters, digits and `_` only."""
    lens, matrix = exposure.lens, _centered(exposure.lens)
    name = re.sub(r"[^A-Za-z0-9_]", "_", exposure.camera)
    matrices = {
        "camera_matrix": matrix,
        "distortion_coefficients": np.zeros((1, 5)),
        "rectification_matrix": np.eye(3),
        "projection_matrix": np.column_stack([matrix, np.zeros(3)]),
    }
    lines = [f"image_width: {lens.size[0]}", f"image_height: {lens.size[1]}", f'camera_name: "{name}"']
    lines += ["distortion_model: plumb_bob"]
    for key, values in matrices.items():
        data = ", ".join(map(_yaml_number, values.ravel().tolist()))
        lines += [f"{key}:", f"  rows: {values.shape[0]}", f"  cols: {values.shape[1]}", f"  data: [{data}]"]
    return "\n".join(lines) + "\n"


def _yaml_number(value: float) -> str:
    """`1.0e-05`: without the point YAML 1.1 has a text there."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")


FORMATS = {
    "mjrun": Format(
        _mjrun,
        '{"format": "mjrun calibration", "version": 1, "axes": "opencv", "pixel_center": 0.5, "pictures": [\n',
        "\n]}\n",
        perspective=False,
    ),
    "nerfstudio": Format(
        _nerfstudio,
        '{"camera_model": "OPENCV", "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "frames": [\n',
        "\n]}\n",
        pictures=True,
    ),
    "bop": Format(_bop, "{\n", "\n}\n", one="camera", millimetres=True),
    "ros": Format(_ros, one="lens"),
}
