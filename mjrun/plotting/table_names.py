"""What tables are called in a legend: by what differs in their names."""

import re
from collections.abc import Sequence
from pathlib import Path

_WORD = re.compile(r"[^/\\\s_-]+")


def table_names(paths: Sequence[str]) -> list[str]:
    """A short name for each of several files: `1`, `2` for `kick_1.csv`, `kick_2.csv`; the whole path if need be."""
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
