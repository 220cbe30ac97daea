"""Segmentations as a COCO document, the "Data format" of cocodataset.org: images, annotations, categories.

- A category is one segment: its name, its type as supercategory, and mjrun's own `mujoco_id` and `body`.
  Every segment of the legend is one, seen or not, so that ids agree between documents, and with the 16-bit PNG.
- An annotation is one segment in one image, with all its visible parts.
- Its mask is an uncompressed RLE, column by column, exact to the pixel, which pycocotools, detectron2 and others
  take as well as polygons. `iscrowd` is 0 all the same: 1 would say that it is a crowd, and training leaves those out.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjrun.formats.labels import ascii_json, json_document
from mjrun.model.rendered_view import Segment

INFO = {"description": "segmentation by mjrun", "contributor": "mjrun"}


@dataclass(frozen=True)
class Region:
    """Where one segment is seen.

    Attributes:
      id: its index in the legend.
      counts: pixels in turn without and with it, column by column from the top left one.
      bbox: x, y, width and height [pixels] of the smallest box around it.
      area: how many pixels show it.
    """

    id: int
    counts: list[int]
    bbox: tuple[int, int, int, int]
    area: int


def regions(ids: np.ndarray) -> Iterator[Region]:
    """What is seen in `ids` `(h, w)`, by rising id; −1 is nosegment."""
    height = len(ids)
    flat = ids.ravel(order="F")
    cuts = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    starts, ends = np.concatenate([[0], cuts]), np.concatenate([cuts, [flat.size]])
    values = flat[starts]
    order = np.argsort(values, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(values[order])) + 1)
    for group in groups:
        if (index := int(values[group[0]])) >= 0:
            yield _region(index, starts[group], ends[group], height, flat.size)


class CocoDocument:
    """Gathers images into one document; memory grows with the runs of their masks, a few bytes each."""

    def __init__(self) -> None:
        self._images: list[str] = []
        self._annotations: list[str] = []
        self._categories: dict[Segment, int] = {}

    def add(self, ids: np.ndarray, legend: Sequence[Segment], image: Mapping[str, Any]) -> None:
        """Adds an image and what is seen in it.

        Args:
          ids: `(h, w)`, indices into `legend`; −1 where nothing is seen.
          image: further entries of the image, such as `file_name`, `camera` and `time`.
        """
        height, width = ids.shape
        number = len(self._images) + 1
        categories = [self._categories.setdefault(segment, len(self._categories) + 1) for segment in legend]
        self._images.append(ascii_json({"id": number, "width": width, "height": height, **image}))
        for region in regions(ids):
            annotation = {
                "id": len(self._annotations) + 1,  # from 1: pycocotools takes 0 for no match
                "image_id": number,
                "category_id": categories[region.id],
                "bbox": region.bbox,
                "area": region.area,
                "iscrowd": 0,
                "segmentation": {"size": [height, width], "counts": region.counts},
            }
            self._annotations.append(ascii_json(annotation))

    def document(self) -> str:
        """The whole, as JSON."""
        names = Counter(segment.name for segment in self._categories)
        categories = [
            {
                "id": number,
                "name": segment.name if names[segment.name] == 1 else f"{segment.type}/{segment.name}",
                "supercategory": segment.type,
                "mujoco_id": segment.id,
                "body": segment.body,
            }
            for segment, number in self._categories.items()
        ]
        lists = {"images": self._images, "annotations": self._annotations, "categories": map(ascii_json, categories)}
        return json_document({"info": INFO, "licenses": []}, lists)


def _region(index: int, starts: np.ndarray, ends: np.ndarray, height: int, size: int) -> Region:
    counts = np.diff(np.stack([starts, ends], axis=1).ravel(), prepend=0, append=size)
    (left, top), (right, bottom) = np.divmod(starts, height), np.divmod(ends - 1, height)
    x, width = left.min(), right.max() - left.min() + 1
    # A run into the next column passes the bottom of one and the top of the other.
    y, end = (0, height) if (left != right).any() else (top.min(), bottom.max() + 1)
    bbox = (int(x), int(y), int(width), int(end - y))
    return Region(index, counts[: -1 if counts[-1] == 0 else None].tolist(), bbox, int((ends - starts).sum()))
