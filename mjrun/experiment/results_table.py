"""The table of results: a row for each point or episode, the same whatever computed them, and requirements on it."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjrun.errors import UsageError, concerning, option
from mjrun.experiment.design import Design, is_whole, numbers
from mjrun.formats.atomic_output import OutputWriter, publish_together, written_file
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.model.column import Column
from mjrun.probe.assertion import parse
from mjrun.probe.scanner import Vocabulary
from mjrun.probe.verdict import Verdict

FILES = ("results.parquet", "results.csv")
BLOCK = 2**12  # rows that are written at a time
POINT = Column("point", meaning="number of the point", integer=True)


class ResultsTable:
    """A table that is put together column by column.

    Attributes:
      columns: of the table, in order.
    """

    def __init__(self) -> None:
        self.columns = list[Column]()
        self._values = list[np.ndarray]()

    @property
    def rows(self) -> np.ndarray:
        """The rows `(n, columns)`; texts are indices into the labels of their columns."""
        return np.stack(self._values, axis=1)

    @property
    def numbers(self) -> dict[str, np.ndarray]:
        """The columns of numbers `(n,)`, by name."""
        return {
            column.name: values for column, values in zip(self.columns, self._values, strict=True) if not column.labels
        }

    def add(self, column: Column, values: Sequence[float] | np.ndarray) -> None:
        """Appends a column of numbers `(n,)`."""
        self.columns.append(column)
        self._values.append(np.array(values, float))

    def add_texts(self, name: str, texts: Sequence[str], meaning: str = "") -> None:
        """Appends a column of texts; empty strings become null."""
        labels = tuple(dict.fromkeys(text for text in texts if text)) or ("",)
        place = {label: index for index, label in enumerate(labels)}
        self.add(Column(name, meaning=meaning, labels=labels), [place[text] if text else -1 for text in texts])

    def add_parameters(self, design: Design, points: Sequence[int], text_meaning: str = "") -> None:
        """Appends a column for each thing that varies.

        Args:
          points: the number of the point of each row.
        """
        for index, name in enumerate(design.names):
            texts = [design.points[point][index] for point in points]
            values = numbers(texts)
            if values is None:
                self.add_texts(name, texts, text_meaning)
            else:
                self.add(Column(name, meaning="what varies", integer=is_whole(name)), values)

    def flags(self, name: str, texts: Sequence[str]) -> dict[str, np.ndarray]:
        """Returns, for each of some texts, where the column `name` has it: 1 or 0 `(n,)`."""
        index = [column.name for column in self.columns].index(name)
        labels, values = self.columns[index].labels, self._values[index]
        return {text: (values == (labels.index(text) if text in labels else np.nan)).astype(float) for text in texts}

    def open(
        self, stack: ExitStack, folder: Path, manifest: Mapping[str, object], files: Sequence[str] = FILES
    ) -> list[TableWriter]:
        """Writes the table to `files` of the folder, each in the format of its suffix.

        They still have to be published; `stack` discards them otherwise.

        Raises:
          FileError: it cannot be written.
        """
        writers, rows = list[TableWriter](), self.rows
        for name in files:
            path = str(folder / name)
            writers.append(stack.enter_context(TableWriter(path, output_format(path).name, self.columns, manifest)))
            for start in range(0, len(rows), BLOCK):
                writers[-1].write(rows[start : start + BLOCK])
        return writers

    def write(self, folder: Path, manifest: Mapping[str, object], files: Sequence[str] = FILES) -> list[Path]:
        """Writes the table as `open` does, publishes the files, and returns them."""
        with ExitStack() as stack:
            return publish_together(self.open(stack, folder, manifest, files))


class Requirements:
    """Requirements on a table, checked for their names before it has any rows.

    Args:
      texts: the requirements, as they are written.
      numbers: the columns of numbers.
      flags: the columns that hold 1 or 0: `share(ok) > 0.95`.
      rewrite: changes a requirement before it is read, and moves no character.

    Raises:
      UsageError: one is not well formed, or names nothing.
    """

    def __init__(
        self, texts: Sequence[str], numbers: Sequence[str], flags: Sequence[str], rewrite: Callable[[str], str] = str
    ) -> None:
        names = TableNames(numbers, flags)
        self._columns = names.names
        self._assertions = []
        for index, text in enumerate(texts):
            with concerning("require", index):
                self._assertions.append(replace(parse(rewrite(text), names, "require"), text=text))

    def verdicts(self, columns: Mapping[str, np.ndarray]) -> list[Verdict]:
        """Returns whether each requirement holds over columns `(n,)`."""
        rows = np.stack([columns[name] for name in self._columns], axis=1)
        verdicts = list[Verdict]()
        for assertion in self._assertions:
            checker = assertion.checker()
            checker.feed(rows, 0)
            verdicts.append(checker.verdict())
        return verdicts


class TableNames(Vocabulary):
    """The columns of a table; those of flags count rows.

    Args:
      numbers: the names of columns, or the columns that names stand for.
    """

    def __init__(self, numbers: Sequence[str] | Mapping[str, str], flags: Sequence[str]) -> None:
        columns = numbers if isinstance(numbers, Mapping) else dict(zip(numbers, numbers, strict=True))
        super().__init__({**columns, **dict(zip(flags, flags, strict=True))})
        self._flags = {*flags}

    def is_count(self, column: str) -> bool:
        return column in self._flags


def check_metric_names(metrics: Sequence[tuple[str, str]], taken: Sequence[str]) -> None:
    """Refuses names of metrics that cannot be columns beside those that are `taken`.

    Raises:
      UsageError: there is such a name, or one is given twice.
    """
    names = [name for name, _ in metrics]
    for name in names:
        with concerning("metric", name):
            if not name.isidentifier() or name in taken:
                reason = "it takes letters, digits and _, and no other column may have it"
                raise UsageError(f"{option('metric')}: {name!r} cannot be the name of a metric: {reason}")
            if names.count(name) > 1:
                raise UsageError(f"{option('metric')}: {name} is given twice")


def manifest_writer(path: Path, facts: Mapping[str, object]) -> OutputWriter:
    """Returns the manifest of a folder, written and still to be published.

    Raises:
      FileError: it cannot be written.
    """
    return written_file(path, f"{json.dumps(facts, indent=2, default=str)}\n".encode())
