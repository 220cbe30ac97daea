"""One instant as seen by one camera: colours, depth, segmentation, and the camera's calibration."""

from collections.abc import Sequence

import numpy as np

from mjrun.dataclass import dataclass


@dataclass(frozen=True)
class SegmentedObject:
    """An object in a segmentation.

    Attributes:
      type: `geom`, `site`, `tendon`, `flex`, `skin`, …, or `body` or `root-body` in a segmentation by bodies.
      id: the MuJoCo id within that type.
      name: the name of the object, `geom:3` if it has none.
      body: the name of the body that it belongs to; empty without one.
    """

    type: str
    id: int
    name: str
    body: str = ""


@dataclass(frozen=True)
class CameraCalibration:
    """The calibration of a camera in the axes of OpenCV: x right, y down, z forward.

    A point p in the world appears at pixel (u, v), where (x, y, z) = inverse(pose) p, u = fx x/z + cx and
    v = fy y/z + cy; without `perspective`, u = fx x + cx and v = fy y + cy. The centre of the first pixel is
    (0.5, 0.5), the corner of the image (0, 0).

    Attributes:
      size: width and height [pixels].
      fx, fy: the focal lengths [pixels]; pixels per metre without perspective.
      cx, cy: the principal point [pixels].
      pose: the transformation from the camera to the world, `(4, 4)`.
      near, far: the distances of the clipping planes [m].
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
        """The matrix K, `(3, 3)`."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Projects points `(n, 3)` in the world to pixels u, v and depth [m], `(n, 3)`, negative behind the camera."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        scale = local[:, 2:] if self.perspective else 1.0
        pixels = local[:, :2] / scale * [self.fx, self.fy] + [self.cx, self.cy]
        return np.concatenate([pixels, local[:, 2:]], axis=1)

    def unproject(self, depth: np.ndarray) -> np.ndarray:
        """Returns the points in the world `(h, w, 3)` of an image of planar depths `(h, w)` [m]."""
        height, width = depth.shape
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        scale = depth if self.perspective else 1.0
        local = np.stack([(u - self.cx) / self.fx * scale, (v - self.cy) / self.fy * scale, depth], axis=-1)
        return local @ self.pose[:3, :3].T + self.pose[:3, 3]


@dataclass(frozen=True)
class CameraImages:
    """The images of one instant seen by one camera; None for those that were not requested.

    Attributes:
      calibration: the calibration of the camera.
      rgb: `(h, w, 3)` uint8.
      depth: `(h, w)` float32, planar [m]; infinite for the background.
      ids: `(h, w)` int32, indices into `legend`; −1 for the background.
      legend: the objects of the segmentation, the same for every frame of a video.
    """

    calibration: CameraCalibration
    rgb: np.ndarray | None = None
    depth: np.ndarray | None = None
    ids: np.ndarray | None = None
    legend: Sequence[SegmentedObject] = ()
