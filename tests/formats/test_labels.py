"""The legend of a picture, read back by the json module."""

import json
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mjrun.formats.labels import LabelsWriter, ascii_json, labels_document
from mjrun.model.rendered_view import Segment

LEGEND = [Segment("geom", 4, "box", "torso"), Segment("site", 0, "site:0"), Segment("geom", 5, "floor", "world")]
IDS = np.array([[0, 0, -1], [2, 0, -1]], np.int32)
COLOURS = np.array([[255, 0, 0], [0, 255, 0], [1, 2, 3]], np.uint8)


def test_every_thing_has_an_entry_seen_or_not() -> None:
    said = json.loads(labels_document("a.png", (3, 2), LEGEND, 0, COLOURS, IDS))
    assert said == {
        "file": "a.png",
        "size": [3, 2],
        "nothing": 0,
        "labels": [
            {"id": 1, "type": "geom", "mujoco_id": 4, "name": "box", "body": "torso", "pixels": 3, "rgb": [255, 0, 0]},
            {"id": 2, "type": "site", "mujoco_id": 0, "name": "site:0", "body": "", "pixels": 0, "rgb": [0, 255, 0]},
            {"id": 3, "type": "geom", "mujoco_id": 5, "name": "floor", "body": "world", "pixels": 1, "rgb": [1, 2, 3]},
        ],
    }


def test_ids_follow_what_means_nothing_and_colours_may_be_absent() -> None:
    said = json.loads(labels_document("a.npy", (3, 2), LEGEND, -1, ids=IDS))
    assert said["nothing"] == -1
    assert [entry["id"] for entry in said["labels"]] == [0, 1, 2]
    assert all("rgb" not in entry for entry in said["labels"])


def test_a_picture_of_nothing_has_labels_too() -> None:
    nothing = np.full((2, 2), -1, np.int32)
    assert json.loads(labels_document("a.png", (2, 2), [], 0, ids=nothing))["labels"] == []
    assert [e["pixels"] for e in json.loads(labels_document("a.png", (2, 2), LEGEND, 0, ids=nothing))["labels"]] == [
        0,
        0,
        0,
    ]


@given(st.text(st.characters(exclude_categories=())), st.text(st.characters(exclude_categories=())))
def test_any_name_reads_back_and_is_printed_in_plain_ascii(name: str, body: str) -> None:
    said = labels_document(name, (3, 2), [Segment("geom", 0, name, body)] * 3, 0, ids=IDS)
    assert all(" " <= c <= "~" or c == "\n" for c in said)
    read = json.loads(said)
    assert (read["file"], read["labels"][0]["name"], read["labels"][0]["body"]) == (name, name, body)


def test_a_name_full_of_escapes_cannot_end_its_string() -> None:
    assert ascii_json('"\\\n\x1b[2J\x7f\x9b\u2028\ud800') == r'"\"\\\n\u001b[2J\u007f\u009b\u2028\ud800"'


def test_a_film_s_labels_have_no_counts_and_are_whole_or_absent(tmp_path: Path) -> None:
    with LabelsWriter(f"{tmp_path}/f.mkv"):
        pass
    assert list(tmp_path.iterdir()) == []
    with LabelsWriter(f"{tmp_path}/f.mkv") as writer:
        writer.write((3, 2), LEGEND, None)
        assert writer.publish() == [tmp_path / "f.labels.json"]
    said = json.loads((tmp_path / "f.labels.json").read_text())
    assert said["labels"][0] == {"id": 1, "type": "geom", "mujoco_id": 4, "name": "box", "body": "torso"}
