"""JSON Lines, beside the json module."""

import codecs
import json
from pathlib import Path

from tests.formats.table_files import bits, lists, put


def test_jsonl_of_others_is_read(tmp_path: Path) -> None:
    rows = [
        {"time": 0, "note": "a\nb", "ctrl/a": True, "more": {"x": [1, None], "time": 3}},
        {"ctrl/a": 2, "time": 2**70, "else": 1},
        {"time": -0.0, "ctrl/a": 1e-320, "note": None},
    ]
    text = "\n" + "\r\n \r\n".join(map(json.dumps, rows))
    path = put(tmp_path / "t.jsonl", codecs.BOM_UTF8 + text.replace("/", "\\/").encode())
    found = lists(path, "time", "ctrl/a")
    assert list(found) == ["time", "ctrl/a"]
    assert bits(list(found.values())) == bits([[0, 2.0**70, -0.0], [1, 2, 1e-320]])


def test_what_is_nested_deeply_and_not_wanted_does_no_harm(tmp_path: Path) -> None:
    path = put(tmp_path / "t.jsonl", '{"time":1,"note":' + "[" * 1000 + "]" * 1000 + "}")
    assert lists(path, "time") == {"time": [1]}
