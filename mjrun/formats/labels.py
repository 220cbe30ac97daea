"""What the ids of a segmentation mean, as a JSON document beside the image or video."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.formats.atomic_output import OutputWriter
from mjrun.formats.destinations import StagedFile
from mjrun.model.rendered_view import Segment


def labels_document(
    file: str,
    size: tuple[int, int],
    legend: Sequence[Segment],
    nothing: int,
    colours: np.ndarray | None = None,
    ids: np.ndarray | None = None,
) -> str:
    """The JSON of `NAME.labels.json`.

    `file` is the image; `size` its width and height [pixels]; `nothing` its value where nothing is seen. `labels` has
    an entry for each segment, in view or not: `id` is its value in the image, `type`, `mujoco_id`, `name` and `body`
    are those of the model, `pixels` counts where it is seen, `rgb` is its colour if it has one.

    Args:
      nothing: the value in the file for −1; ids are shifted by as much.
      colours: of the segments, `(n, 3)` uint8.
      ids: `(h, w)`, indices into `legend`, −1 where nothing is seen; None for a video, in which counts change.
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
    """Where the labels of an image, a video or a folder of frames are."""
    path = Path(output)
    return str(path.with_name(f"{path.stem}.labels.json"))


class LabelsWriter(OutputWriter):
    """Writes the labels beside an image or video. Opening it proves that they can be written.

    Args:
      output: the image, video or folder of frames that is labelled.

    Raises:
      FileError: they cannot be written.
    """

    def __init__(self, output: str) -> None:
        self._output = Path(output)
        super().__init__(StagedFile(Path(labels_beside(output))))

    def write(
        self,
        size: tuple[int, int],
        legend: Sequence[Segment],
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
    """A JSON object of `head` and of `lists`, whose items are JSON already and get a line each."""
    parts = [f"{ascii_json(key)}: {ascii_json(value)}" for key, value in head.items()]
    parts += [f"{ascii_json(key)}: [\n" + ",\n".join(items) + "\n]" for key, items in lists.items()]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def ascii_json(value: object) -> str:
    """JSON in plain ASCII: a name may hold anything, reads back exactly, and cannot steer a terminal.

    Raises:
      ValueError: it holds a number that is not finite, which JSON cannot say.
    """
    return json.dumps(value, allow_nan=False).replace("\x7f", "\\u007f")
