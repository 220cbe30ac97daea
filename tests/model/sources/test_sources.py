"""Theorems about what text and other values mean as a model."""

import sys
from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest

import mjrun.model.sources
from mjrun.model.override import Override
from mjrun.model.source import CollectionSource
from mjrun.model.sources import listed_collection, model_collections, parse_source, source_of
from mjrun.model.sources.bundled_scene import BundledScene
from mjrun.model.sources.file import FileSource
from mjrun.model.sources.in_memory import CompiledSource
from mjrun.model.sources.stdin import StdinSource

NEW = """
from dataclasses import dataclass
from typing import ClassVar
import mujoco
from mjrun.model.source import CollectionSource

@dataclass(frozen=True)
class EmptySource(CollectionSource):
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
        ("scene:dominos", BundledScene("dominos")),
        ("scene:", BundledScene("")),
        ("./scene:dominos", FileSource(Path("./scene:dominos"))),
        ("scene", FileSource(Path("scene"))),
        ("other:dominos", FileSource(Path("other:dominos"))),
        ("a/b.xml", FileSource(Path("a/b.xml"))),
        ("./-", FileSource(Path("-"))),
    ],
)
def test_text_is_a_collection_or_standard_input_or_else_a_file(text: str, source: object) -> None:
    assert parse_source(text) == source_of(text) == source


def test_a_file_is_relative_to_the_folder_and_a_name_is_not() -> None:
    assert parse_source("m.xml", folder="study") == FileSource(Path("study/m.xml"))
    assert parse_source("/m.xml", folder="study") == FileSource(Path("/m.xml"))
    assert parse_source("scene:car", folder="study") == BundledScene("car")
    assert parse_source("-", folder="study") == StdinSource()


@pytest.mark.parametrize("text", ["-", "scene:car", "m.xml"])
def test_overrides_are_part_of_a_source(text: str) -> None:
    overrides = [Override("opt.cone", "elliptic")]
    assert parse_source(text, overrides).overrides == tuple(overrides)


def test_a_path_is_a_file_whatever_its_name_and_a_source_is_itself() -> None:
    assert source_of(Path("scene:dominos")) == FileSource(Path("scene:dominos"))
    assert source_of(Path("-")) == FileSource(Path("-"))
    source = BundledScene("car")
    assert source_of(source) is source
    assert isinstance(source_of(mujoco.MjModel.from_xml_string("<mujoco/>")), CompiledSource)


@pytest.mark.parametrize(
    ("text", "collection"), [("scene:", BundledScene), ("scene", None), ("scene:car", None), (":", None), ("x:", None)]
)
def test_a_bare_prefix_means_the_whole_collection(text: str, collection: type[CollectionSource] | None) -> None:
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
    assert isinstance(parse_source("scene:car"), BundledScene)
