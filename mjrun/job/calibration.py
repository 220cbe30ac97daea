"""`--calibration FILE`: what each picture was seen through."""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from mjrun.export.calibration import CalibrationWriter, Exposure
from mjrun.job.drawing import Drawing
from mjrun.model.picture import Lens
from mjrun.model.state import restore
from mjrun.render.camera import Rig
from mjrun.render.lens import average_camera, in_perspective, lens

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

    def __init__(self, job: Drawing, model: mujoco.MjModel, output: str, numbers: bool) -> None:
        assert job.calibration is not None
        self._here = Path(job.calibration).parent
        self._names = [text.partition(",")[0] for text in job.cameras]
        single = [(path, panels[0]) for path, panels in job.outputs(output) if len(panels) == 1]
        self._files = {(p.camera, p.view): path for path, p in single if numbers or p.view != "depth"}
        flat = [name for name, rig in zip(self._names, job.rigs(model), strict=True) if not _perspective(model, rig)]
        pictures = all(_is_picture(path) for path, _ in job.outputs(output))
        self.writer = CalibrationWriter(job.calibration, job.calibration_format, self._names, flat, pictures)

    def write(self, lenses: Sequence[Lens], frame: int, time: float) -> None:
        """Adds what every camera saw a frame through; `time` is simulated [s]."""
        for camera, seen in enumerate(lenses):
            file, depth = (self._file(camera, view, frame) for view in ("rgb", "depth"))
            self.writer.write(Exposure(self._names[camera], seen, frame, time, file, depth))

    def _file(self, camera: int, view: str, frame: int) -> str:
        """The picture of a frame, as seen from the calibration file; empty for none."""
        path = self._files.get((camera, view), "")
        if not path or not _is_picture(path):
            return ""
        if path.endswith("/") or not Path(path).suffix:
            path = str(Path(path) / FRAME)
        name = path % frame if "%" in Path(path).name else path
        return os.path.relpath(name, self._here)


def lenses(
    model: mujoco.MjModel,
    rigs: Sequence[Rig],
    size: tuple[int, int],
    states: Iterable[np.ndarray],
    phases: Iterable[float],
) -> Iterator[list[Lens]]:
    """What each of `rigs` sees each of `states` through; nothing is drawn."""
    data, camera, scene = mujoco.MjData(model), mujoco.MjvCamera(), mujoco.MjvScene(model, 1)
    for state, phase in zip(states, phases, strict=True):
        restore(model, data, state)
        _place(model, data)
        found = []
        for rig in rigs:
            rig.aim(camera, data, phase)
            mujoco.mjv_updateCamera(model, data, camera, scene)
            found.append(lens(average_camera(scene), size))
        yield found


def _place(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Computes where everything is that a camera can follow."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def _perspective(model: mujoco.MjModel, rig: Rig) -> bool:
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    _place(model, data)
    rig.aim(camera, data, 0.0)
    return in_perspective(model, camera)


def _is_picture(path: str) -> bool:
    """Whether each frame is in a file of its own."""
    return path != "-" and (path.endswith("/") or Path(path).suffix.lower() in ("", ".png", ".jpg", ".jpeg", ".webp"))
