"""Files of demonstrations: HDF5 as robosuite, robomimic and LIBERO write it.

The group `data` contains a group for each episode, with the datasets `states` `(n, 1 + nq + nv)`, which are the time
and MuJoCo's positions and velocities, `actions` `(n, …)`, and often `rewards`, `dones` and groups of observations. Its
attribute `model_file` is the MJCF of the episode or, in old files, the name of a file in the folder `models`.

A file is untrusted: its structure and sizes are checked before anything is read, links are not followed, and messages
clean what they quote from it.
"""

import json
import math
import re
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Self, cast

import h5py
import numpy as np

from mjrun.decompression_limits import require_expandable
from mjrun.errors import FileError, MjrunError, clean, file_errors, quoted, shortened, suggestion
from mjrun.hdf5.demonstration_list import DemonstrationFileOrigin, DemonstrationListEntry
from mjrun.hdf5.untrusted_content import require_own_content, text_attributes

LISTED = 8  # episodes in a message
LONGEST = 1000  # characters of an instruction
ROBOSUITE = 1  # type of an environment, of robomimic


class DemonstrationFile:
    """An open file of demonstrations: `with DemonstrationFile(path) as file`.

    Attributes:
      path: the path of the file.
      names: the names of its episodes, `demo_2` before `demo_10`.

    Raises:
      FileError: the file cannot be read, or has no demonstrations.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with file_errors(path):
            self._file: BinaryIO = path.open("rb")
        self._archive: h5py.File | None = None
        try:
            with self._decoding():
                self._archive = h5py.File(self._file, "r")
                self._data, self._groups = _episodes(self._archive)
            self.names = sorted(self._groups, key=_natural)
            if not self.names:
                raise FileError(path, "has no demonstrations, which are groups data/EPISODE with a dataset states")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file."""
        if self._archive:
            self._archive.close()
        self._file.close()

    def named(self, name: str) -> str:
        """Returns the name of an episode; an empty name selects the only one.

        Raises:
          FileError: the file has no such episode, or several.
        """
        if name in self._groups:
            return name
        if not name and len(self.names) == 1:
            return self.names[0]
        shown = ", ".join(clean(f"{self.path}:{each}") for each in self.names[:LISTED])
        more = f", … (`mjrun info {clean(str(self.path))}` lists all)" if len(self.names) > LISTED else ""
        if not name:
            raise FileError(self.path, f"has {len(self.names)} demonstrations; select one\n{shown}{more}")
        hint = suggestion(name, self.names)
        raise FileError(self.path, f"has no demonstration {quoted(name)}{hint}\n{shown}{more}")

    def origin(self, name: str = "") -> DemonstrationFileOrigin:
        """Returns the origin of an episode, or of all, according to the file."""
        with self._decoding():
            attributes = text_attributes(self._file, self._data)
            own = text_attributes(self._file, self._groups[name]) if name else {}
        return _origin(attributes, own)

    def model_text(self, name: str) -> str:
        """Returns the MJCF of an episode, or the name of its file; empty if the file contains neither."""
        with self._decoding():
            return text_attributes(self._file, self._groups[name]).get("model_file", "").strip("\ufeff \t\r\n\0")

    def states(self, name: str) -> np.ndarray:
        """Returns the states of an episode `(n, width)` float64, n ≥ 1: time, positions, velocities.

        Raises:
          FileError: they cannot be read, or a number is not finite.
        """
        states = self.array(name, "states")
        if states.ndim != 2 or not len(states) or states.shape[1] < 1:
            raise FileError(f"{self.path}:{name}", f"its states have the shape {states.shape}, not (n, 1 + nq + nv)")
        bad = np.argwhere(~np.isfinite(states))
        if len(bad):
            row, column = bad[0].tolist()
            raise FileError(f"{self.path}:{name}", f"number {column} of state {row} is {states[row, column]}")
        return states

    def array(self, name: str, *keys: str) -> np.ndarray:
        """Returns a dataset of numbers of an episode as float64, such as `actions`, or `obs`, `robot0_eef_pos`.

        Raises:
          FileError: it is missing, or cannot be read.
        """
        where, shown = f"{self.path}:{name}", clean("/".join(keys))
        with self._decoding(where):
            dataset = _dataset(self._groups[name], *keys)
            if dataset is None:
                raise FileError(where, f"has no dataset {shown}")
            if dataset.dtype.kind not in "fiub":
                raise FileError(where, f"{shown} does not contain numbers")
            require_own_content(self.path, shown, dataset)
            require_expandable(self.path, 8 * math.prod(dataset.shape or ()))
            return np.asarray(dataset[()]).astype(float)

    def datasets(self, name: str) -> list[str]:
        """Returns the names of the datasets of an episode, without those in groups."""
        with self._decoding(f"{self.path}:{name}"):
            group = self._groups[name]
            return [str(key) for key in group if _dataset(group, str(key)) is not None]

    def observations(self, name: str) -> Mapping[str, tuple[int, ...]]:
        """Returns the shapes of the observations of an episode, by name."""
        with self._decoding(f"{self.path}:{name}"):
            return {key: dataset.shape for key, dataset in _observations(self._groups[name]).items()}

    def episode(self, name: str) -> DemonstrationListEntry:
        """Returns the facts about an episode; its states are not checked."""
        group, where = self._groups[name], f"{self.path}:{name}"
        with self._decoding(where):
            dataset = cast(h5py.Dataset, _dataset(group, "states"))
            require_own_content(self.path, "states", dataset)
            count = len(dataset) if dataset.shape else 0
            times = [float(dataset[row, 0]) for row in (0, count - 1)] if dataset.size else [0.0, 0.0]
            images = [key for key, each in _observations(group).items() if each.dtype == np.uint8 and each.ndim == 4]
            instruction = _instruction(text_attributes(self._file, group))
            has_rewards = _dataset(group, "rewards") is not None
        reward = float(self.array(name, "rewards").sum()) if has_rewards else None
        return DemonstrationListEntry(
            name, count, _finite(times[1] - times[0]), instruction, _finite(reward), tuple(images)
        )

    @property
    def subsets(self) -> Mapping[str, int]:
        """The number of episodes in each subset of the file, such as `train`, as robomimic defines them."""
        with self._decoding():
            masks = _own(self._data.file, "mask")
            if not isinstance(masks, h5py.Group):
                return {}
            datasets = {str(name): _dataset(masks, str(name)) for name in masks}
            return {name: int(each.size or 0) for name, each in datasets.items() if each is not None}

    @contextmanager
    def _decoding(self, where: str = "") -> Generator[None]:
        """Turns the exceptions of h5py and of the parser on a damaged file into a FileError."""
        try:
            yield
        except MjrunError:
            raise
        except MemoryError:
            raise FileError(where or self.path, "does not fit in memory") from None
        except Exception as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise FileError(where or self.path, f"cannot be read as HDF5: {clean(shortened(reason))}") from error


