"""Tables of results with a row for each point or episode; metrics, and requirements on tables.

A table can also be written as runs of MLflow, in the format of its file store: a file for each parameter, metric and
tag.
"""

import hashlib
import json
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import mujoco
import numpy as np

from mjrun.errors import (
    FailedAssertionError,
    FileError,
    MjrunError,
    UsageError,
    clean,
    concerning,
    file_errors,
    option,
    quoted,
)
from mjrun.experiment.design import Design, DesignColumn, is_whole
from mjrun.formats.local_and_remote_folders import Folder, folder_at, written_file
from mjrun.formats.output_writer import OutputWriter, StagedFile, publish_together
from mjrun.formats.table_writer import TableWriter
from mjrun.formats.tables import output_format
from mjrun.formats.temporary_output import NEW, TemporaryOutput, replace_folder
from mjrun.model.override import holds_whole_number
from mjrun.model.table_column import Column, split_unit
from mjrun.probe.assertion import Assertion, parse
from mjrun.probe.episode_columns import EpisodeColumns
from mjrun.probe.expression import expression_unit
from mjrun.probe.metric import Metric, parse_metric
from mjrun.probe.scanner import Vocabulary
from mjrun.probe.select import TIME, available_columns
from mjrun.probe.verdict import Verdict
from mjrun.probe.vocabularies import ModelVocabulary

FILES = ("results.parquet", "results.csv")
BLOCK = 2**12  # rows written at once
POINT = Column("point", meaning="number of the point", integer=True)
MOST_RUNS = 10_000  # of MLflow, each of a dozen files
LONGEST_NAME = 250  # characters of a name
FINISHED, FAILED = 3, 4  # MLflow's RunStatus
MARK = "source_of_mjrun"  # tag of all experiments that mjrun has written
OF_MLFLOW = ("0", ".trash", "models")  # what MLflow adds when it opens the folder


