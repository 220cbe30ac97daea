"""Tables of results against pandas, and requirements on them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import POINT, Requirements, ResultsTable, check_metric_names, manifest_writer
from mjrun.model.table_column import Column
from tests.cases import cases

DESIGN = Design(("seed", "geom/a.size", "model"), [("3", "0.1", "a.xml"), ("4", "0.2", "b.xml")])


def table() -> ResultsTable:
    made = ResultsTable()
    made.add(POINT, [1, 0, 1])
    made.add_parameters(DESIGN, [1, 0, 1])
    made.add(Column("drift"), [0.5, np.nan, 2])
    made.add_texts("status", ["ok", "", "bad"])
    return made


def test_whole_numbers_of_mujoco_are_written_as_such(tmp_path: Path) -> None:
    names = ("opt.iterations", "geom/*.contype", "opt.timestep", "scale:geom/a.condim")
    whole = ResultsTable()
    whole.add_parameters(Design(names, [("5.0", "1", "1", "2"), ("10.0", "0", "2", "3")]))
    for path in whole.write(tmp_path, {}):
        read = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
        assert [kind.kind for kind in read.dtypes] == ["i", "i", "f", "f"]
        assert [*read[names[0]]] == [5, 10]


def test_parameters_are_numbers_where_all_values_are_and_null_stands_for_no_text(tmp_path: Path) -> None:
    for path in table().write(tmp_path, {}):
        read = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
        assert [*read] == ["point", "seed", "geom/a.size", "model", "drift", "status"]
        assert [str(read[name].dtype) for name in ("point", "seed", "geom/a.size")] == ["int64", "int64", "float64"]
        assert read["geom/a.size"].tolist() == [0.2, 0.1, 0.2]
        assert read["model"].tolist() == ["b.xml", "a.xml", "b.xml"]
        assert read["status"].isna().tolist() == [False, True, False]
    assert [*table().numbers] == ["point", "seed", "geom/a.size", "drift"]
    flags = table().flags("status", ["bad", "worse"])
    assert {name: values.tolist() for name, values in flags.items()} == {"bad": [0, 0, 1], "worse": [0, 0, 0]}


def verdicts(*texts: str) -> list[tuple[bool, str]]:
    made = table()
    requirements = Requirements(texts, ["seed", "drift"], ["ok", "bad"], lambda text: text.replace("awry", "bad "))
    result = requirements.verdicts(made.numbers | made.flags("status", ["ok", "bad"]))
    return [(verdict.passed, verdict.text) for verdict in result]


def test_requirements_hold_over_all_rows_and_flags_count_them() -> None:
    assert verdicts("seed > 2", "share(bad) < 0.3", "count(ok > 0) == 1", "max(drift, ok > 0) < 1") == [
        (True, "seed > 2"),
        (False, "share(bad) < 0.3"),
        (True, "count(ok > 0) == 1"),
        (True, "max(drift, ok > 0) < 1"),
    ]
    assert verdicts("count(awry > 0) == 1") == [(True, "count(awry > 0) == 1")]  # as it is written, however it is read


def test_a_requirement_on_nothing_is_refused_with_its_place() -> None:
    with pytest.raises(UnknownNameError, match="drft") as caught:
        Requirements(["seed > 2", "drft > 1"], ["seed", "drift"], [])
    assert caught.value.path == ("require", 1)


@cases("metrics, expected")
def test_names_that_metrics_cannot_have_are_refused(metrics: Sequence[str], expected: str) -> None:
    check_metric_names([("x", "max(time)"), ("y [m/s]", "max(time)")], ["status"])
    with pytest.raises(UsageError, match=expected):
        check_metric_names([(name, "max(time)") for name in metrics], ["status"])


def test_a_manifest_appears_when_it_is_published(tmp_path: Path) -> None:
    with manifest_writer(tmp_path / "a" / "study.json", {"points": 3, "folder": tmp_path}) as output:
        assert not [*tmp_path.rglob("*.json")]
        output.publish()
    assert (tmp_path / "a" / "study.json").read_text() == f'{{\n  "points": 3,\n  "folder": "{tmp_path}"\n}}\n'
