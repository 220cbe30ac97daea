"""Datasets: the same images whatever renders them, and none of another model, point or condition."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import mujoco
import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.errors import BadValueError, DrawError, EmptyDatasetError, FailedPointsError, FileError, UsageError
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.study.dataset_specs import camera_argument, part_of
from mjrun.study.image_dataset import Dataset, DatasetResult
from mjrun.study.point_images import PointImageMaker
from tests.cases import cases
from tests.reporters import RecordingReporter
from tests.study.in_process import simulate_here

MODEL = """<mujoco><visual><quality shadowsize="64" offsamples="0"/></visual>
<asset><material name="red" rgba="1 0 0 1"/></asset><worldbody>
  <light pos="0 0 3"/><camera name="flat" projection="orthographic" fovy="1"/>
  <geom name="floor" type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 {height}"><freejoint/><geom type="box" size=".1 .1 .1" material="red"/></body>
  <body name="ball" pos=".4 0 .1"><freejoint/><geom size=".1"/><site name="top" pos="0 0 .1"/></body>
  </worldbody></mujoco>"""
VARY = {"camera.azimuth": "uniform(0,360)", "camera.distance": "uniform(1,2)", "material/red.rgba[1]": "uniform(0,1)"}
ASSETS = ("images", "depth", "masks", "part_masks")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "m.xml"
    path.write_text(MODEL.format(height=0.1))
    return path


def made(model: Path, folder: Path, *, reporter: Reporter | None = None, **options: Any) -> DatasetResult:
    defaults: dict[str, Any] = {"size": (64, 48), "jobs": 1, "quality": "draft"}
    if "vary" not in options:
        defaults |= {"vary": VARY, "samples": 3}
    return Dataset(mjrun.Simulation(model), str(folder), **defaults | options).run(reporter or PythonApiReporter())


def contents(folder: Path) -> Mapping[str, bytes]:
    """Returns the images and labels of a dataset, without what differs from run to run."""
    own = ("study.json", "parts", "results")
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return {str(path): (folder / path).read_bytes() for path in paths if not str(path).startswith(own)}


def records(folder: Path) -> list[dict[str, Any]]:
    documents = [json.loads(path.read_text()) for path in sorted((folder / "records").glob("*.json"))]
    return [image for document in documents for image in document["images"]]


def test_images_and_labels_do_not_depend_on_processes_engine_or_interruptions(
    model: Path, tmp_path: Path, point_processes: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    options: dict[str, Any] = {"format": "coco,yolo,nerfstudio", "keypoints": "top"}
    made(model, tmp_path / "b", **options, jobs=2, chunk=1)
    simulate_here(monkeypatch)
    made(model, tmp_path / "a", **options)
    first = made(model, tmp_path / "c", **options, samples=2)
    assert (first.rendered, first.points) == (2, 2)
    again = made(model, tmp_path / "c", **options)
    assert (again.rendered, again.points) == (1, 3)
    made(model, tmp_path / "d", **options, engine="tests.study.factories:Elsewhere")
    expected = contents(tmp_path / "a")
    assert {Path(path).parts[0] for path in expected} >= {*ASSETS, "labels", "annotations", "transforms.json"}
    for name in "bcd":
        assert contents(tmp_path / name) == expected


def test_datasets_and_studies_do_not_replace_other_tables(model: Path, tmp_path: Path, point_processes: None) -> None:
    (tmp_path / "repeats.csv").write_text("mine")
    with pytest.raises(FileError, match=r"contains repeats\.csv, but no run of `mjrun sweep`"):
        mjrun.sweep(model, vary={"seed": "1"}, steps=2, output=str(tmp_path))
    with pytest.raises(FileError, match=r"contains repeats\.csv, but no run of `mjrun dataset`"):
        made(model, tmp_path)
    (tmp_path / "repeats.csv").rename(tmp_path / "evaluation.json")
    with pytest.raises(FileError, match=r"contains evaluation\.json, but no run of `mjrun sweep`"):
        mjrun.sweep(model, vary={"seed": "1"}, steps=2, output=str(tmp_path))
    with pytest.raises(FileError, match=r"evaluation\.json: is not a folder\noutput names the folder of the results"):
        mjrun.sweep(model, vary={"seed": "1"}, steps=2, output=str(tmp_path / "evaluation.json"))
    (tmp_path / "study").mkdir()
    (tmp_path / "study/slurm-17.out").write_text("a log")
    mjrun.sweep(model, vary={"seed": "1"}, steps=2, output=str(tmp_path / "study"))
    table = (tmp_path / "study/results.csv").read_bytes()
    with pytest.raises(FileError, match="study: contains the results of `mjrun sweep`"):
        made(model, tmp_path / "study")
    assert (tmp_path / "study/results.csv").read_bytes() == table
    made(model, tmp_path / "set", samples=1)
    with pytest.raises(FileError, match="set: contains the results of `mjrun dataset`"):
        mjrun.sweep(model, vary={"seed": "1"}, steps=2, output=str(tmp_path / "set"))


def test_a_dataset_in_bop_has_the_models_of_its_objects(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made(model, folder, samples=1, format="bop")
    info = json.loads((folder / "models/models_info.json").read_text())
    sizes = {number: [each[f"size_{axis}"] for axis in "xyz"] for number, each in info.items()}
    assert sizes == {"1": pytest.approx([200] * 3), "2": pytest.approx([200, 200, 205])}  # a site of 5 mm
    assert info["1"]["diameter"] == pytest.approx(200 * 3**0.5)
    assert (folder / "models/obj_000001.ply").read_bytes().startswith(b"ply\n")
    made(model, folder, samples=1, format="yolo")
    assert not [*folder.glob("models/*")]


def test_a_point_is_the_image_of_the_same_model_and_camera(model: Path, tmp_path: Path) -> None:
    made(model, tmp_path / "set", samples=2)
    for document in (tmp_path / "set/records").glob("*.json"):
        point = json.loads(document.read_text())
        values, (image,) = point["values"], point["images"]
        compiled = mjrun.load(model)
        compiled.mat_rgba[0, 1] = float(values["material/red.rgba[1]"])
        camera = f"free:azimuth={values['camera.azimuth']},distance={values['camera.distance']}"
        data = mujoco.MjData(compiled)
        expected = mjrun.render(compiled, data, camera, (64, 48), visual=mjrun.Visual(quality="draft"))
        found = np.array(Image.open(tmp_path / "set" / image["files"]["rgb"]))
        np.testing.assert_array_equal(found, expected)
        ids = np.array(Image.open(tmp_path / "set" / image["files"]["masks"]))
        assert [each["pixels"] for each in image["objects"]] == [(ids == 1).sum(), (ids == 2).sum()]


def test_lost_and_changed_files_are_rendered_again_and_nothing_else(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made(model, folder)
    before = contents(folder)
    (folder / "masks/000001.png").unlink()
    (folder / "records/000002.json").unlink()
    assert made(model, folder).rendered == 2
    assert contents(folder) == before
    assert made(model, folder).rendered == 0

    whole = (folder / "images/000000.png").read_bytes()
    (folder / "images/000000.png").write_bytes(whole[:-9])
    (folder / "images/000001.png").write_bytes((folder / "images/000002.png").read_bytes())
    (folder / "images/000002.png").touch()
    changed = bytes([*(folder / "depth/000002.png").read_bytes()[:-1], 0])
    assert made(model, folder).rendered == 2
    (folder / "depth/000002.png").write_bytes(changed)
    assert made(model, folder).rendered == 1
    assert contents(folder) == before


def test_a_known_point_whose_lost_files_cannot_be_rendered_again_has_failed(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "set"
    made(model, folder)
    (folder / "images/000001.png").unlink()

    def failing(*_: object) -> NoReturn:
        raise DrawError("no memory")

    with monkeypatch.context() as patch:
        patch.setattr(PointImageMaker, "make", failing)
        with pytest.raises(FailedPointsError) as caught:
            made(model, folder)
    (result,) = caught.value.results
    assert (result.statuses, result.failures[0].message) == ({"ok": 2, "failed": 1}, "no memory")
    assert sum(result.images.values()) == 2
    assert len(records(folder)) == 2
    assert made(model, folder).rendered == 1


def test_no_image_of_an_edited_model_stays_even_if_the_edit_is_undone(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made(model, folder)
    before = contents(folder)
    model.write_text(MODEL.format(height=0.3))
    assert made(model, folder).rendered == 3
    edited = contents(folder)
    assert all(edited[path] != before[path] for path in before if path.startswith("images"))
    model.write_text(MODEL.format(height=0.1))
    assert made(model, folder).rendered == 3
    assert contents(folder) == before


def test_rejected_images_and_points_that_are_gone_leave_no_files(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made(model, folder, samples=5, format="yolo")
    pixels = [each["objects"][1]["pixels"] for each in records(folder)]
    limit = sorted(pixels)[2]
    expected = [index for index, count in enumerate(pixels) if count > limit]
    assert len(expected) == 2
    result = made(model, folder, samples=5, format="yolo", accept=f"pixels/ball > {limit}")
    assert result.rejected == 3
    assert sum(result.images.values()) == len(expected)
    for name in (*ASSETS, "labels"):
        assert sorted(int(path.stem) for path in (folder / name).iterdir()) == expected
    made(model, folder, samples=2, format="yolo")
    for name in (*ASSETS, "labels", "records"):
        assert sorted(int(path.stem) for path in (folder / name).iterdir()) == [0, 1]
    with pytest.raises(EmptyDatasetError, match=r"accept omits all 2 images; .* has their labels") as error:
        made(model, folder, samples=2, accept="objects > 2")
    assert [(result.rejected, result.images) for result in error.value.results] == [(2, {"train": 0, "val": 0})]


def test_a_folder_that_had_other_images_or_formats_has_the_files_of_the_last_run_alone(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, narrow = tmp_path / "set", {"camera.azimuth": "uniform(0,20)"}
    runs: list[dict[str, Any]] = [
        {"format": "coco,yolo"},
        {"format": "nerfstudio"},
        {"format": "yolo", "split": "one=0.5,two=0.5"},
        {"format": "coco", "vary": narrow, "samples": 2},
        {"format": "bop"},
        {"format": "folder"},
    ]
    for number, options in enumerate(runs):
        made(model, folder, **options)
        made(model, tmp_path / str(number), **options)
        assert contents(folder) == contents(tmp_path / str(number)), options
    made(model, folder, **runs[0])

    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Dataset, "_conclude", interrupted)
        with pytest.raises(KeyboardInterrupt):
            made(model, folder, **{**runs[0], "vary": narrow})
    assert not {*contents(folder)} & {"annotations/instances_train.json", "train.txt", "data.yaml", "labels/000000.txt"}
    reporter = RecordingReporter()
    made(model, folder, reporter=reporter, **{**runs[1], "size": (32, 24)})
    assert contents(folder).keys() == contents(tmp_path / "1").keys()
    model.write_text(MODEL.format(height=0.3))
    made(model, folder, reporter=reporter)
    assert [text for text in reporter.texts if "changed" in text] == ["changed since the last run: model, files"]


def test_a_run_that_replaces_no_image_leaves_the_dataset_unchanged(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(model, tmp_path / "set", format="coco")
    before = contents(tmp_path / "set")

    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(PointImageMaker, "make", interrupted)
    with pytest.raises(KeyboardInterrupt):
        made(model, tmp_path / "set", format="coco", vary={"camera.azimuth": "uniform(0,20)"}, samples=3)
    assert contents(tmp_path / "set") == before


def test_times_and_cameras_make_several_images_of_a_point(model: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(model, qvel={"ball": (0, 0, 2, 0, 0, 0)})
    Dataset(simulation, str(tmp_path / "set"), times="0,0.1", camera=("free", "orbit"), size=(32, 24), jobs=1).run()
    images = records(tmp_path / "set")
    assert [(each["id"], each["camera"], each["time"]) for each in images] == [
        (0, "free", 0),
        (1, "orbit", 0),
        (2, "free", 0.1),
        (3, "orbit", 0.1),
    ]
    trace = mjrun.trace(model, probe=["xpos/ball/z"], qvel={"ball": (0, 0, 2, 0, 0, 0)}, duration=0.1)
    heights = [
        (np.array(each["world_from_camera"]) @ each["objects"][1]["camera_from_object"])[2, 3] for each in images
    ]
    np.testing.assert_allclose(heights[::2], trace["xpos/ball/z"][[0, -1]], atol=1e-9)


def test_a_point_that_fails_has_no_images_and_the_others_have(model: Path, tmp_path: Path) -> None:
    with pytest.raises(FailedPointsError) as caught:
        made(model, tmp_path / "set", vary={"camera.lookat": "box,ball,bxo"})
    (result,) = caught.value.results
    assert result.statuses == {"ok": 2, "failed": 1}
    assert "no object 'bxo'" in result.failures[0].message
    assert sum(result.images.values()) == 2


def test_no_image_of_an_earlier_run_stays_in_place_of_a_point_that_fails(model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made(model, folder, vary={"camera.lookat": "box,ball"}, format="coco,yolo")
    for each in (folder, tmp_path / "new"):
        with pytest.raises(FailedPointsError):
            made(model, each, vary={"camera.lookat": "box,bxo"}, format="coco,yolo")
    assert contents(folder) == contents(tmp_path / "new")


@cases("options, message")
def test_wrong_options_are_refused_with_what_is_right(
    model: Path, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError) as caught:
        made(model, tmp_path / "set", **options)
    assert message in str(caught.value)
    assert not (tmp_path / "set").exists()


def test_times_after_the_end_are_refused(model: Path, tmp_path: Path) -> None:
    simulation = mjrun.Simulation(model, duration=1)
    with pytest.raises(UsageError, match="2 s is after the end of the simulation at 1 s"):
        Dataset(simulation, str(tmp_path / "set"), times="0,2").run()


@pytest.mark.parametrize("split", [3, None, {"train": 0.8}, (("train", 0.5),), [("a", "x")], ["a=0.5", "b=0.5"]])
def test_parts_without_shares_are_refused_in_python(split: Any) -> None:
    with pytest.raises(BadValueError, match=r"split: .* is not a list of names with shares that sum to 1"):
        mjrun.Dataset(mjrun.Simulation("m.xml"), "set", split=split)


def test_parts_have_their_shares_at_any_size() -> None:
    split = mjrun.Dataset(mjrun.Simulation("m.xml"), "set", split="train=0.7,val=0.2,test=0.1").split
    for count in (10, 100, 1000):
        parts = [part_of(index, split) for index in range(count)]
        for name, share in split:
            assert abs(parts.count(name) - float(share) * count) <= 2


@cases("text, values, expected")
def test_settings_of_cameras_vary(text: str, values: dict[str, str], expected: str) -> None:
    assert camera_argument(text, values) == expected


def test_points_of_a_model_with_other_objects_fail(model: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(MODEL.format(height=0.1).replace('name="ball"', 'name="globe"'))
    with pytest.raises(FailedPointsError) as caught:
        made(model, tmp_path / "set", vary={"model": f"{model},{other}"})
    (result,) = caught.value.results
    assert "the model has other objects, box, globe, than the first, box, ball" in result.failures[0].message
