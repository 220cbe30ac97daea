"""Nerfstudio: transforms.json with the camera, the mask and the depth of each image.

https://docs.nerf.studio/quickstart/data_conventions.html
"""

import json
from typing import Any

import numpy as np

from mjrun.formats.calibration_writer import OPENGL
from mjrun.formats.datasets import DatasetRecords, Files, Record, require_perspective


def files(dataset: DatasetRecords) -> Files:
    """Returns transforms.json.

    Raises:
      UsageError: a camera has no perspective.
    """
    parts = {f"{part}_filenames": [each["files"]["rgb"] for each in each] for part, each in dataset.records.items()}
    frames = [_frame(record) for records in dataset.records.values() for record in records]
    document = {"camera_model": "OPENCV", "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, **parts, "frames": frames}
    return [("transforms.json", f"{json.dumps(document, allow_nan=False)}\n".encode())]


def _frame(record: Record) -> dict[str, Any]:
    require_perspective("nerfstudio", record["camera"], perspective=record["perspective"])
    matrix = record["K"]
    return {
        "file_path": record["files"]["rgb"],
        "depth_file_path": record["files"]["depth"],
        "mask_path": record["files"]["masks"],
        "time": record["time"],
        "w": record["size"][0],
        "h": record["size"][1],
        "fl_x": matrix[0][0],
        "fl_y": matrix[1][1],
        "cx": matrix[0][2],
        "cy": matrix[1][2],
        "transform_matrix": (np.array(record["world_from_camera"]) @ OPENGL).tolist(),
    }
