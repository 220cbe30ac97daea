"""Options, plugins and assets as `mjrun info` shows them: columns of text."""

import os.path
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjrun.cli.table_cells import (
    Column,
    byte_size,
    number,
    numbers,
    texts,
    vector,
)
from mjrun.errors import clean

if TYPE_CHECKING:
    from mjrun.model.description.assets import Asset
    from mjrun.model.description.flexes_plugins import Plugin
    from mjrun.model.description.non_default_settings import NonDefaultSetting, Value


def settings(rows: Sequence["NonDefaultSetting"]) -> list[Column]:
    return [
        texts("setting", [row.path for row in rows]),
        Column("value", [_value(row.value) for row in rows]),
        Column("default", [_value(row.default) for row in rows]),
        texts("unit", [row.unit for row in rows]),
    ]


def _value(value: "Value") -> str:
    return vector(value) if isinstance(value, tuple) else value if isinstance(value, str) else number(value)


def assets(rows: Sequence["Asset"]) -> list[Column]:
    own = next((row.path for row in rows if row.kind == "model" and row.path), None)
    return [
        texts("kind", [row.kind for row in rows]),
        texts("name", [row.name for row in rows]),
        Column("size", ["" if row.path is None else byte_size(row.bytes) for row in rows], right=True),
        Column("content", [_content(row) for row in rows]),
        Column(
            "file" if own is None else "file, from the model's folder",
            [_beside(own, row.path) for row in rows],
            whole=True,
        ),
    ]


def _beside(own: str | None, path: str | None) -> str:
    """A path as seen from the folder of the model."""
    if path is None:
        return ""
    return clean(path if own is None else os.path.relpath(path, Path(own).parent))


def _content(row: "Asset") -> str:
    if "width" in row.content:
        return "x".join(map(str, row.content.values()))
    return ", ".join(f"{count} {what}" for what, count in row.content.items())


def plugins(rows: Sequence["Plugin"]) -> list[Column]:
    return [
        texts("name", [row.name for row in rows]),
        texts("plugin", [row.plugin for row in rows]),
        Column("computes", [", ".join(map(clean, row.users)) for row in rows]),
        Column("settings", [clean(", ".join(f"{k}={v}" for k, v in row.settings.items())) for row in rows]),
        numbers("state", [row.state for row in rows]),
    ]