class ResultsTable:
    """A table built column by column.

    Attributes:
      columns: columns of the table, in order.
    """

    def __init__(self) -> None:
        self.columns = list[Column]()
        self._values = list[np.ndarray]()

    @property
    def rows(self) -> np.ndarray:
        """Rows `(n, columns)`; texts are indices into the labels of their columns."""
        return np.stack(self._values, axis=1, dtype=float)

    @property
    def numbers(self) -> dict[str, np.ndarray]:
        """Numeric columns `(n,)`, by name."""
        return {
            column.name: values.astype(float)
            for column, values in zip(self.columns, self._values, strict=True)
            if not column.labels
        }

    def __len__(self) -> int:
        return len(self._values[0])

    def add(self, column: Column, values: Sequence[float] | np.ndarray) -> None:
        """Appends a numeric column `(n,)`."""
        self.columns.append(column)
        self._values.append(np.asarray(values))

    def add_texts(self, name: str, texts: Sequence[str], meaning: str = "") -> None:
        """Appends a text column; empty strings become null."""
        code = {text: index for index, text in enumerate(dict.fromkeys(texts))}
        self.add_coded(name, np.array([code[text] for text in texts], np.int32), [*code], meaning)

    def add_coded(self, name: str, codes: np.ndarray, texts: Sequence[str], meaning: str = "") -> None:
        """Appends a text column, given as indices `(n,)` of texts; empty strings become null."""
        used, first = np.unique(codes, return_index=True)
        in_order = [int(code) for code in used[np.argsort(first)] if texts[int(code)]]
        place = np.full(len(texts), -1, np.int32)
        place[in_order] = np.arange(len(in_order))
        labels = tuple(texts[code] for code in in_order) or ("",)
        self.add(Column(name, meaning=meaning, labels=labels), place[codes])

    def add_values(self, column: Column, values: DesignColumn, rows: np.ndarray | slice) -> None:
        """Appends values as numbers, or as texts where they are not numbers, or are integers that a float would round.

        Args:
          rows: place in `values` of each row.
        """
        found = values.numbers
        if found is None:
            self.add_coded(column.name, values.places[rows], values.texts, column.meaning)
        else:
            self.add(replace(column, has_gaps=bool(np.isnan(found).any())), found[rows])

    def add_parameters(
        self,
        design: Design,
        points: Sequence[int] | np.ndarray | None = None,
        units: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Appends a column for each parameter of a design.

        Args:
          points: number of the point of each row; None for a row for each point.
          units: units of parameters, by name.
        """
        rows = slice(None) if points is None else np.asarray(points, np.intp)
        for index, name in enumerate(design.names):
            integer = is_whole(name) or holds_whole_number(name)
            column = Column(name, units.get(name, ""), "what varies", integer=integer)
            self.add_values(column, design.column(index), rows)

    def flags(self, name: str, texts: Sequence[str]) -> dict[str, np.ndarray]:
        """Returns a flag column `(n,)` for each text: 1 in the rows where the column `name` contains it, else 0."""
        index = [column.name for column in self.columns].index(name)
        labels, values = self.columns[index].labels, self._values[index]
        return {text: (values == (labels.index(text) if text in labels else np.nan)).astype(float) for text in texts}

    def open(
        self, stack: ExitStack, folder: Path | Folder, manifest: Mapping[str, object], files: Sequence[str] = FILES
    ) -> list[TableWriter]:
        """Writes the table to `files` in the folder, each in the format of its suffix.

        The files must then be published; otherwise `stack` removes them.

        Raises:
          FileError: a file cannot be written.
        """
        writers, count, folder = list[TableWriter](), len(self), folder_at(folder)
        for name in files:
            path = folder.path(name)
            writers.append(stack.enter_context(TableWriter(path, output_format(path).name, self.columns, manifest)))
            for start in range(0, count, BLOCK):
                writers[-1].write(
                    np.stack([values[start : start + BLOCK] for values in self._values], axis=1, dtype=float)
                )
        return writers

    def write(self, folder: Path, manifest: Mapping[str, object], files: Sequence[str] = FILES) -> list[Path]:
        """Writes the table as `open` does, publishes the files, and returns their paths."""
        with ExitStack() as stack:
            return publish_together(self.open(stack, folder, manifest, files))


class Requirements:
    """Requirements on a table. Their names are checked before the table has any rows.

    Args:
      texts: requirements as written.
      numbers: numeric columns.
      flags: columns of ones and zeros, as in `share(ok) > 0.95`.
      rewrite: function that changes a requirement before it is parsed, and keeps the positions of its characters.

    Raises:
      UsageError: a requirement is malformed, or contains an unknown name.
    """

    def __init__(
        self, texts: Sequence[str], numbers: Sequence[str], flags: Sequence[str], rewrite: Callable[[str], str] = str
    ) -> None:
        names = ColumnVocabulary(numbers, flags)
        self._columns = names.names
        self._assertions = list[Assertion]()
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


class ColumnVocabulary(Vocabulary):
    """Columns of a table as the vocabulary of expressions; the sum of a flag column counts rows.

    Args:
      numbers: names of numeric columns, or those columns by name.
      flags: columns of ones and zeros.
    """

    def __init__(self, numbers: Sequence[str] | Mapping[str, str], flags: Sequence[str]) -> None:
        columns = numbers if isinstance(numbers, Mapping) else dict(zip(numbers, numbers, strict=True))
        super().__init__({**columns, **dict(zip(flags, flags, strict=True))})
        self._flags = {*flags}

    def is_count(self, column: str) -> bool:
        return column in self._flags


def raise_failures(result: object, verdicts: Sequence[Verdict], other: MjrunError | None) -> None:
    """Raises FailedAssertionError if a requirement does not hold, or else the `other` error; attaches the result."""
    failed = [verdict.message for verdict in verdicts if not verdict.passed]
    if error := FailedAssertionError(failed) if failed else other:
        error.results = [result]
        raise error


def plain_metrics(metrics: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    """Returns name and text of each metric, without the units of the names as written: `v` for `v [m/s]`."""
    return tuple((split_unit(name)[0], text) for name, text in metrics)


def check_metric_names(metrics: Sequence[tuple[str, str]], reserved: Sequence[str]) -> None:
    """Refuses names of metrics, as written, that cannot be columns beside the `reserved` ones.

    Raises:
      UsageError: a name or a unit is invalid, or a name is given twice.
    """
    names = [name for name, _ in plain_metrics(metrics)]
    for name, (written, _) in zip(names, metrics, strict=True):
        unit = split_unit(written)[1] or ""
        with concerning("metric", written):
            if not name.isidentifier() or name in reserved:
                reason = "use letters, digits and _, and a name that no other column has, as in 'v' or 'v [m/s]'"
                raise UsageError(f"{option('metric')}: {quoted(name)} cannot be the name of a metric: {reason}")
            if not unit.isprintable():
                raise UsageError(f"{option('metric')} {name}: {quoted(unit)} cannot be a unit")
            if names.count(name) > 1:
                raise UsageError(f"{option('metric')}: {name} is given twice")


def parse_metrics(
    metrics: Sequence[tuple[str, str]], model: mujoco.MjModel, episode: EpisodeColumns | None = None
) -> list[Metric]:
    """Parses metrics, given by name as written and text, in the names of a model and of the episode of a policy.

    Raises:
      UsageError: a metric is malformed, or contains an unknown name.
    """
    if not metrics:
        return []
    available = ModelVocabulary(model, episode.names if episode else ())
    parsed: list[Metric] = []
    for written, text in metrics:
        with concerning("metric", written):
            parsed.append(parse_metric(text, available, f"{option('metric')} {split_unit(written)[0]}"))
    return parsed


def metric_units(
    metrics: Sequence[tuple[str, str]], parsed: Sequence[Metric], columns: Mapping[str, str]
) -> dict[str, str]:
    """Returns the unit of each metric: the one beside its name as written, or that of the columns that it reads.

    A unit that does not follow from those of the columns is empty.

    Args:
      columns: the units of the columns of a trace.
    """
    named = zip(plain_metrics(metrics), parsed, strict=True)
    units = {name: expression_unit(metric.root, columns) for (name, _), metric in named}
    return units | written_units(metrics)


def written_units(metrics: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Returns the units beside the names of metrics as written, of those that have one."""
    return {name: unit for name, unit in map(split_unit, dict(metrics)) if unit is not None}


def column_units(model: mujoco.MjModel, names: Iterable[str], episode: EpisodeColumns | None = None) -> dict[str, str]:
    """Returns the units of those of `names` that are columns of a trace, and of others."""
    groups = {name.partition("/")[0] for name in names}
    return {TIME: "s"} | {each.name: each.unit for each in available_columns(model, episode, groups)}


def metric_columns(metrics: Sequence[Metric]) -> list[str]:
    """Returns the columns that metrics read, except the time."""
    return [*dict.fromkeys(name for metric in metrics for name in metric.columns if name != TIME)]


def manifest_writer(path: Path | str, facts: Mapping[str, object]) -> OutputWriter:
    """Writes the manifest of a folder, to be published by the caller.

    Raises:
      FileError: the manifest cannot be written.
    """
    return written_file(path, f"{json.dumps(facts, indent=2, default=str)}\n".encode())


# --- runs of MLflow ----------------------------------------------------------------------------------


def check_runs(folder: str, count: int, source: str) -> None:
    """Raises errors that would prevent `count` runs in a folder, before anything is simulated.

    Args:
      source: folder of the results.

    Raises:
      UsageError: there are too many, or the results would be in the folder.
      FileError: the folder holds anything but runs that mjrun has written, or cannot be created.
    """
    if count > MOST_RUNS:
        raise UsageError(
            f"{option('export_to')}: {count:,} points would be as many runs; MLflow lists up to {MOST_RUNS:,}"
        )
    path = Path(folder)
    if Path(source).resolve().is_relative_to(path.resolve()):
        raise UsageError(f"{option('export_to')} {clean(folder)} would replace the results in {clean(source)}")
    if not path.is_dir():
        if path.exists():
            raise FileError(path, "exists and is not a folder")
        StagedFile(path).cleanup()  # shows that its folder can be written
        return
    entries = [entry for entry in path.iterdir() if entry.name not in OF_MLFLOW]
    if any(not (entry / "tags" / MARK).is_file() for entry in entries):
        raise FileError(path, "holds files that mjrun has not written, and would be replaced as a whole")


def write_runs(
    folder: str, source: str, table: ResultsTable, parameters: Sequence[str], tags: Mapping[str, str]
) -> None:
    """Writes the rows of a table of points as the runs of one experiment; the folder appears whole or not.

    Names keep letters, digits and `_.-`; other characters become `_`. Points without a result are left out.

    Args:
      source: folder of the results, which names the experiment.
      parameters: names of the columns that are parameters; other numbers are metrics, and other texts are tags.
      tags: tags of all runs.

    Raises:
      UsageError, FileError: as `check_runs`; or the folder cannot be written.
    """
    check_runs(folder, len(table), source)
    target = Path(folder).resolve()
    with file_errors(folder, "written"):
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = TemporaryOutput(target, folder=True)
        try:
            _write_experiment(temporary.path / NEW, target, source, table, parameters, tags)
            replace_folder(temporary.path, target)
        finally:
            temporary.remove()


def _write_experiment(
    root: Path, target: Path, source: str, table: ResultsTable, parameters: Sequence[str], tags: Mapping[str, str]
) -> None:
    now = time.time_ns() // 10**6
    experiment = str(int(_hash(source)[:15], 16))
    facts = {"experiment_id": experiment, "name": Path(source).name or source, "lifecycle_stage": "active"}
    facts |= {"artifact_location": (target / experiment).as_uri(), "creation_time": now, "last_update_time": now}
    _write(root / experiment, {"meta.yaml": json.dumps(facts), f"tags/{MARK}": source})

    columns = dict(zip(_keys([column.name for column in table.columns]), table.columns, strict=True))
    for row in table.rows.tolist():
        files, run_tags = dict[str, str](), dict(tags)
        for (key, column), value in zip(columns.items(), row, strict=True):
            is_missing = value < 0 if column.labels else np.isnan(value)
            if is_missing or column.name == POINT.name:
                continue
            text = column.labels[int(value)] if column.labels else str(int(value) if column.integer else value)
            if column.name in parameters:
                files[f"params/{key}"] = text
            elif column.labels:
                run_tags[key] = text
            else:
                files[f"metrics/{key}"] = f"{now} {text} 0\n"
        status = run_tags.get("status")
        if status == "missing":
            continue
        name = run_tags["mlflow.runName"] = f"point {int(row[0])}"
        run = _hash(f"{source}\n{name}")[:32]
        facts = {"run_id": run, "run_name": name, "experiment_id": experiment, "lifecycle_stage": "active"}
        facts |= {"status": FINISHED if status == "ok" else FAILED, "start_time": now, "end_time": now, "tags": []}
        facts |= {"source_type": 4, "source_name": "mjrun", "source_version": "", "entry_point_name": ""}
        facts |= {"user_id": "", "artifact_uri": (target / experiment / run / "artifacts").as_uri()}
        files |= {f"tags/{key}": text for key, text in run_tags.items()}
        _write(root / experiment / run, {**files, "meta.yaml": json.dumps(facts)})


def _keys(names: Sequence[str]) -> list[str]:
    """Returns a name that MLflow accepts, and that is a file, for each column."""
    keys = list[str]()
    for name in names:
        key = re.sub(r"[^\w.-]+", "_", name, flags=re.ASCII).strip("_.")[:LONGEST_NAME] or "_"
        number, start = len(keys), key[: LONGEST_NAME - 6]
        while key in keys:
            key, number = f"{start}_{number}", number + 1
        keys.append(key)
    return keys


def _write(folder: Path, files: Mapping[str, str]) -> None:
    for name in ("params", "metrics", "tags"):
        (folder / name).mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text, "utf-8", newline="\n")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
