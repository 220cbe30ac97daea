"""Results of studies, read back against pandas."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import FileError
from mjrun.formats.study_results import read_study
from mjrun.formats.table_writer import TableWriter
from mjrun.model.column import Column

COLUMNS = [
    Column("point"),
    Column("mass"),
    Column("model", labels=("a.xml", "b.xml")),
    Column("z", meaning="metric"),
    Column("status", labels=("ok", "failed")),
    Column("message", labels=("no mesh",)),
]
ROWS = np.array([[0, 0.5, 0, 2.5, 0, -1], [1, 1.5, 1, np.nan, 1, 0]])


def write(folder: Path, manifest: dict[str, object]) -> Path:
    with TableWriter(str(folder / "results.parquet"), "parquet", COLUMNS, manifest) as writer:
        writer.write(ROWS)
        writer.publish()
    return folder


def test_numbers_and_texts_are_those_that_pandas_reads(tmp_path: Path) -> None:
    study = read_study(write(tmp_path, {"metrics": {"z": "last(xpos/box/z)"}}))
    frame = pd.read_parquet(tmp_path / "results.parquet")
    assert (study.parameters, study.metrics, len(study)) == (["mass", "model"], ["z"], 2)
    for name, values in study.numbers.items():
        np.testing.assert_array_equal(values, frame[name])
    assert list(study.texts["model"]) == frame["model"].tolist()
    assert study.status.tolist() == ["ok", "failed"]
    assert study.texts["message"] == ["", "no mesh"]


def test_a_folder_that_is_no_study_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"has no results\.parquet"):
        read_study(tmp_path)
    with pytest.raises(FileError, match="holds no results of a study"):
        read_study(write(tmp_path, {}))
    (tmp_path / "results.parquet").write_text("nothing")
    with pytest.raises(FileError, match="cannot be read"):
        read_study(tmp_path)
