"""COCO: annotations/instances_SPLIT.json. https://cocodataset.org/#format-data"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from mjrun.formats.datasets import DatasetRecords, Files, Record
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


def mask_of(counts: Sequence[int], size: tuple[int, int]) -> np.ndarray:
    """Returns the mask `(h, w)` bool of run lengths without and with it, column by column."""
    width, height = size
    values = np.zeros(width * height, bool)
    ends = np.cumsum(counts)
    for start, end in zip(ends[0::2], ends[1::2], strict=False):
        values[start:end] = True
    return values.reshape(width, height).T


def polygons(mask: np.ndarray) -> list[np.ndarray]:
    """Returns the outlines `(n, 2)` of the parts of a mask, x and y in pixels from the corner of the image.

    They run along the borders of pixels, so that filling them gives the mask; holes are filled.
    """
    from contourpy import contour_generator

    padded = np.pad(mask.astype(float), 1)
    # A pixel is a square around its sample: its corners, doubled, make the outline follow its border.
    fine = np.kron(padded, np.ones((2, 2)))
    lines = contour_generator(z=fine, name="serial").lines(0.5)
    outlines = list[np.ndarray]()
    for line in lines:
        points = np.asarray(line)
        if area(points) > 0:  # holes run the other way
            outlines.append(_corners(np.clip((points[:-1] + 0.5) / 2 - 1, 0, [mask.shape[1], mask.shape[0]])))
    return outlines


def _corners(points: np.ndarray) -> np.ndarray:
    """Returns a closed polygon without the points on straight lines."""
    before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turns: np.ndarray = before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]
    return points[turns]


def area(points: np.ndarray) -> float:
    """Returns the area of a closed polygon, positive if it runs counter-clockwise with y up."""
    x, y = points.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)) / 2
