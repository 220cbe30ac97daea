"""Theorems about what text and other values mean as a model."""

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest

import mjrun.model.sources
from mjrun.errors import CompiledOverrideError, UnknownNameError
from mjrun.model.override import Override
from mjrun.model.source import CollectionModelSource
from mjrun.model.sources import CompiledSource, listed_collection, load, model_collections, parse_source, source_of
from mjrun.model.sources.bundled_scene import BundledSceneSource
from mjrun.model.sources.file import FileSource
from mjrun.model.sources.stdin import StdinSource
from tests.model.model_files import MODEL, write

NEW = """
from mjrun.dataclass import dataclass
from typing import ClassVar
import mujoco
from mjrun.model.source import CollectionModelSource

@dataclass(frozen=True)
class EmptySource(CollectionModelSource):
    PREFIX: ClassVar[str] = "empty"

    @classmethod
    def descriptions(cls):
        return {"world": "Nothing."}

    def compile(self):
        self.check_name()
        return None, mujoco.MjModel.from_xml_string("<mujoco/>")
"""


@pytest.mark.parametrize(
    ("text", "source"),
    [
        ("-", StdinSource()),
        ("scene:dominos", BundledSceneSource("dominos")),
        ("scene:", BundledSceneSource("")),
        ("./scene:dominos", FileSource(Path("./scene:dominos"))),
        ("scene", FileSource(Path("scene"))),
        ("other:dominos", FileSource(Path("other:dominos"))),
        ("a/b.xml", FileSource(Path("a/b.xml"))),
        ("./-", FileSource(Path("-"))),
    ],
)
def test_text_is_a_collection_or_standard_input_or_else_a_file(text: str, source: object) -> None:
    assert parse_source(text) == source_of(text) == source


@pytest.mark.parametrize("text", ["-", "scene:car", "m.xml"])
def test_overrides_are_part_of_a_source(text: str) -> None:
    overrides = [Override("opt.cone", "elliptic")]
    assert parse_source(text, overrides).overrides == tuple(overrides)


def test_a_path_is_a_file_whatever_its_name_and_a_source_is_itself() -> None:
    assert source_of(Path("scene:dominos")) == FileSource(Path("scene:dominos"))
    assert source_of(Path("-")) == FileSource(Path("-"))
    source = BundledSceneSource("car")
    assert source_of(source) is source
    assert isinstance(source_of(mujoco.MjModel.from_xml_string("<mujoco/>")), CompiledSource)


@pytest.mark.parametrize(
    ("text", "collection"),
    [("scene:", BundledSceneSource), ("scene", None), ("scene:car", None), (":", None), ("x:", None)],
)
def test_a_bare_prefix_means_the_whole_collection(text: str, collection: type[CollectionModelSource] | None) -> None:
    assert listed_collection(text) is collection


@pytest.fixture
def module_beside_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "empty.py").write_text(NEW)
    monkeypatch.setattr(mjrun.model.sources, "__path__", [*mjrun.model.sources.__path__, str(tmp_path)])
    model_collections.cache_clear()
    yield
    sys.modules.pop("mjrun.model.sources.empty")
    model_collections.cache_clear()


@pytest.mark.usefixtures("module_beside_the_others")
def test_a_module_is_all_that_a_new_kind_of_source_takes() -> None:
    assert parse_source("empty:world").load().nbody == 1
    assert isinstance(parse_source("scene:car"), BundledSceneSource)


COMPILED = mujoco.MjModel.from_xml_string("<mujoco/>")


def test_it_loads_as_itself_and_has_no_file() -> None:
    source = source_of(COMPILED)
    assert source.load() is COMPILED
    assert (source.text, source.stem, source.main_file, source.files) == ("", "model", None, ())


def test_overrides_come_too_late() -> None:
    source = dataclasses.replace(source_of(COMPILED), overrides=(Override("opt.cone", "elliptic"),))
    with pytest.raises(CompiledOverrideError, match=r"^the model is compiled: set opt\.cone=elliptic "):
        source.load()


@pytest.mark.parametrize("name", ["euler", "rk4", "implicit", "implicitfast", "discrete"])
def test_an_integrator_is_mujocos_of_that_name(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    expected = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
    assert load(path, integrator=name).opt.integrator == expected


def test_an_unknown_integrator_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'rk4'") as caught:
        load(write(tmp_path / "a.xml", MODEL), integrator="rk45")
    assert caught.value.valid == ("euler", "rk4", "implicit", "implicitfast", "discrete")


def test_the_arguments_for_timestep_and_integrator_win_over_overrides(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", MODEL)
    overrides = [Override("opt.timestep", "0.1"), Override("opt.integrator", "euler")]
    option = load(path, timestep=0.2, integrator="rk4", overrides=overrides).opt
    assert (option.timestep, option.integrator) == (0.2, mujoco.mjtIntegrator.mjINT_RK4)


@pytest.mark.parametrize("timestep", [0.1, 1 / 3, 1e-7, 0.0020000000000000005])
def test_the_timestep_in_the_model_is_the_asked_one_to_the_last_bit(tmp_path: Path, timestep: float) -> None:
    assert load(write(tmp_path / "a.xml", MODEL), timestep=timestep).opt.timestep == timestep


def test_a_scene_and_a_compiled_model_load_too() -> None:
    assert load("scene:pendulum").joint("hinge").id == 0
    model = mujoco.MjModel.from_xml_string(MODEL)
    assert load(model) is model
