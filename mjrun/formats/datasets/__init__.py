"""Formats of datasets: a module for each, which writes what its readers need beside the images."""

from collections.abc import Mapping, Sequence
from typing import Any

from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, option
from mjrun.scene_graph.object_meshes import ObjectMesh

Record = Mapping[str, Any]  # of an image, as `mjrun.study.point_images` describes it
Files = Sequence[tuple[str, bytes]]  # paths in the dataset, and contents
PERSPECTIVE_ONLY = ("nerfstudio", "bop")  # formats without orthographic cameras


@dataclass(frozen=True)
class DatasetRecords:
    """The records of a dataset: its accepted images and their objects.

    Attributes:
      records: the images of each part of the dataset, by its name.
      objects: name, category and names of the keypoints of each object, in the order of their ids from 1.
      polygons: whether masks in COCO are polygons.
      yolo_task: `detect`, `segment` or `pose`.
      meshes: the mesh of each object, None for one without a surface; empty for formats without meshes.
    """

    records: Mapping[str, Sequence[Record]]
    objects: Sequence[tuple[str, str, tuple[str, ...]]]
    polygons: bool = False
    yolo_task: str = "detect"
    meshes: Sequence[ObjectMesh | None] = ()

    @property
    def categories(self) -> list[str]:
        """The categories, in the order of their first objects."""
        return list(dict.fromkeys(category for _, category, _ in self.objects))

    def keypoints(self, category: str) -> list[str]:
        """Returns the names of the keypoints of the objects of a category."""
        return list(dict.fromkeys(name for _, each, points in self.objects if each == category for name in points))


def require_perspective(name: str, camera: str, *, perspective: bool) -> None:
    """Raises UsageError if the format has no orthographic cameras, and the camera is one."""
    if name in PERSPECTIVE_ONLY and not perspective:
        raise UsageError(f"{option('format')} {name} has no orthographic cameras, and {camera} is one")
