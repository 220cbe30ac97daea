"""What the ids of a segmentation mean, as a JSON document."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from mjrun.errors import FileError
from mjrun.formats.publishing import Completable, StagedFile
from mjrun.model.rendered_view import Segment


def labels(
    file: str,
    size: tuple[int, int],
    legend: Sequence[Segment],
    nothing: int,
    colours: np.ndarray | None = None,
    ids: np.ndarray | None = None,
) -> str:
    """What is in a picture or film of ids, `NAME.labels.json`.

    `file` is the picture; `size` its width and height [pixels]; `nothing` its value where nothing is seen. `labels` has
    an entry for each thing that the picture can tell apart, in view or not: `id` is its value in the picture, `type`,
    `mujoco_id`, `name` and `body` are the model's, `pixels` counts where it is seen, `rgb` is its colour if it has one.

    Args:
      nothing: what the file has instead of −1; ids are shifted by as much.
      colours: of the things, `(n, 3)` uint8.
      ids: `(h, w)`, indices into `legend`, −1 where nothing is seen; of a film, in which counts change, None.
    """
    pixels = None if ids is None else np.bincount(ids[ids >= 0], minlength=len(legend))
    entries = [
        {
            "id": index + nothing + 1,
            "type": thing.type,
            "mujoco_id": thing.id,
            "name": thing.name,
            "body": thing.body,
            **({} if pixels is None else {"pixels": int(pixels[index])}),
            **({} if colours is None else {"rgb": colours[index].tolist()}),
        }
        for index, thing in enumerate(legend)
    ]
    head = {"file": file, "size": list(size), "nothing": nothing}
    return document(head, {"labels": map(text, entries)})


def labels_beside(output: str) -> str:
    """Where the labels of a picture, a film or a folder of frames are."""
    path = Path(output)
    return str(path.with_name(f"{path.stem}.labels.json"))


class LabelsWriter(Completable):
    """The labels beside a film. Opening it proves that they can be written.

    Args:
      film: whose labels they are; a folder's are beside it.

    Raises:
      FileError: they cannot be written.
    """

    def __init__(self, film: str) -> None:
        self._film = Path(film)
        self._target = StagedFile(Path(labels_beside(film)))

    def write(self, size: tuple[int, int], legend: Sequence[Segment], colours: np.ndarray | None) -> None:
        """Writes what the film shows; `colours` `(n, 3)` if it is in colour, else it holds ids + 1.

        Raises:
          FileError: the disk is full.
        """
        try:
            said = labels(self._film.name, size, legend, 0, colours)
            Path(self._target.path).write_text(said, encoding="ascii")
        except OSError as error:
            raise FileError(self._target.shown, f"cannot be written: {error.strerror or error}") from None

    def publish(self) -> list[Path]:
        """Puts the labels in their place, and says which file that is.

        Raises:
          FileError: they cannot be put in their place.
        """
        return self._target.publish()

    def __enter__(self) -> "LabelsWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._target.discard()


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
