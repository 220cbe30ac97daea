"""Minari datasets: all episodes in one HDF5 file, for offline reinforcement learning; without images.

https://minari.farama.org/content/dataset_standards/

The folder contains `data/`, which `minari.MinariDataset` reads. If its name is that of a dataset, `walker-v0`, in the
folder that MINARI_DATASETS_PATH names, `minari.load_dataset` finds it.
"""

import json
import re
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mjrun.errors import FileError, UsageError, clean, option
from mjrun.formats.episodes import EpisodeLayout, EpisodeRows
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.model.table_column import Column

PRECISION = "float64"  # of numbers
DATA, METADATA = "data/main_data.hdf5", "data/metadata.json"
STANDARD = "0.5.0"  # the version of Minari whose files these are, which later ones read


def check(layout: EpisodeLayout) -> None:
    """Checks that Minari can hold such episodes.

    Raises:
      UsageError: there are images, no rewards, no observations or no actions.
    """
    if layout.cameras:
        raise UsageError(f"a Minari dataset has no images; leave out {option('camera')}", ("camera",))
    if not layout.has_rewards:
        raise UsageError("a Minari dataset consists of episodes with rewards, which only a task with a policy has")
    if not layout.actions or not layout.observations:
        raise UsageError("a Minari dataset requires observations and actions")


def write(
    stack: ExitStack, folder: Path, layout: EpisodeLayout, episodes: Iterable[EpisodeRows], before: int = 0
) -> list[OutputWriter]:
    """Writes a dataset; see `mjrun.formats.episodes`.

    Raises:
      FileError: a file cannot be read or written.
    """
    writer = stack.enter_context(OutputWriter(StagedFile(folder / DATA)))
    count = steps = 0
    with writer.writing(), Path(writer.destination.path).open("r+b") as stream, h5py.File(stream, "w") as file:
        if before:
            count, steps = before, _copy(folder / DATA, file, before)
        for episode in episodes:
            _add(file.create_group(f"episode_{count}"), count, episode)
            count, steps = count + 1, steps + len(episode)
    size = Path(writer.destination.path).stat().st_size
    metadata = _metadata(folder, layout, count, steps, size)
    described = stack.enter_context(written_file(folder / METADATA, f"{json.dumps(metadata)}\n".encode()))
    return [writer, described]


def dataset_id(folder: Path) -> str:
    """Returns the name of the dataset in a folder, which ends with a version."""
    name = re.sub(r"[^-\w]", "_", folder.resolve().name, flags=re.ASCII).strip("-") or "dataset"
    return name if re.fullmatch(r".*-v\d+", name) else f"{name}-v0"


def _add(group: h5py.Group, index: int, episode: EpisodeRows) -> None:
    group.attrs["id"] = index
    group.attrs["total_steps"] = len(episode)
    if episode.seed is not None:
        group.attrs["seed"] = episode.seed
    arrays = {
        "observations": episode.observations,
        "actions": episode.actions,
        "rewards": episode.rewards,
        "terminations": episode.at_end(episode.terminated),
        "truncations": episode.at_end(episode.truncated),
    }
    for name, values in arrays.items():
        group.create_dataset(name, data=values)
    infos = group.create_group("infos")
    for name, values in {**episode.infos, "success": np.append(False, episode.at_end(episode.success))}.items():
        infos.create_dataset(name, data=values)


def _copy(path: Path, file: h5py.File, count: int) -> int:
    """Copies the first episodes of the dataset at `path`, and returns the number of their steps."""
    steps = 0
    try:
        with path.open("rb") as stream, h5py.File(stream, "r") as source:
            for index in range(count):
                group = source[f"episode_{index}"]
                source.copy(group, file)
                steps += np.asarray(group.attrs["total_steps"]).item()
    except (OSError, KeyError, ValueError) as error:
        raise FileError(path, f"is damaged: {clean(str(error))}") from None
    return steps


def _metadata(folder: Path, layout: EpisodeLayout, episodes: int, steps: int, size: int) -> dict[str, Any]:
    versions = [f"{name}=={layout.origin[name]}" for name in ("mujoco", "mjrun") if name in layout.origin]
    about = {
        "command": layout.origin.get("command", ""),
        "observations": [_described(column) for column in layout.observations],
        "actions": [_described(column) for column in layout.actions],
        "seconds per step": float(1 / layout.fps),
    }
    return {
        "total_episodes": episodes,
        "total_steps": steps,
        "data_format": "hdf5",
        "jpeg_encoding": False,
        "observation_space": _box(
            np.full(len(layout.observations), -np.inf), np.full(len(layout.observations), np.inf)
        ),
        "action_space": _box(np.array(layout.action_low), np.array(layout.action_high)),
        **({"env_spec": layout.environment} if layout.environment else {}),
        "dataset_id": dataset_id(folder),
        "minari_version": STANDARD,
        "algorithm_name": clean(layout.origin.get("policy", "")),
        "description": json.dumps(about),
        "requirements": versions,
        "dataset_size": round(size / 1e6, 1),
    }


def _described(column: Column) -> str:
    return f"{clean(column.name)} [{clean(column.unit)}]" if column.unit else clean(column.name)


def _box(low: np.ndarray, high: np.ndarray) -> str:
    """Returns a space of vectors, as Minari serializes it."""
    space: dict[str, Any] = {"type": "Box", "dtype": "float64", "shape": [len(low)]}
    ends: Sequence[tuple[str, np.ndarray]] = (("low", low), ("high", high))
    return json.dumps(space | {name: [float(number) for number in row] for name, row in ends})
