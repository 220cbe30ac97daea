"""A small dataset of two images with two objects, made by hand."""

import numpy as np

from mjrun.formats.datasets import DatasetRecords, Record
from mjrun.formats.segmentation_labels import regions

WIDTH, HEIGHT = 12, 9
IDS: np.ndarray = np.full((HEIGHT, WIDTH), -1)
IDS[2:6, 3:9] = 0
IDS[3, 5] = -1  # a hole
IDS[7, 0:2], IDS[4:8, 10] = 1, 1  # two parts
POSE = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 2.0], [0, 0, 0, 1]])


def mask(index: int) -> np.ndarray:
    """Returns the mask of an object in the first image."""
    own: np.ndarray = np.equal(IDS, index)
    return own


def image(number: int, ids: np.ndarray = IDS) -> Record:
    """Returns the record of an image with these objects."""
    found = {region.id: region for region in regions(ids)}
    objects = [
        {
            "id": index + 1,
            "name": name,
            "category": "thing" if name == "a" else "other",
            "pixels": found[index].area if index in found else 0,
            "silhouette": 30.0,
            "visible": (found[index].area if index in found else 0) / 30,
            "truncated": 0.1 * index,
            "bbox": list(found[index].bbox) if index in found else None,
            "outline": [2.4, 1.6, 7.0, 5.0],
            "counts": found[index].counts if index in found else None,
            "camera_from_object": POSE.tolist(),
            "keypoints": [[4.5, 3.25, 2.0], [0.0, 0.0, 0.0]] if name == "a" else [],
        }
        for index, name in enumerate("ab")
    ]
    return {
        "id": number,
        "files": {"rgb": f"images/{number}.png", "depth": f"depth/{number}.png", "masks": f"masks/{number}.png"},
        "camera": "free",
        "time": 0.5,
        "size": [WIDTH, HEIGHT],
        "K": [[20.0, 0, 6.0], [0, 21.0, 4.5], [0, 0, 1]],
        "world_from_camera": POSE.tolist(),
        "perspective": True,
        "objects": objects,
    }


def dataset(**options: object) -> DatasetRecords:
    """Returns a dataset whose second image shows only the first object."""
    alone = np.where(IDS == 1, -1, IDS)
    objects = [("a", "thing", ("tip", "end")), ("b", "other", ())]
    return DatasetRecords({"train": [image(0)], "val": [image(5, alone)]}, objects, **options)  # type: ignore[arg-type]
