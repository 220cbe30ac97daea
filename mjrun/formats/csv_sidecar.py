"""Metadata beside a CSV file, which state the unit and the meaning of each column, as in "CSV on the Web" of the W3C.

The units of `run.csv` are in `run.csv-metadata.json`: https://www.w3.org/TR/tabular-metadata/. They belong to the
titles of columns, whatever program wrote them.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

from mjrun.errors import FileError, clean
from mjrun.formats.input_file import is_file, opened, parse_manifest
from mjrun.model.table_column import Column

CONTEXT = "http://www.w3.org/ns/csvw"
UNIT, MEANING = "schema:unitText", "dc:description"
MOST = 2**24  # bytes that are read, at most


def metadata_path(table: Path) -> Path:
    """Returns the path of the metadata of a table."""
    return table.with_name(f"{table.name}-metadata.json")


def metadata(table: Path, columns: Sequence[Column]) -> bytes:
    """Returns the metadata of a table with these columns."""
    described: list[dict[str, str]] = []
    for column in columns:
        facts = {UNIT: column.unit, MEANING: column.meaning}
        described.append({"titles": clean(column.name), **{key: text for key, text in facts.items() if text}})
    document = {"@context": CONTEXT, "url": table.name, "tableSchema": {"columns": described}}
    return f"{json.dumps(document, indent=2, ensure_ascii=False)}\n".encode()


def units_beside(table: Path) -> dict[str, str]:
    """Returns the units in the metadata of a table, by column; empty if they are missing or are not metadata."""
    path = metadata_path(table)
    if not is_file(path):
        return {}
    try:
        with opened(path, "metadata file", ()) as file:
            document = parse_manifest(file.read(MOST))
    except FileError:
        return {}
    columns = _entry(_entry(document, "tableSchema"), "columns")
    known = [
        column for column in cast("list[Any]", columns if isinstance(columns, list) else []) if _entry(column, UNIT)
    ]
    return {title: column[UNIT] for column in known for title in _titles(column) if isinstance(column[UNIT], str)}


def _entry(node: object, key: str) -> object:
    """Returns an entry of an object in a document, which is untrusted; None if it is missing."""
    return cast("dict[str, object]", node).get(key) if isinstance(node, dict) else None


def _titles(column: dict[str, object]) -> Iterator[str]:
    titles = column.get("titles", column.get("name"))
    yield from (title for title in (titles if isinstance(titles, list) else [titles]) if isinstance(title, str))
