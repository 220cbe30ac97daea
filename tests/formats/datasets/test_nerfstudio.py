"""transforms.json of Nerfstudio, against the camera's axes in OpenGL."""

import json

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.formats.datasets import DatasetRecords
from mjrun.formats.datasets.nerfstudio import files
from tests.formats.datasets.dataset_of_two import POSE, dataset, image


def test_frames_have_their_cameras_masks_and_depths() -> None:
    ((path, content),) = files(dataset())
    document = json.loads(content)
    assert path == "transforms.json"
    assert document["train_filenames"] == ["images/0.png"]
    assert [each["file_path"] for each in document["frames"]] == ["images/0.png", "images/5.png"]
    frame = document["frames"][1]
    assert (frame["mask_path"], frame["depth_file_path"]) == ("masks/5.png", "depth/5.png")
    assert (frame["fl_x"], frame["fl_y"], frame["cx"], frame["cy"]) == (20, 21, 6, 4.5)
    matrix = np.array(frame["transform_matrix"])
    np.testing.assert_allclose(matrix[:, 0], POSE[:, 0])
    np.testing.assert_allclose(matrix[:, 1:3], -POSE[:, 1:3])  # up and back instead of down and forward
    np.testing.assert_allclose(matrix[:, 3], POSE[:, 3])


def test_orthographic_cameras_are_refused() -> None:
    with pytest.raises(UsageError, match="nerfstudio has no orthographic cameras"):
        files(DatasetRecords({"train": [{**image(0), "perspective": False}]}, dataset().objects))
