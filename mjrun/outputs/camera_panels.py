"""Panels, one for each view through each camera; the file of each panel; and the calibration of the images."""

import os
from collections.abc import Sequence
from pathlib import Path

from mjrun.camera.pose import CameraPose, lens
from mjrun.camera.script import CameraScript, short_name
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, option
from mjrun.formats.calibration_writer import CalibrationEntry, CalibrationWriter
from mjrun.formats.output_writer import FRAME_NAME, frame_name
from mjrun.formats.segmentation_labels import labels_beside
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.output import named_files
from mjrun.rendering.compositor import (
    VIEW_NAMES,
    CameraPanel,
    FrameComposition,
    FrameSpec,
    TextAndLivePlots,
    layout_size,
)
from mjrun.rendering.visual import colour_options


@dataclass(frozen=True)
class VideoOrImageFile:
    """A file of a video or an image, with its panels.

    Attributes:
      exact: whether it stores the numbers of its single panel, depth or ids, rather than colours.
    """

    path: str
    panels: Sequence[CameraPanel]
    exact: bool = False

    @property
    def target(self) -> str | None:
        """The path; None for standard output."""
        return None if self.path == "-" else self.path

    @property
    def is_labelled(self) -> bool:
        """True if a separate file describes its ids."""
        return self.target is not None and [panel.view for panel in self.panels] == ["seg"]

    def frame_spec(self, options: ViewOptions, overlay: TextAndLivePlots, legend: bool = False) -> FrameSpec:
        """Returns the spec of its frames.

        Args:
          legend: whether coloured segmentations list what is in view.
        """
        composition = FrameComposition(
            options.layout, options.captions, legend, TextAndLivePlots() if self.exact else overlay
        )
        return FrameSpec(self.panels, options.size, composition, self.exact)


def camera_names(options: ViewOptions) -> list[str]:
    """Returns the names of the cameras: arguments in full where the short names of several are equal."""
    short = [short_name(camera) for camera in options.camera]
    return [
        name if short.count(name) == 1 or isinstance(camera, CameraScript) else str(camera)
        for name, camera in zip(short, options.camera, strict=True)
    ]


def panels_of(options: ViewOptions) -> list[CameraPanel]:
    """Returns a panel for every view through every camera."""
    return [CameraPanel(index, view) for index in range(len(options.camera)) for view in options.view]


def frame_size(options: ViewOptions) -> tuple[int, int]:
    """Returns width and height of a frame with its panels, without plots [pixels]."""
    return layout_size(1 if options.separate else len(panels_of(options)), options.size, options.layout)


def panel_files(options: ViewOptions, output: str) -> list[VideoOrImageFile]:
    """Returns the files of an output: one, or one for each panel if they are separate.

    Raises:
      UsageError: several files would go to standard output, or numbers would share one image.
    """
    panels = panels_of(options)
    if not options.separate or len(panels) == 1:
        return [VideoOrImageFile(output, panels, _is_exact(options, panels))]
    if output == "-":
        raise UsageError(f"{option('separate')} writes several files; standard output holds only one")
    paths = [_numbered(output, name) for name in _suffixes(options)]
    return [
        VideoOrImageFile(path, [panel], _is_exact(options, [panel])) for path, panel in zip(paths, panels, strict=True)
    ]


def output_files(options: ViewOptions, output: str, manifest: str | None) -> list[tuple[str, str]]:
    """Returns every file that an output writes, with its role: frames, labels, calibration and manifest."""
    files = panel_files(options, output)
    labels = [labels_beside(file.path) for file in files if file.is_labelled]
    outputs = [("output", path) for path in [*(file.path for file in files), *labels]]
    return [*outputs, *named_files(calibration=options.calibration, manifest=manifest)]


