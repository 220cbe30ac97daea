"""Files of one point, made in this process."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

import mjrun
from mjrun.options.datasets import LabelledImageOptions
from mjrun.study.dataset_specs import ImageSpec, record_path
from mjrun.study.point_images import PointImageMaker

MODEL = '<mujoco><worldbody><body name="ball"><joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>'


def test_files_of_bop_are_masks_of_each_object_and_the_record_comes_last(tmp_path: Path) -> None:
    model = tmp_path / "m.xml"
    model.write_text(MODEL)
    options = LabelledImageOptions(size=(32, 24), camera="free:distance=.5")
    split = mjrun.Dataset(mjrun.Simulation("m.xml"), "set", split="test=1").split
    images = PointImageMaker(ImageSpec(options, split, ("ball",), "bop"))
    simulation = mjrun.Simulation(model)
    _, files = images.make(7, {"seed": "1"}, simulation)
    folder = "test/000000"
    names = ("rgb/000007", "depth/000007", "mask/000007_000000", "mask_visib/000007_000000")
    assert [path for path, _ in files] == [*(f"{folder}/{name}.png" for name in names), record_path(7)]
    for path, content in files[:-1]:
        (tmp_path / Path(path).name).write_bytes(content)
    mask = np.array(Image.open(tmp_path / "000007_000000.png"))
    record = json.loads(files[-1][1])
    assert set(np.unique(mask)) == {0, 255}
    assert (mask > 0).sum() == record["images"][0]["objects"][0]["pixels"]
    assert record["values"] == {"seed": "1"}


def test_the_steps_of_a_point_are_those_up_to_its_last_image(tmp_path: Path) -> None:
    model = tmp_path / "m.xml"
    model.write_text(MODEL)
    split = mjrun.Dataset(mjrun.Simulation("m.xml"), "set").split
    for times, simulated in (((0.0,), 0), ((0.0, 0.1, 0.02), 50)):  # of 2 ms
        options = LabelledImageOptions(size=(32, 24), camera="free:distance=.5", times=times)
        steps, _ = PointImageMaker(ImageSpec(options, split, ("ball",))).make(0, {}, mjrun.Simulation(model))
        assert steps == simulated
