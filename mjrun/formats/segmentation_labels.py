"""Labels of segmentations: JSON documents that describe the ids of an image or video, and COCO documents."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.dataclass import dataclass
from mjrun.formats.codecs import is_folder
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.model.camera_images import SegmentedObject

INFO = {"description": "segmentation by mjrun", "contributor": "mjrun"}


def labels_document(
    file: str,
    size: tuple[int, int],
    legend: Sequence[SegmentedObject],
    nothing: int,
    colours: np.ndarray | None = None,
    ids: np.ndarray | None = None,
) -> str:
    """Returns the JSON of `NAME.labels.json`.

    `file` is the image; `size` its width and height [pixels]; `nothing` its value for the background. `labels` has an
    entry for each segment, visible or not: `id` is its value in the image, `type`, `mujoco_id`, `name` and `body` are
    those of the model, `pixels` counts its pixels, `rgb` is its colour, if any.

    Args:
      nothing: value in the file for −1; ids are shifted by the same number.
      colours: colours of the segments, `(n, 3)` uint8.
      ids: `(h, w)`, indices into `legend`, −1 for the background; None for a video, in which counts change.
    """
    pixels = None if ids is None else np.bincount(ids[ids >= 0], minlength=len(legend))
    entries = [
        {
            "id": index + nothing + 1,
            "type": segment.type,
            "mujoco_id": segment.id,
            "name": segment.name,
            "body": segment.body,
            **({} if pixels is None else {"pixels": int(pixels[index])}),
            **({} if colours is None else {"rgb": colours[index].tolist()}),
        }
        for index, segment in enumerate(legend)
    ]
    return json_document({"file": file, "size": list(size), "nothing": nothing}, {"labels": map(ascii_json, entries)})


def labels_beside(output: str) -> str:
    """Returns the path of the labels of an image, a video or a folder of frames, whose name has no suffix."""
    path = Path(output)
    return str(path.with_name(f"{path.name if is_folder(output) else path.stem}.labels.json"))


class LabelsWriter(OutputWriter):
    """A writer of the labels beside an image or video. Opening it checks that they can be written.

    Args:
      output: the labelled image, video or folder of frames.

    Raises:
      FileError: they cannot be written.
    """

    def __init__(self, output: str) -> None:
        self._output = Path(output)
        super().__init__(StagedFile(Path(labels_beside(output))))

    def write(
        self,
        size: tuple[int, int],
        legend: Sequence[SegmentedObject],
        colours: np.ndarray | None,
        nothing: int = 0,
        ids: np.ndarray | None = None,
    ) -> None:
        """Writes the labels; the arguments are those of `labels_document`.

        Raises:
          FileError: the disk is full.
        """
        self.write_file(labels_document(self._output.name, size, legend, nothing, colours, ids).encode("ascii"))


def json_document(head: Mapping[str, Any], lists: Mapping[str, Iterable[str]]) -> str:
    """Returns a JSON object of `head` and of `lists`, whose items are JSON already and get a line each."""
    parts = [f"{ascii_json(key)}: {ascii_json(value)}" for key, value in head.items()]
    parts += [f"{ascii_json(key)}: [\n" + ",\n".join(items) + "\n]" for key, items in lists.items()]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def ascii_json(value: object) -> str:
    """Returns JSON in plain ASCII: any name reads back exactly, and cannot control a terminal.

    Raises:
      ValueError: a number is not finite, which JSON does not support.
    """
    return json.dumps(value, allow_nan=False).replace("\x7f", "\\u007f")


@dataclass(frozen=True)
class SegmentMask:
    """The visible pixels of one segment.

    Attributes:
      id: index of the segment in the legend.
      counts: lengths of the runs of pixels without and with it, column by column from the top left one.
      bbox: x, y, width and height of the smallest box around it [pixels].
      area: number of its pixels.
    """

    id: int
    counts: list[int]
    bbox: tuple[int, int, int, int]
    area: int


def regions(ids: np.ndarray) -> Iterator[SegmentMask]:
    """Yields the visible segments in `ids` `(h, w)`, by ascending id; −1 is the background."""
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
    """A document that collects images; memory grows with the runs of their masks, a few bytes each."""

    def __init__(self) -> None:
        self._images: list[str] = []
        self._annotations: list[str] = []
        self._categories: dict[SegmentedObject, int] = {}

    def add(self, ids: np.ndarray, legend: Sequence[SegmentedObject], image: Mapping[str, Any]) -> None:
        """Adds an image and its visible segments.

        Args:
          ids: `(h, w)`, indices into `legend`; −1 for the background.
          image: further entries of the image, such as `file_name`, `camera` and `time`.
        """
        height, width = ids.shape
        number = len(self._images) + 1
        categories = [self._categories.setdefault(segment, len(self._categories) + 1) for segment in legend]
        self._images.append(ascii_json({"id": number, "width": width, "height": height, **image}))
        for region in regions(ids):
            annotation = {
                "id": len(self._annotations) + 1,  # from 1: 0 means no match to pycocotools
                "image_id": number,
                "category_id": categories[region.id],
                "bbox": region.bbox,
                "area": region.area,
                "iscrowd": 0,
                "segmentation": {"size": [height, width], "counts": region.counts},
            }
            self._annotations.append(ascii_json(annotation))

    def document(self) -> str:
        """Returns the document as JSON."""
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


def _region(index: int, starts: np.ndarray, ends: np.ndarray, height: int, size: int) -> SegmentMask:
    counts = np.diff(np.stack([starts, ends], axis=1).ravel(), prepend=0, append=size)
    (left, top), (right, bottom) = np.divmod(starts, height), np.divmod(ends - 1, height)
    x, width = left.min(), right.max() - left.min() + 1
    # A run into the next column includes the bottom of one and the top of the other.
    y, end = (0, height) if (left != right).any() else (top.min(), bottom.max() + 1)
    bbox = (int(x), int(y), int(width), int(end - y))
    return SegmentMask(index, counts[: -1 if counts[-1] == 0 else None].tolist(), bbox, int((ends - starts).sum()))
