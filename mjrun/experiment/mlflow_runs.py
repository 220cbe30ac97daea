"""Tables of results as runs of MLflow, in the format of its file store: a file for each parameter, metric and tag."""

import hashlib
import json
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mjrun.errors import FileError, UsageError, file_errors, option
from mjrun.experiment.results_table import POINT, ResultsTable
from mjrun.formats.temporary_output import NEW, TemporaryOutput, replace_folder

MOST = 10_000  # runs, each of a dozen files
LONGEST = 250  # characters of a name
FINISHED, FAILED = 3, 4  # MLflow's RunStatus
MARK = "source_of_mjrun"  # tag of all experiments that mjrun has written
OF_MLFLOW = ("0", ".trash", "models")  # what MLflow adds when it opens the folder


def check_runs(folder: str, count: int) -> None:
    """Raises errors that would prevent `count` runs in a folder, before anything is simulated.

    Raises:
      UsageError: there are too many.
      FileError: the folder holds anything but runs that mjrun has written.
    """
    if count > MOST:
        raise UsageError(f"{option('export_to')}: {count:,} points would be as many runs; MLflow lists up to {MOST:,}")
    path = Path(folder)
    if not path.is_dir():
        if path.exists():
            raise FileError(path, "exists and is not a folder")
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
    check_runs(folder, len(table))
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
        key = re.sub(r"[^\w.-]+", "_", name, flags=re.ASCII).strip("_.")[:LONGEST] or "_"
        keys.append(key if key not in keys else f"{key[: LONGEST - 5]}_{len(keys)}")
    return keys


def _write(folder: Path, files: Mapping[str, str]) -> None:
    for name in ("params", "metrics", "tags"):
        (folder / name).mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text, "utf-8", newline="\n")


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
