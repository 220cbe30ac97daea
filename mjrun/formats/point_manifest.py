"""The manifest of a point of a study, beside the files that are kept of it, and its values in words."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from mjrun.suffixes import MODELS

NAME = "point.json"


def read_point(folder: Path) -> Mapping[str, object]:
    """What the manifest in a folder says; nothing if there is none that can be read."""
    try:
        document = json.loads((folder / NAME).read_bytes())
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def point_values(folder: Path) -> Mapping[str, str]:
    """The values of what varies, by name; none if no manifest tells."""
    values = read_point(folder).get("values")
    return {str(name): str(text) for name, text in values.items()} if isinstance(values, dict) else {}


def values_in_words(values: Mapping[str, str]) -> list[str]:
    """`timestep 0.01`, `floor.friction[0] 0.5`: each value with the shortest end of its name that only it has."""
    names = list(values)
    return [f"{_short(name, names)} {_rounded(text)}" for name, text in values.items()]


def _short(name: str, names: Sequence[str]) -> str:
    for separator in (".", "/"):
        end = name.rpartition(separator)[2].rpartition("/")[2]
        if sum(other.endswith(end) for other in names) == 1:
            return end
    return name


def _rounded(text: str) -> str:
    try:
        return f"{float(text):.4g}"
    except ValueError:
        return Path(text).stem if text.endswith(MODELS) else text
