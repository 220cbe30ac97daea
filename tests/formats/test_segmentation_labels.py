"""The legend of a picture, read back by the json module."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mjrun.formats.segmentation_labels import (
    CocoDocument,
    LabelsWriter,
    ascii_json,
    labels_beside,
    labels_document,
    regions,
)
from mjrun.model.camera_images import SegmentedObject

LEGEND = [
    SegmentedObject("geom", 4, "box", "torso"),
    SegmentedObject("site", 0, "site:0"),
    SegmentedObject("geom", 5, "floor", "world"),
]
IDS = np.array([[0, 0, -1], [2, 0, -1]], np.int32)
COLOURS = np.array([[255, 0, 0], [0, 255, 0], [1, 2, 3]], np.uint8)


@pytest.mark.parametrize(
    ("output", "labels"),
    [("a/v1.2.png", "v1.2.labels.json"), ("a/v1.2/", "v1.2.labels.json"), ("a/v1", "v1.labels.json")],
)
def test_the_labels_of_folders_whose_names_have_points_are_separate_files(output: str, labels: str) -> None:
    assert Path(labels_beside(output)) == Path("a", labels)


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
    said = labels_document(name, (3, 2), [SegmentedObject("geom", 0, name, body)] * 3, 0, ids=IDS)
    assert all(" " <= c <= "~" or c == "\n" for c in said)
    read = json.loads(said)
    assert (read["file"], read["labels"][0]["name"], read["labels"][0]["body"]) == (name, name, body)


def test_a_name_full_of_escapes_cannot_end_its_string() -> None:
    assert ascii_json('"\\\n\x1b[2J\x7f\x9b\u2028\ud800') == r'"\"\\\n\u001b[2J\u007f\u009b\u2028\ud800"'


def test_a_video_s_labels_have_no_counts_and_are_whole_or_absent(tmp_path: Path) -> None:
    with LabelsWriter(f"{tmp_path}/f.mkv"):
        pass
    assert list(tmp_path.iterdir()) == []
    with LabelsWriter(f"{tmp_path}/f.mkv") as writer:
        writer.write((3, 2), LEGEND, None)
        assert writer.publish() == [tmp_path / "f.labels.json"]
    said = json.loads((tmp_path / "f.labels.json").read_text())
    assert said["labels"][0] == {"id": 1, "type": "geom", "mujoco_id": 4, "name": "box", "body": "torso"}


ALIKE = [
    SegmentedObject("geom", 4, "box", "torso"),
    SegmentedObject("site", 0, "box", "torso"),
    SegmentedObject("geom", 5, "floor", "world"),
]

pictures = hnp.arrays(
    np.int32, hnp.array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.integers(-1, len(ALIKE) - 1)
)


def mask(segmentation: dict[str, Any]) -> np.ndarray:
    """Uncompressed RLE: runs of 0 and 1 in turn, 0 first, down each column and from the left column on."""
    height, width = segmentation["size"]
    flat = [index % 2 for index, count in enumerate(segmentation["counts"]) for _ in range(count)]
    assert len(flat) == height * width
    return np.array([[flat[x * height + y] for x in range(width)] for y in range(height)], bool)


def document(*pictures: np.ndarray, legend: list[SegmentedObject] = ALIKE) -> dict[str, Any]:
    gathered = CocoDocument()
    for index, ids in enumerate(pictures):
        gathered.add(ids, legend, {"file_name": f"{index}.png"})
    return json.loads(gathered.document())


@given(pictures)
def test_masks_boxes_and_areas_are_those_of_the_ids(ids: np.ndarray) -> None:
    found = {region.id: region for region in regions(ids)}
    assert list(found) == sorted(set(ids[ids >= 0].tolist()))
    for index, region in found.items():
        expected = ids == index
        assert (mask({"size": ids.shape, "counts": region.counts}) == expected).all()
        ys, xs = np.nonzero(expected)
        assert region.bbox == (xs.min(), ys.min(), xs.max() - xs.min() + 1, ys.max() - ys.min() + 1)
        assert region.area == expected.sum()
        assert all(region.counts[1:])  # a run of no pixels can only be the first


@given(st.lists(pictures, min_size=1, max_size=4))
def test_a_document_of_many_images_gives_back_every_picture(many: list[np.ndarray]) -> None:
    said = document(*many)
    index_of = {category["id"]: index for index, category in enumerate(said["categories"])}
    assert [a["id"] for a in said["annotations"]] == list(range(1, len(said["annotations"]) + 1))
    for image, ids in zip(said["images"], many, strict=True):
        drawn = np.full((image["height"], image["width"]), -1)
        for annotation in said["annotations"]:
            if annotation["image_id"] == image["id"]:
                drawn[mask(annotation["segmentation"])] = index_of[annotation["category_id"]]
        assert (drawn == ids).all()


def test_a_document_says_this() -> None:
    gathered = CocoDocument()
    gathered.add(IDS, ALIKE, {"file_name": "rgb.png", "camera": "side", "time": 0.5})
    said = json.loads(gathered.document())
    assert said["images"] == [
        {"id": 1, "width": 3, "height": 2, "file_name": "rgb.png", "camera": "side", "time": 0.5},
    ]
    assert said["annotations"] == [
        {
            "id": 1,
            "image_id": 1,
            "category_id": 1,
            "bbox": [0, 0, 2, 2],
            "area": 3,
            "iscrowd": 0,
            "segmentation": {"size": [2, 3], "counts": [0, 1, 1, 2, 2]},
        },
        {
            "id": 2,
            "image_id": 1,
            "category_id": 3,
            "bbox": [0, 1, 1, 1],
            "area": 1,
            "iscrowd": 0,
            "segmentation": {"size": [2, 3], "counts": [1, 1, 4]},
        },
    ]
    assert said["categories"] == [
        {"id": 1, "name": "geom/box", "supercategory": "geom", "mujoco_id": 4, "body": "torso"},
        {"id": 2, "name": "site/box", "supercategory": "site", "mujoco_id": 0, "body": "torso"},
        {"id": 3, "name": "floor", "supercategory": "geom", "mujoco_id": 5, "body": "world"},
    ]


def test_a_thing_is_one_category_in_every_image_even_where_legends_differ() -> None:
    gathered = CocoDocument()
    gathered.add(np.array([[0]], np.int32), ALIKE[:1], {})
    gathered.add(np.array([[0, 1]], np.int32), ALIKE[::-2], {})
    said = json.loads(gathered.document())
    names = {category["id"]: category["name"] for category in said["categories"]}
    found = [(a["image_id"], names[a["category_id"]], a["bbox"]) for a in said["annotations"]]
    assert found == [(1, "box", [0, 0, 1, 1]), (2, "floor", [0, 0, 1, 1]), (2, "box", [1, 0, 1, 1])]


def test_nothing_in_view_is_an_image_without_annotations() -> None:
    said = document(np.full((2, 2), -1, np.int32))
    assert len(said["images"]) == 1
    assert said["annotations"] == []
    assert len(said["categories"]) == len(ALIKE)


def test_a_time_that_json_cannot_say_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        CocoDocument().add(IDS, ALIKE, {"time": float("nan")})
