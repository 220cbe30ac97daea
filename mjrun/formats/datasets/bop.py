"""BOP: scene_camera.json, scene_gt.json and scene_gt_info.json; lengths are in millimetres.

https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from mjrun.formats.calibration_writer import CENTER
from mjrun.formats.datasets import DatasetRecords, Files, Record, require_perspective

SCENE = "000000"


def files(dataset: DatasetRecords) -> Files:
    """Returns the documents of one scene for each part of the dataset.

    Raises:
      UsageError: a camera has no perspective.
    """
    written = list[tuple[str, bytes]]()
    for part, records in dataset.records.items():
        documents: dict[str, dict[str, Any]] = {
            "scene_camera": {str(record["id"]): _camera(record) for record in records},
            "scene_gt": {str(record["id"]): [_pose(each) for each in record["objects"]] for record in records},
            "scene_gt_info": {str(record["id"]): [_info(each) for each in record["objects"]] for record in records},
        }
        written += [(f"{part}/{SCENE}/{name}.json", _json(document)) for name, document in documents.items()]
    return written


def _camera(record: Record) -> dict[str, Any]:
    require_perspective("bop", record["camera"], perspective=record["perspective"])
    matrix, pose = np.array(record["K"]), np.linalg.inv(record["world_from_camera"])
    matrix[:2, 2] -= CENTER  # whole numbers are the centres of pixels
    return {
        "cam_K": matrix.ravel().tolist(),
        "depth_scale": 1.0,
        "cam_R_w2c": pose[:3, :3].ravel().tolist(),
        "cam_t_w2c": (1000 * pose[:3, 3]).tolist(),
    }


def _pose(labelled: Record) -> dict[str, Any]:
    pose = np.array(labelled["camera_from_object"])
    return {
        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
        "cam_t_m2c": (1000 * pose[:3, 3]).tolist(),
        "obj_id": labelled["id"],
    }


def _info(labelled: Record) -> dict[str, Any]:
    silhouette = round(labelled["silhouette"])
    return {
        "bbox_obj": [round(number) for number in labelled["outline"]] if silhouette else [-1] * 4,
        "bbox_visib": labelled["bbox"] or [-1] * 4,
        "px_count_all": silhouette,
        "px_count_valid": round(silhouette * (1 - labelled["truncated"])),  # depth is known in the whole image
        "px_count_visib": labelled["pixels"],
        "visib_fract": labelled["pixels"] / silhouette if silhouette else 0.0,
    }


def _json(document: Mapping[str, Any]) -> bytes:
    """Returns a document with a line for each image."""
    lines = (f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in document.items())
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()
