"""Runs of MLflow, read back by its own library."""

import math
from pathlib import Path

import pytest

from mjrun.errors import FileError, UsageError
from mjrun.experiment.results_table import MOST_RUNS, POINT, ResultsTable, _keys, check_runs, write_runs
from mjrun.model.table_column import Column

PARAMETERS = ("geom/wood.friction[0]", "geom/wood.friction(0)", "../../seed", "model")


def table(masses: list[float]) -> ResultsTable:
    made, count = ResultsTable(), len(masses)
    made.add(POINT, range(count))
    made.add(Column(PARAMETERS[0]), masses)
    made.add(Column(PARAMETERS[1]), [5.0] * count)
    made.add(Column(PARAMETERS[2], integer=True), [7] * count)
    made.add_texts(PARAMETERS[3], ["häuser/a.xml"] * count)
    made.add(Column("slid"), [math.nan, *[0.1 + 0.2] * (count - 1)])
    made.add_texts("status", ["unstable", "ok", "missing"][:count])
    made.add_texts("message", ["a: b\n#", "", ""][:count])
    return made


def test_mlflow_reads_every_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    from mlflow.store.tracking.file_store import FileStore
    from mlflow.utils.validation import _validate_metric, _validate_param

    folder = tmp_path / "new" / "mlruns"
    for masses in ([1.0, 2.0], [1.0, 0.1, 3.0]):  # the second replaces the first, which MLflow has opened
        write_runs(str(folder), "studies/slide", table(masses), PARAMETERS, {"task": "push"})
        store = FileStore(str(folder))
        (experiment,) = [each for each in store.search_experiments() if each.name == "slide"]
        runs = store.search_runs([experiment.experiment_id], "", 1, order_by=["tags.mlflow.runName"])
    failed, ok = runs

    keys = ["geom_wood.friction_0", "geom_wood.friction_0_2", "seed", "model"]
    assert ok.data.params == dict(zip(keys, ["0.1", "5.0", "7", "häuser/a.xml"], strict=True))
    assert ok.data.metrics == {"slid": 0.1 + 0.2}
    assert ok.info.status == "FINISHED"
    assert ok.data.tags == {"mlflow.runName": "point 1", "status": "ok", "task": "push"}
    assert (failed.info.status, failed.data.metrics, failed.data.tags["message"]) == ("FAILED", {}, "a: b\n#")
    for key, value in ok.data.params.items():
        _validate_param(key, value)
    for key, value in ok.data.metrics.items():
        _validate_metric(key, value, 0, 0)
    assert [path.name for path in folder.parent.iterdir()] == ["mlruns"]


def test_other_files_and_too_many_points_are_refused(tmp_path: Path) -> None:
    check_runs(str(tmp_path), MOST_RUNS, "s")
    with pytest.raises(UsageError, match="export_to: 10,001 points would be as many runs"):
        check_runs(str(tmp_path), MOST_RUNS + 1, "s")
    (tmp_path / "123" / "tags").mkdir(parents=True)
    with pytest.raises(FileError, match="holds files that mjrun has not written"):
        write_runs(str(tmp_path), "slide", table([1.0]), PARAMETERS, {})
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="is not a folder"):
        check_runs(str(tmp_path / "file"), 1, "s")
    with pytest.raises(FileError, match="is not a folder"):
        check_runs(str(tmp_path / "file" / "runs"), 1, "s")
    for source in ("new", "new/study"):
        with pytest.raises(UsageError, match=r"export_to .*new would replace the results in"):
            check_runs(str(tmp_path / "new"), 1, str(tmp_path / source))


def test_columns_whose_names_become_alike_keep_separate_keys() -> None:
    names = ["a_2", "a:", "a", "a;", "a_4"]
    keys = _keys(names)
    assert len(set(keys)) == len(names)
