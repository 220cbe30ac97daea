"""Datasets of a model, read by the loaders of those who train with them.

Ultralytics needs PyTorch, and the BOP toolkit is not on PyPI; `make loaders` installs both and runs these tests.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.reporter import PythonApiReporter
from mjrun.study.image_dataset import Dataset

MODEL = """<mujoco><worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body name="ball" pos=".15 0 .1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
SIZE = WIDTH, HEIGHT = 80, 60
VARY = {"camera.azimuth": "uniform(0,360)"}  # so that the ball is behind the box in some images


def make_dataset(folder: Path, form: str) -> Path:
    """Makes a dataset of a format, or of several, in a folder of its name."""
    (folder / "m.xml").write_text(MODEL)
    Dataset(
        mjrun.Simulation(folder / "m.xml"),
        str(folder / form),
        format=form,
        vary=VARY,
        samples=6,
        split="train=0.5,val=0.5",
        camera=("free:elevation=-20,distance=1",),
        size=SIZE,
        quality="draft",
        jobs=1,
    ).run(PythonApiReporter())
    return folder / form


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset for COCO and YOLO."""
    return make_dataset(tmp_path_factory.mktemp("datasets"), "coco,yolo")


def instances(folder: Path) -> Iterator[tuple[str, int, np.ndarray]]:
    """Yields each visible object: the name of its image, its number from 1, and its mask."""
    for document in sorted((folder / "records").glob("*.json")):
        (image,) = json.loads(document.read_text())["images"]
        ids = np.array(Image.open(folder / image["files"]["masks"]))
        for number in (1, 2):
            if (ids == number).any():
                yield Path(image["files"]["rgb"]).name, number, ids == number


@pytest.mark.filterwarnings("ignore:__array__:DeprecationWarning")  # in pycocotools
def test_pycocotools_reads_every_mask(dataset: Path) -> None:
    from pycocotools.coco import COCO

    found = list[tuple[str, int, np.ndarray]]()
    for split in ("train", "val"):
        coco = COCO(str(dataset / f"annotations/instances_{split}.json"))
        for annotation in coco.loadAnns(coco.getAnnIds()):
            (image,) = coco.loadImgs([annotation["image_id"]])
            mask = coco.annToMask(annotation).astype(bool)
            found.append((Path(image["file_name"]).name, annotation["category_id"], mask))
    expected = list(instances(dataset))
    assert len(found) == len(expected) > 6
    for ours, theirs in zip(expected, sorted(found, key=lambda each: each[:2]), strict=True):
        assert ours[:2] == theirs[:2]
        np.testing.assert_array_equal(ours[2], theirs[2])


@pytest.mark.filterwarnings("default")  # of libraries that only this test imports
def test_ultralytics_reads_every_box(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YOLO_CONFIG_DIR", str(dataset.parent))
    loader = pytest.importorskip("ultralytics.data.dataset")
    description = pytest.importorskip("ultralytics.data.utils").check_det_dataset(str(dataset / "data.yaml"))
    found = dict[tuple[str, int], np.ndarray]()
    for split in ("train", "val"):
        images = loader.YOLODataset(img_path=description[split], data=description, augment=False, imgsz=WIDTH)
        for label in images.labels:
            for category, box in zip(label["cls"].ravel(), label["bboxes"], strict=True):
                found[Path(label["im_file"]).name, int(category) + 1] = box
        assert images[0]["img"].shape[0] == 3  # the image itself is read
    expected = {(name, number): mask for name, number, mask in instances(dataset)}
    assert found.keys() == expected.keys()
    for key, mask in expected.items():
        rows, columns = np.nonzero(mask)
        x, y, width, height = found[key] * [WIDTH, HEIGHT, WIDTH, HEIGHT]
        box = [x - width / 2, y - height / 2, x + width / 2, y + height / 2]
        np.testing.assert_allclose(box, [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], atol=1e-3)
    assert description["names"] == {0: "box", 1: "ball"}


@pytest.mark.filterwarnings("default")
def test_the_bop_toolkit_reads_every_pose_mask_and_depth(tmp_path: Path) -> None:
    inout = pytest.importorskip("bop_toolkit_lib.inout")
    dataset = make_dataset(tmp_path, "bop")
    nearest, numbers = list[float](), set[int]()
    for scene in [dataset / f"{split}/000000" for split in ("train", "val")]:
        cameras = inout.load_scene_camera(str(scene / "scene_camera.json"))
        poses = inout.load_scene_gt(str(scene / "scene_gt.json"))
        facts = inout.load_json(str(scene / "scene_gt_info.json"), keys_to_int=True)
        assert cameras.keys() == poses.keys() == facts.keys()
        numbers.update(cameras)
        for number, camera in cameras.items():
            depth = inout.load_depth(str(scene / f"depth/{number:06}.png")) * camera["depth_scale"]
            for index, (pose, fact) in enumerate(zip(poses[number], facts[number], strict=True)):
                name = f"{number:06}_{index:06}.png"
                whole, visible = (inout.load_im(str(scene / kind / name)) > 0 for kind in ("mask", "mask_visib"))
                assert not (visible & ~whole).any()
                assert fact["px_count_visib"] == visible.sum()
                assert fact["px_count_all"] == whole.sum() > 0
                assert fact["visib_fract"] == visible.sum() / whole.sum()
                seen = camera["cam_K"] @ pose["cam_t_m2c"]
                x, y = (seen[:2] / seen[2]).ravel()
                assert whole[round(float(y)), round(float(x))]  # both objects are convex
                if pose["obj_id"] == 2 and (visible == whole).all():
                    # The surface of a ball of 100 mm is seen along a ray through its center.
                    center = float(pose["cam_t_m2c"][2, 0])
                    ray = float(np.linalg.norm(pose["cam_t_m2c"]))
                    nearest.append(depth[round(float(y)), round(float(x))] - center * (1 - 100 / ray))
    assert numbers == set(range(6))
    assert nearest
    np.testing.assert_allclose(nearest, 0, atol=2)  # [mm] between the centers of pixels
