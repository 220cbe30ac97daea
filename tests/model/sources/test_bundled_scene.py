"""Theorems about the scenes that come with mjrun, as model sources."""

import pickle
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import ModelNotFoundError, UnknownNameError
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.bundled_scene import BundledSceneSource, bundled_task
from mjrun.platform.installation import scene_folder

SCENES = Path(__file__).parents[3] / "scenes"
TASKS = ["car_drive", "humanoid_stand", "pendulum_swing_up"]


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.xml")), ids=lambda path: path.stem)
def test_a_scene_is_the_file_of_its_name(path: Path) -> None:
    source = parse_source(f"scene:{path.stem}")
    assert (source.stem, source.main_file, source.files) == (path.stem, path, (path,))
    model, expected = source.load(), mujoco.MjModel.from_xml_path(str(path))
    assert np.array_equal(model.qpos0, expected.qpos0)
    assert np.array_equal(model.geom_size, expected.geom_size)


def test_each_scene_has_a_line_about_it_the_first_sentence_of_its_file() -> None:
    descriptions = BundledSceneSource.descriptions()
    assert [*descriptions] == sorted({path.stem for path in SCENES.glob("*.xml")} | set(TASKS))
    for name, description in descriptions.items():
        assert description.endswith(".")
        assert "\n" not in description
        if name not in TASKS:
            comment = (SCENES / f"{name}.xml").read_text("utf-8")
            assert " ".join(comment.split()).startswith(f"<!-- {description} ")
    assert descriptions["car_drive"] == "The car drives to (-1, 4) and must be there within five seconds."


def test_a_task_is_the_document_of_its_name_and_no_model() -> None:
    assert {name: bundled_task(f"scene:{name}") for name in TASKS} == {n: SCENES / f"{n}.yaml" for n in TASKS}
    assert [bundled_task(text) for text in ("scene:car", "scene:", "car_drive", "dm:car_drive")] == [None] * 4
    with pytest.raises(ModelNotFoundError, match="is a task, not a model"):
        parse_source("scene:car_drive").load()


def test_overrides_are_applied_and_travel_with_it() -> None:
    source = parse_source("scene:pendulum", [Override("opt.timestep", "0.25")])
    assert pickle.loads(pickle.dumps(source)).load().opt.timestep == 0.25
    with pytest.raises(UnknownNameError):
        parse_source("scene:pendulum", [Override("opt.nothing", "1")]).load()


def test_an_unknown_scene_names_the_nearest_and_all() -> None:
    with pytest.raises(ModelNotFoundError) as caught:
        parse_source("scene:domnos").load()
    first, second = str(caught.value).splitlines()
    assert first == "scene:domnos: no such scene (did you mean 'dominos'?)"
    assert second == f"scenes: {', '.join(BundledSceneSource.descriptions())}"


@pytest.mark.parametrize("name", ["", "../tests/m", "dominos.xml", "DOMINOS", "/etc/passwd", "README"])
def test_only_the_name_of_a_scene_is_one(name: str) -> None:
    with pytest.raises(ModelNotFoundError):
        parse_source(f"scene:{name}").load()


def test_a_checkout_has_its_scenes_beside_the_package() -> None:
    assert scene_folder() == SCENES
