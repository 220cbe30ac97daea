"""What is seen of one instant through one camera, as plain values: colours, depth, objects, and the lens."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Segment:
    """What a segmentation tells apart.

    Attributes:
      type: `geom`, `site`, `tendon`, `flex`, `skin`, …, or `body` and `root-body` when whole bodies are told apart.
      id: MuJoCo's, of that type.
      name: the object's, `geom:3` without one.
      body: the name of the body it belongs to; empty for none.
    """

    type: str
    id: int
    name: str
    body: str = ""


@dataclass(frozen=True)
class CameraCalibration:
    """A calibrated camera, in the axes of OpenCV: x right, y down, z into the picture.

    A point p in the world is seen at pixel (u, v), where (x, y, z) = inverse(pose) p, u = fx x/z + cx and
    v = fy y/z + cy; without `perspective` u = fx x + cx and v = fy y + cy. The centre of the first pixel is
    (0.5, 0.5), the picture's corner (0, 0).

    Attributes:
      size: width and height [pixels].
      fx, fy: focal lengths [pixels]; pixels per metre without perspective.
      cx, cy: principal point [pixels].
      pose: world from camera, `(4, 4)`.
      near, far: distances of the clipping planes [m].
      perspective: false for an orthographic camera.
    """

    size: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    pose: np.ndarray
    near: float
    far: float
    perspective: bool = True

    @property
    def matrix(self) -> np.ndarray:
        """K, `(3, 3)`."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels u, v and depth [m], `(n, 3)`, of points `(n, 3)` in the world; behind the camera depth is negative."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        scale = local[:, 2:] if self.perspective else 1.0
        pixels = local[:, :2] / scale * [self.fx, self.fy] + [self.cx, self.cy]
        return np.concatenate([pixels, local[:, 2:]], axis=1)

    def unproject(self, depth: np.ndarray) -> np.ndarray:
        """Points in the world `(h, w, 3)` of a picture of planar depths `(h, w)` [m]."""
        height, width = depth.shape
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        scale = depth if self.perspective else 1.0
        local = np.stack([(u - self.cx) / self.fx * scale, (v - self.cy) / self.fy * scale, depth], axis=-1)
        return local @ self.pose[:3, :3].T + self.pose[:3, 3]


@dataclass(frozen=True)
class Picture:
    """What is seen; views that were not asked for are None.

    Attributes:
      lens: through what.
      rgb: `(h, w, 3)` uint8.
      depth: `(h, w)` float32, planar [m]; infinite where nothing is seen.
      ids: `(h, w)` int32, indices into `legend`; −1 where nothing is seen.
      legend: what the ids mean, the same for every frame of a film.
    """

    lens: CameraCalibration
    rgb: np.ndarray | None = None
    depth: np.ndarray | None = None
    ids: np.ndarray | None = None
    legend: Sequence[Segment] = ()
