"""The table formats: a declaration of each, and a module with its writer and its reader.

| format  | names            | text columns   | missing integers | units, manifest | memory while writing |
|---------|------------------|----------------|------------------|-----------------|----------------------|
| csv     | cleaned          | cleaned, empty | `nan`            | units, if asked | flat                 |
| feather | exact            | exact, null    | null             | as at opening   | flat                 |
| hdf5    | cleaned          | exact, `''`    | float64 column   | yes             | flat, disk twice     |
| jsonl   | exact            | exact, null    | null             | no              | flat                 |
| mat     | exact, in a cell | exact, `''`    | float64 column   | yes             | one column           |
| npz     | exact            | exact, `''`    | float64 column   | yes             | flat, disk twice     |
| parquet | exact            | exact, null    | null             | yes             | flat                 |

Every number is the measured float64: text is the shortest that reads back as the same bits. A text column has labels,
and its rows arrive as indices into them; for the index −1, no text, a format writes the second entry of its column.
"""

import importlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError, clean, concerning, option
from mjrun.suffixes import HDF5


@dataclass(frozen=True)
class TableFormat:
    """A table format.

    The module of its name in this package has the writer and the function `read`. It is imported on first use: help
    lists the suffixes, and loads neither numpy nor the libraries of the formats.

    Attributes:
      name: value of the option format.
      suffixes: suffixes of its files, the usual one first.
      writer: name of the class in its module, a `RowWriter`.
      is_text: whether its files are lines of text, which can be piped, and hold neither units nor a manifest.
      begins: what a table of this format on standard input begins with; any other text is CSV.
      commented: name of the class that also writes units as a comment, in a format whose units may be beside the table.
      library, extra: library that it needs, and the extra of mjrun that installs it.
      reads_alone: whether only writing needs the library.
    """

    name: str
    suffixes: Sequence[str]
    writer: str
    is_text: bool = False
    begins: tuple[bytes, ...] = ()
    commented: str = ""
    library: str = ""
    extra: str = ""
    reads_alone: bool = False

    @property
    def module(self) -> ModuleType:
        """The module of the format."""
        return importlib.import_module(f"{__name__}.{self.name}")

    def require_library(self, purpose: str) -> None:
        """Raises MissingExtraError or WrongVersionError if its library is unusable; `purpose`: `writing .parquet`."""
        if self.library:
            from mjrun.packages import require

            require(purpose, self.extra, self.library)


FORMATS = {
    known.name: known
    for known in (
        TableFormat("csv", (".csv",), "CsvWriter", is_text=True, commented="CommentedCsvWriter"),
        TableFormat("feather", (".feather", ".arrow"), "FeatherWriter", library="pyarrow", extra="parquet"),
        TableFormat("hdf5", HDF5, "Hdf5Writer", library="h5py", extra="hdf5"),
        TableFormat("jsonl", (".jsonl",), "JsonlWriter", is_text=True, begins=(b"{", b"[")),
        TableFormat("mat", (".mat",), "MatWriter", library="scipy", extra="mat", reads_alone=True),
        TableFormat("npz", (".npz",), "NpzWriter"),
        TableFormat("parquet", (".parquet",), "ParquetWriter", library="pyarrow", extra="parquet"),
    )
}


def suffixes() -> list[str]:
    """Returns the suffixes of tables."""
    return [suffix for known in FORMATS.values() for suffix in known.suffixes]


def format_of_suffix(suffix: str) -> TableFormat | None:
    """Returns the format of files that end in `suffix`, in upper or lower case; None if no format has it."""
    return next((known for known in FORMATS.values() if suffix.lower() in known.suffixes), None)


def output_format(output: str | None, format: str | None = None) -> TableFormat:  # noqa: A002  (the option's name)
    """Returns the format of a table to write, from the suffix of `output` or from the option format.

    Args:
      output: a file, or None for standard output, which is CSV by default.

    Raises:
      UnknownNameError: no format has this name or suffix; the message lists the valid ones.
      UsageError: the name and the suffix disagree, or the format cannot be written to standard output.
      MissingExtraError: the library of the format is not installed.
    """
    if format is not None and format not in FORMATS:
        with concerning("format"):
            raise UnknownNameError("format", format, list(FORMATS))
    chosen = FORMATS[format or "csv"]
    if output is None:
        if not chosen.is_text:
            able = " and ".join(name for name, known in FORMATS.items() if known.is_text)
            raise UsageError(f"{option('format')} {chosen.name} cannot be written to standard output\n{able} can")
        return chosen

    suffix = Path(output).suffix.lower()
    by_suffix = format_of_suffix(suffix)
    if format and by_suffix and chosen != by_suffix:
        raise UsageError(f"{option('format')} {format} and the suffix of {clean(output)} disagree")
    if format is None:
        if by_suffix is None:
            with concerning("output"):
                raise UnknownNameError("table format", suffix, suffixes(), where=output)
        chosen = by_suffix
    chosen.require_library(f"writing {chosen.suffixes[0]}")
    return chosen


def input_format(path: Path) -> TableFormat:
    """Returns the format of a table to read, from its suffix.

    Raises:
      UnknownNameError: no format has this suffix; the message lists the valid ones.
      MissingExtraError: the library of the format is not installed.
    """
    suffix = path.suffix.lower()
    known = format_of_suffix(suffix)
    if known is None:
        raise UnknownNameError("table format", suffix, suffixes(), where=str(path))
    if not known.reads_alone:
        known.require_library(f"reading {suffix}")
    return known


def piped_format(begin: bytes) -> TableFormat:
    """Returns the format of a table on standard input, from its first bytes."""
    text = begin.removeprefix(b"\xef\xbb\xbf").lstrip()
    return next((known for known in FORMATS.values() if text.startswith(known.begins)), FORMATS["csv"])
