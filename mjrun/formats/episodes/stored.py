"""Episodes on disk before they join a dataset: an archive of their numbers, and the videos."""

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mjrun.errors import FileError, clean
from mjrun.formats.episodes import EpisodeRows

NUMBERS = "numbers.npz"
FACTS, INFO, COLORS = "facts", "info/", "colors/"  # entries of the archive, and what precedes names in it
FIELDS = ("observations", "actions", "rewards")


def files(episode: EpisodeRows, videos: Mapping[str, bytes]) -> list[tuple[str, bytes]]:
    """Returns the files of an episode, by their names in its folder.

    Args:
      videos: the contents of the video of each camera, instead of those in `episode`.
    """
    facts = {name: getattr(episode, name) for name in ("task", "seed", "terminated", "truncated", "success")}
    arrays = {name: getattr(episode, name) for name in FIELDS}
    arrays |= {f"{INFO}{name}": values for name, values in episode.infos.items()}
    arrays |= {f"{COLORS}{name}": values for name, values in episode.colors.items()}
    archive = io.BytesIO()
    np.savez(archive, allow_pickle=False, **arrays, **{FACTS: np.array(json.dumps(facts))})
    return [(NUMBERS, archive.getvalue()), *((f"{name}.mp4", content) for name, content in videos.items())]


def read(folder: Path, cameras: Sequence[str]) -> EpisodeRows:
    """Reads an episode from its folder.

    Raises:
      FileError: a file is missing or damaged.
    """
    path = folder / NUMBERS
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        facts = json.loads(str(arrays.pop(FACTS)))
        return EpisodeRows(
            **facts,
            **{name: arrays[name] for name in FIELDS},
            infos={name.removeprefix(INFO): values for name, values in arrays.items() if name.startswith(INFO)},
            videos={name: folder / f"{name}.mp4" for name in cameras},
            colors={name: arrays[COLORS + name] for name in cameras},
        )
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise FileError(path, f"cannot be read: {clean(str(error))}") from None