def _episodes(archive: h5py.File) -> tuple[h5py.Group, dict[str, h5py.Group]]:
    """Returns the group of all episodes, and that of each by name."""
    data = _own(archive, "data")
    if not isinstance(data, h5py.Group):
        return archive, {}
    groups = {str(name): _own(data, str(name)) for name in data}
    return data, {name: each for name, each in groups.items() if _dataset(each, "states") is not None}


def _own(group: h5py.Group, name: str) -> Any:
    """Returns a member of a group; None if it is missing or a link."""
    return group[name] if name in group and isinstance(group.get(name, getlink=True), h5py.HardLink) else None


def _dataset(group: Any, *keys: str) -> h5py.Dataset | None:
    """Returns a dataset below a group; None if it is missing."""
    for key in keys:
        group = _own(group, key) if isinstance(group, h5py.Group) else None
    return group if isinstance(group, h5py.Dataset) else None


def _observations(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """Returns the observations at the times of the states, by name."""
    observed = _own(group, "obs")
    if not isinstance(observed, h5py.Group):
        return {}
    datasets = {str(key): _dataset(observed, str(key)) for key in observed}
    return {key: each for key, each in datasets.items() if each is not None}


def _natural(name: str) -> list[tuple[int, str]]:
    """Returns a key that sorts numbers in names by their value."""
    parts = [part.lstrip("0") if part.isdecimal() else part for part in re.split(r"(\d+)", name)]
    return [(len(part) if index % 2 else -1, part) for index, part in enumerate(parts)]


def _origin(attributes: Mapping[str, str], own: Mapping[str, str]) -> DemonstrationFileOrigin:
    """Returns the facts in the attributes of all episodes, and in those of one, whichever program wrote them."""
    environment = {**_parsed(attributes, "env_info"), **_parsed(attributes, "env_args")}
    settings = {**environment, **_mapping(environment.get("env_kwargs"))}
    versions = [attributes.get(name, "") for name in ("robosuite_version", "repository_version")]
    names = [attributes.get("env", ""), attributes.get("env_name", ""), str(environment.get("env_name", ""))]
    rate, robots = settings.get("control_freq"), settings.get("robots", [])
    robots = cast("list[object]", [robots] if isinstance(robots, str) else robots if isinstance(robots, list) else [])
    robosuite = next(filter(None, [*versions, str(environment.get("env_version", ""))]), "")
    return DemonstrationFileOrigin(
        task=next(filter(None, names), ""),
        instruction=_instruction(own) or _instruction(attributes),
        mujoco=attributes.get("mujoco_version", ""),
        robosuite=robosuite,
        robots=tuple(robot for robot in robots if isinstance(robot, str)),
        control_rate=float(rate) if isinstance(rate, int | float) and 0 < rate < math.inf else None,
        is_robosuite=bool(robosuite) or "robots" in settings or environment.get("type") == ROBOSUITE,
    )


def _instruction(attributes: Mapping[str, str]) -> str:
    """Returns the instruction in natural language, of LIBERO or of robosuite; empty without one."""
    words = _parsed(attributes, "problem_info").get("language_instruction") or _parsed(attributes, "ep_meta").get(
        "lang"
    )
    if isinstance(words, list):
        words = "".join(part for part in cast("list[object]", words) if isinstance(part, str))
    return words.strip().strip('"')[:LONGEST] if isinstance(words, str) else ""


def _parsed(attributes: Mapping[str, str], name: str) -> dict[str, Any]:
    """Returns an attribute that is a JSON object; empty if it is missing or something else."""
    try:
        return _mapping(json.loads(attributes.get(name, "") or "{}"))
    except (ValueError, RecursionError):
        return {}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _mapping(value: object) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}
