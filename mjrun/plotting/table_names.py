"""What tables are called in a legend: by what differs in their names."""

import re
from collections.abc import Sequence
from pathlib import Path

from mjrun.formats.point_manifest import point_values, values_in_words

_WORD = re.compile(r"[^/\\\s_-]+")


def table_names(paths: Sequence[str]) -> list[str]:
    """A short name for each of several files: `1`, `2` for `kick_1.csv`, `kick_2.csv`; the whole path if need be.

    Files of points of a study are called by the values in which the points differ.
    """
    if len(paths) > 1 and (told := _point_names(paths)):
        return told
    stems = [Path(path).stem for path in paths]
    if len(set(stems)) < len(stems):
        stems = [str(Path(path).with_suffix("")) for path in paths]
    if len(set(stems)) < len(stems):
        return list(paths)
    if len(stems) < 2:
        return stems
    words = [list(_WORD.finditer(stem)) for stem in stems]
    least = min(map(len, words))
    before = next((i for i in range(least) if len({w[i][0] for w in words}) > 1), least)
    after = next((i for i in range(least - before) if len({w[-1 - i][0] for w in words}) > 1), least - before)
    if any(len(found) <= before + after for found in words):  # nothing would be left of one
        return stems
    short = [stem[w[before].start() : w[len(w) - 1 - after].end()] for stem, w in zip(stems, words, strict=True)]
    return short if len(set(short)) == len(short) else stems


def _point_names(paths: Sequence[str]) -> list[str]:
    """The values in which points of a study differ; nothing if a file is of none, or two are the same."""
    points = [point_values(Path(path).parent) for path in paths]
    if any(set(values) != set(points[0]) or not values for values in points):
        return []
    differing = [name for name in points[0] if len({values[name] for values in points}) > 1]
    told = [", ".join(values_in_words({name: values[name] for name in differing})) for values in points]
    return told if len(set(told)) == len(told) else []