def unused_options(options: ViewOptions, plot: Sequence[str] = (), *, is_exact: bool = False) -> list[str]:
    """Returns warnings about options for colour images that no image shows.

    Args:
      is_exact: whether the output is numeric.
    """
    pictorial = {
        "text": options.text is not None,
        "captions": options.captions,
        "depth_range": options.depth_range is not None,
        "plot": bool(plot),
    }
    names = [option(name) for name, is_used in pictorial.items() if is_used and is_exact]
    hidden = [] if "rgb" in options.view else colour_options(options)
    warnings: list[str] = []
    if names:
        hint = f"{option('style')} color renders colours"
        warnings.append(f"{', '.join(names)}: ignored, since the output is numeric; {hint}")
    if hidden:
        views = " and ".join(VIEW_NAMES[view] for view in options.view)
        warnings.append(f"{', '.join(hidden)}: not shown in images of {views}; {option('view')} rgb shows everything")
    return warnings


def _is_exact(options: ViewOptions, panels: Sequence[CameraPanel]) -> bool:
    exact = options.style == "exact" and any(panel.view != "rgb" for panel in panels)
    if exact and len(panels) > 1:
        exact_style = f"{option('style')} exact"
        raise UsageError(f"{exact_style}: numbers cannot share an image; {option('separate')} writes a file for each")
    return exact


def _suffixes(options: ViewOptions) -> list[str]:
    """Returns a unique part of a file name for each panel."""
    words = ["".join(c if c.isalnum() else "_" for c in name.partition(":")[0]) for name in camera_names(options)]
    cameras = [word if words.count(word) == 1 else f"{word}{index}" for index, word in enumerate(words)]
    if len({*cameras}) < len(cameras):  # a camera is called as another with its number
        cameras = [f"{word}_{index}" for index, word in enumerate(words)]
    suffixes: list[str] = []
    for panel in panels_of(options):
        camera = [cameras[panel.camera]] if len(options.camera) > 1 else []
        view = [panel.view] if len(options.view) > 1 else []
        suffixes.append("-".join([*camera, *view]))
    return suffixes


def _numbered(output: str, name: str) -> str:
    """Returns the path of one of several files: `video-NAME.mp4` for `video.mp4`."""
    folder = output.rstrip("/")
    if folder != output or not Path(output).suffix:
        return f"{folder}-{name}/"
    path = Path(output)
    return str(path.with_name(f"{path.stem}-{name}{path.suffix}"))


class CalibrationFile:
    """The calibration file of a video or an image. Opening it proves that it can be written.

    Args:
      motions: the motion of each camera.
      files: the image files that the calibration file refers to.
      numbers: whether depth is stored as 16-bit images.
      is_numbered: whether the files are those of a video, which write a number for `%d` in their names.

    Raises:
      UsageError: the format cannot describe these cameras or files.
      FileError: the file cannot be written.
    """

    def __init__(
        self,
        options: ViewOptions,
        motions: Sequence[BoundCameraScript],
        files: Sequence[VideoOrImageFile],
        numbers: bool,
        *,
        is_numbered: bool,
    ) -> None:
        assert options.calibration is not None
        self._is_numbered = is_numbered
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

    def write(self, poses: Sequence[CameraPose], frame: int, time: float) -> None:
        """Adds the calibration of every camera at a frame; `time` is simulated [s]."""
        for camera, pose in enumerate(poses):
            file, depth = (self._file(camera, view, frame) for view in ("rgb", "depth"))
            self.writer.write(CalibrationEntry(self._names[camera], lens(pose, self._size), frame, time, file, depth))

    def _file(self, camera: int, view: str, frame: int) -> str:
        """Returns the image file of a frame, relative to the calibration file; empty if it has none."""
        path = self._files.get((camera, view), "")
        if not path or not _is_picture(path):
            return ""
        if path.endswith("/") or not Path(path).suffix:
            path = str(Path(path) / FRAME_NAME)
        shown = Path(path)
        if self._is_numbered:  # the folder's name is literal
            shown = shown.with_name(frame_name(shown.name, frame))
        return os.path.relpath(shown, self._folder)


def _is_picture(path: str) -> bool:
    """Returns whether each frame is a separate file."""
    return path != "-" and (path.endswith("/") or Path(path).suffix.lower() in ("", ".png", ".jpg", ".jpeg", ".webp"))
