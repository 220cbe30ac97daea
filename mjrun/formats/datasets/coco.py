"""COCO: annotations/instances_SPLIT.json. https://cocodataset.org/#format-data"""

from collections.abc import Iterator
from typing import Any

from mjrun.formats.datasets import DatasetRecords, Files, Record
from mjrun.formats.datasets.mask_encodings import mask_of, polygons
from mjrun.formats.segmentation_labels import INFO, ascii_json, json_document


def files(dataset: DatasetRecords) -> Files:
    """Returns a document for each part of the dataset."""
    return [(f"annotations/instances_{part}.json", _document(dataset, part)) for part in dataset.records]


def _document(dataset: DatasetRecords, part: str) -> bytes:
    records, numbers = dataset.records[part], {name: i for i, name in enumerate(dataset.categories, 1)}
    categories = [_category(dataset, name, number) for name, number in numbers.items()]
    images = [
        {"id": each["id"], "width": each["size"][0], "height": each["size"][1], "file_name": each["files"]["rgb"]}
        for each in records
    ]
    annotations = [each for record in records for each in _annotations(dataset, record, numbers)]
    for number, annotation in enumerate(annotations, 1):  # 0 means no match to pycocotools
        annotation["id"] = number
    lists = {"images": images, "annotations": annotations, "categories": categories}
    texts = {name: map(ascii_json, items) for name, items in lists.items()}
    return json_document({"info": {**INFO, "description": "dataset by mjrun"}, "licenses": []}, texts).encode()


def _category(dataset: DatasetRecords, name: str, number: int) -> dict[str, Any]:
    points = dataset.keypoints(name)
    return {"id": number, "name": name, **({"keypoints": points, "skeleton": []} if points else {})}


def _annotations(dataset: DatasetRecords, record: Record, numbers: dict[str, int]) -> Iterator[dict[str, Any]]:
    width, height = record["size"]
    for each in record["objects"]:
        if each["bbox"] is None:
            continue
        segmentation: object = {"size": [height, width], "counts": each["counts"]}
        if dataset.polygons:
            outlines = polygons(mask_of(each["counts"], (width, height)))
            segmentation = [outline.ravel().tolist() for outline in outlines]
        annotation = {
            "image_id": record["id"],
            "category_id": numbers[each["category"]],
            "bbox": each["bbox"],
            "area": each["pixels"],
            "iscrowd": 0,
            "segmentation": segmentation,
            "object": each["name"],
            "visible": each["visible"],
            "truncated": each["truncated"],
        }
        if dataset.keypoints(each["category"]):
            points = keypoints(dataset, each)
            annotation["keypoints"] = [number for point in points for number in point]
            annotation["num_keypoints"] = sum(point[2] > 0 for point in points)
        yield annotation


def keypoints(dataset: DatasetRecords, labelled: Record) -> list[list[float]]:
    """Returns x, y and visibility of each keypoint of the category of an object; zeros for those it lacks."""
    own = dict(zip(dataset.objects[labelled["id"] - 1][2], labelled["keypoints"], strict=True))
    points = (own.get(name, (0.0, 0.0, 0)) for name in dataset.keypoints(labelled["category"]))
    return [[x, y, int(visibility)] for x, y, visibility in points]
