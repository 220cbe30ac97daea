"""What the ids of a segmentation mean, as a JSON document."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mjrun.model.picture import Thing


def labels(file: str, ids: np.ndarray, legend: Sequence[Thing], nothing: int, colours: np.ndarray | None = None) -> str:
    """What is in a picture of ids, `NAME.labels.json`.

    `file` is the picture; `size` its width and height [pixels]; `nothing` its value where nothing is seen. `labels` has
    an entry for each thing that the picture can tell apart, in view or not: `id` is its value in the picture, `type`,
    `mujoco_id`, `name` and `body` are the model's, `pixels` counts where it is seen, `rgb` is its colour if it has one.

    Args:
      ids: `(h, w)`, indices into `legend`; −1 where nothing is seen.
      nothing: what the file has instead of −1; ids are shifted by as much.
      colours: of the things, `(n, 3)` uint8.
    """
    pixels = np.bincount(ids[ids >= 0], minlength=len(legend))
    entries = [
        {
            "id": index + nothing + 1,
            "type": thing.type,
            "mujoco_id": thing.id,
            "name": thing.name,
            "body": thing.body,
            "pixels": int(pixels[index]),
            **({} if colours is None else {"rgb": colours[index].tolist()}),
        }
        for index, thing in enumerate(legend)
    ]
    head = {"file": file, "size": [ids.shape[1], ids.shape[0]], "nothing": nothing}
    return document(head, {"labels": map(text, entries)})


def document(head: Mapping[str, Any], lists: Mapping[str, Iterable[str]]) -> str:
    """A JSON object of `head` and of `lists`, whose items are JSON already and have a line each."""
    parts = [f"{text(key)}: {text(value)}" for key, value in head.items()]
    parts += [f"{text(key)}: [\n" + ",\n".join(items) + "\n]" for key, items in lists.items()]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def text(value: object) -> str:
    """JSON in plain ASCII: a name may hold anything, reads back exactly, and cannot steer a terminal.

    Raises:
      ValueError: there is a number in it that is not finite, which JSON has no word for.
    """
    return json.dumps(value, allow_nan=False).replace("\x7f", "\\u007f")
