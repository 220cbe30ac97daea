"""Metadata beside CSV files, of mjrun and of other programs."""

import json
from pathlib import Path

import pytest

from mjrun.formats.table_reader import read_table
from mjrun.formats.table_writer import metadata, metadata_path, units_beside
from mjrun.model.table_column import Column
from tests.formats.table_files import put


def test_units_are_those_of_the_columns(tmp_path: Path) -> None:
    table, columns = tmp_path / "t.csv", [Column("time", "s", "simulated time"), Column("n"), Column("a\nb", "m")]
    assert units_beside(table) == {}
    metadata_path(table).write_bytes(metadata(table, columns))
    assert units_beside(table) == {"time": "s", r"a\nb": "m"}


@pytest.mark.parametrize(
    "content", ["", "[]", '{"tableSchema": 3}', '{"tableSchema": {"columns": [1, {"titles": 2}]}}']
)
def test_metadata_without_units_states_none(tmp_path: Path, content: str) -> None:
    path = put(tmp_path / "t.csv", "a\n1\n")
    put(tmp_path / "t.csv-metadata.json", content)
    assert read_table(path).units == {"a": ""}


def test_metadata_of_other_programs_has_several_titles(tmp_path: Path) -> None:
    path = put(tmp_path / "t.csv", "a\n1\n")
    column = {"titles": ["Höhe", "a"], "schema:unitText": "km"}
    put(tmp_path / "t.csv-metadata.json", json.dumps({"tableSchema": {"columns": [column]}}))
    assert read_table(path).units == {"a": "km"}
