"""BOP: scene_camera.json, scene_gt.json, scene_gt_info.json and the models of objects; lengths are in millimetres.

https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from mjrun.formats.calibration_writer import CENTER
from mjrun.formats.datasets import DatasetRecords, Files, Record, require_perspective
from mjrun.formats.pointcloud import COLOR, PLACE, TYPES
from mjrun.scene_graph.object_meshes import ObjectMesh

SCENE = "000000"
NORMAL = (("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4"))
VERTEX = (*PLACE, *NORMAL, *COLOR)
FACE = np.dtype([("count", "u1"), ("vertices", "<i4", 3)])


def files(dataset: DatasetRecords) -> Files:
    """Returns the documents of one scene for each part of the dataset, and the models of the objects.

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
    meshes = {number: mesh for number, mesh in enumerate(dataset.meshes, 1) if mesh}
    written += [(f"models/obj_{number:06d}.ply", _ply(mesh)) for number, mesh in meshes.items()]
    if meshes:
        described = {str(number): _model(mesh) for number, mesh in meshes.items()}
        written.append(("models/models_info.json", _json(described)))
    return written


def _model(mesh: ObjectMesh) -> dict[str, float]:
    low, high = 1000 * mesh.positions.min(axis=0), 1000 * mesh.positions.max(axis=0)
    least = {f"min_{axis}": float(number) for axis, number in zip("xyz", low, strict=True)}
    sizes = {f"size_{axis}": float(number) for axis, number in zip("xyz", high - low, strict=True)}
    return {"diameter": 1000 * mesh.diameter, **least, **sizes}


def _ply(mesh: ObjectMesh) -> bytes:
    vertices, faces = np.empty(len(mesh.positions), list(VERTEX)), np.empty(len(mesh.faces), FACE)
    values = np.column_stack([1000 * mesh.positions, mesh.normals, mesh.colors])
    for (name, _), column in zip(VERTEX, values.T, strict=True):
        vertices[name] = column
    faces["count"], faces["vertices"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property {TYPES[kind]} {name}" for name, kind in VERTEX]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()


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
