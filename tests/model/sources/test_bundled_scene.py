"""Theorems about the scenes that come with mjrun, as model sources."""

import pickle
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import ModelNotFoundError, UnknownNameError
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.bundled_scene import BundledScene, scene_folder

SCENES = Path(__file__).parents[3] / "scenes"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.xml")), ids=lambda path: path.stem)
def test_a_scene_is_the_file_of_its_name(path: Path) -> None:
    source = parse_source(f"scene:{path.stem}")
    assert (source.stem, source.main_file, source.files) == (path.stem, path, (path,))
    model, expected = source.load(), mujoco.MjModel.from_xml_path(str(path))
    assert np.array_equal(model.qpos0, expected.qpos0)
    assert np.array_equal(model.geom_size, expected.geom_size)


def test_each_scene_has_a_line_about_it_the_first_sentence_of_its_file() -> None:
    descriptions = BundledScene.descriptions()
    assert set(descriptions) == {path.stem for path in SCENES.glob("*.xml")}
    for name, description in descriptions.items():
        comment = (SCENES / f"{name}.xml").read_text("utf-8")
        assert description.endswith(".")
        assert "\n" not in description
        assert " ".join(comment.split()).startswith(f"<!-- {description} ")


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
    assert second == f"scenes: {', '.join(BundledScene.descriptions())}"


@pytest.mark.parametrize("name", ["", "../tests/m", "dominos.xml", "DOMINOS", "/etc/passwd", "README"])
def test_only_the_name_of_a_scene_is_one(name: str) -> None:
    with pytest.raises(ModelNotFoundError):
        parse_source(f"scene:{name}").load()


def test_a_checkout_has_its_scenes_beside_the_package() -> None:
    assert scene_folder() == SCENES
