"""Results of studies, read back against pandas."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import FileError
from mjrun.formats.study_reader import (
    NAME,
    folder_of_results,
    point_folders,
    point_names,
    point_values,
    read_point,
    read_study,
    values_in_words,
)
from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column

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
    assert [*study.texts["message"]] == ["", "no mesh"]


def test_a_folder_that_is_no_study_is_reported(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"has no results\.parquet"):
        read_study(tmp_path)
    (tmp_path / "parts").mkdir()
    with pytest.raises(FileError, match="the study is not finished"):
        read_study(tmp_path)
    (tmp_path / "episodes.csv").touch()
    with pytest.raises(FileError, match=r"episodes\.csv --x seed --y return -o returns\.png` plots its episodes"):
        read_study(tmp_path)
    with pytest.raises(FileError, match="holds no results of a study"):
        read_study(write(tmp_path, {}))
    (tmp_path / "results.parquet").write_text("nothing")
    with pytest.raises(FileError, match="cannot be read"):
        read_study(tmp_path)


def test_a_table_means_a_study_only_in_the_folder_of_one(tmp_path: Path) -> None:
    table = str(tmp_path / "results.parquet")
    assert folder_of_results(table) == ""
    (tmp_path / "study.json").touch()
    assert folder_of_results(table) == folder_of_results(str(tmp_path / "results.csv")) == str(tmp_path)
    assert folder_of_results(str(tmp_path / "sensitivity.parquet")) == folder_of_results("-") == ""


def test_values_have_the_shortest_names_that_tell_them_apart() -> None:
    values = {"opt.timestep": "0.0100000", "geom/floor.friction[0]": "0.123456", "geom/ball.friction[0]": "2"}
    assert values_in_words(values) == ["timestep 0.01", "floor.friction[0] 0.1235", "ball.friction[0] 2"]
    assert values_in_words({"model": "models/car.xml", "seed": "3"}) == ["model car", "seed 3"]
    assert values_in_words({"model": "models/arm.urdf", "ctrl_from": "a/b.csv"}) == ["model arm", "ctrl_from a/b.csv"]
    assert values_in_words({"qpos/hip": "1", "qvel/hip": "2"}) == ["qpos/hip 1", "qvel/hip 2"]
    units = {"qpos/hip": "rad", "qpos/knee": "rad"}
    assert values_in_words({"qpos/hip": "30deg", "qpos/knee": "1"}, units) == ["hip 30deg", "knee 1 rad"]


def test_points_are_named_by_the_values_that_differ_with_as_many_digits_as_that_takes() -> None:
    points = [{"opt.timestep": step, "seed": "1"} for step in ("0.01", "0.02")]
    assert point_names(points, {"opt.timestep": "s"}) == ["timestep 0.01 s", "timestep 0.02 s"]
    assert point_names([{"qvel/hip": text} for text in ("1", "1.0000001")]) == ["hip 1", "hip 1.0000001"]
    assert point_names([{"seed": "1"}, {"mass": "1"}]) == ["", ""]


def test_a_manifest_that_is_not_there_or_broken_tells_nothing(tmp_path: Path) -> None:
    assert read_point(tmp_path) == {}
    for text in ("[1", "[1]", "[" * 100_000):
        (tmp_path / NAME).write_text(text)
        assert point_values(tmp_path) == {}
    (tmp_path / NAME).write_text(json.dumps({"values": {"seed": "3"}}))
    assert point_values(tmp_path) == {"seed": "3"}


def test_a_manifest_of_a_study_that_is_broken_lists_no_files(tmp_path: Path) -> None:
    folder = write(tmp_path, {"metrics": {"z": "last(z)"}, "columns": []})
    for text, points in (('{"with_files": [1, "x"]}', {1}), ('{"with_files": 1}', set()), ("[" * 100_000, set())):
        (folder / "study.json").write_text(text)
        assert read_study(folder).with_files == points


def test_folders_of_points_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (999999, 1000000, 7, 1234567):
        (tmp_path / f"points/{number:06}").mkdir(parents=True)
    assert list(point_folders(tmp_path)) == [7, 999999, 1000000, 1234567]
