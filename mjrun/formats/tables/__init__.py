"""The table formats: one module each, and nothing else in this package.

A module defines `FORMAT`, a `TableFormat`, and is found because it is here. Modules import numpy and the libraries
of their formats inside functions, so that listing suffixes, as help does, loads none of them.

| format  | suffix             | names            | text columns   | units, manifest | memory while writing |
|---------|--------------------|------------------|----------------|-----------------|----------------------|
| csv     | `.csv`             | cleaned          | cleaned, empty | no              | flat                 |
| jsonl   | `.jsonl`           | exact            | exact, null    | no              | flat                 |
| parquet | `.parquet`         | exact            | exact, null    | yes             | flat                 |
| feather | `.feather .arrow`  | exact            | exact, null    | as at opening   | flat                 |
| hdf5    | `.h5 .hdf5`        | cleaned          | exact, `''`    | yes             | flat, disk twice     |
| npz     | `.npz`             | exact            | exact, `''`    | yes             | flat, disk twice     |
| mat     | `.mat`             | exact, in a cell | exact, `''`    | yes             | one column           |

Every number is the float64 that was measured: text is the shortest that reads back as the same bits.
A text column has labels, and its rows arrive as indices into them; the last entry above is for −1, no text.
"""

import functools
import importlib
import pkgutil
from pathlib import Path

from mjrun.errors import UnknownNameError, UsageError, clean, option
from mjrun.formats.table_format import TableFormat


@functools.cache
def formats() -> dict[str, TableFormat]:
    """All table formats by name."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return {module.FORMAT.name: module.FORMAT for module in modules}


def suffixes() -> list[str]:
    """The suffixes of tables."""
    return [suffix for known in formats().values() for suffix in known.suffixes]


def format_of_suffix(suffix: str) -> TableFormat | None:
    """The format of files that end in `suffix`, in any case; None if there is none."""
    return next((known for known in formats().values() if suffix.lower() in known.suffixes), None)


def output_format(output: str | None, format: str | None = None) -> TableFormat:  # noqa: A002  (the option's name)
    """The format of a table to write, from the suffix of `output` or from the option `format`.

    Args:
      output: a file, or None for standard output, which is csv by default.

    Raises:
      UnknownNameError: there is no such format or suffix; the message lists those there are.
      UsageError: the two disagree, or the format cannot be written to standard output.
      MissingExtraError: the library of the format is not installed.
    """
    chosen = _chosen(output, format)
    if output is None and not chosen.pipe:
        able = " and ".join(name for name, known in formats().items() if known.pipe)
        raise UsageError(f"{option('format')} {chosen.name} cannot be written to standard output\n{able} can")
    chosen.require_library(f"writing {chosen.suffixes[0]}")
    return chosen


def input_format(path: Path) -> TableFormat:
    """The format of a table to read, from its suffix.

    Raises:
      UnknownNameError: no format has this suffix; the message lists those there are.
      MissingExtraError: the library of the format is not installed.
    """
    suffix = path.suffix.lower()
    known = format_of_suffix(suffix)
    if known is None:
        raise UnknownNameError("table format", suffix, suffixes(), where=str(path))
    if not known.reads_alone:
        known.require_library(f"reading {suffix}")
    return known


def _chosen(output: str | None, name: str | None) -> TableFormat:
    if name is not None and name not in formats():
        raise UnknownNameError("format", name, list(formats()))
    named = formats()[name] if name is not None else None
    if output is None:
        return named or formats()["csv"]
    suffix = Path(output).suffix.lower()
    meant = format_of_suffix(suffix)
    if named and meant and named != meant:
        raise UsageError(f"{option('format')} {name} and the suffix of {clean(output)} disagree")
    if chosen := named or meant:
        return chosen
    raise UnknownNameError("table format", suffix, suffixes(), where=output)
