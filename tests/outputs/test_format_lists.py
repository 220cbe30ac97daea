"""Help texts list the formats that there are."""

import json
import subprocess
import sys
from dataclasses import replace

import pytest

from mjrun.formats import codecs, tables
from mjrun.formats.image_format import FORMATS, suffixes
from mjrun.options.output import CODECS, DEPTH_IMAGES, RGB_IMAGES, SEGMENTATION_IMAGES, TABLES, VIDEOS
from mjrun.options.policy import POLICIES
from mjrun.outputs.format_lists import LISTS, with_formats
from mjrun.policy.loaders import loaders


def test_a_new_table_format_is_listed_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    dummy = replace(tables.FORMATS["csv"], name="dummy", suffixes=(".dmy",))
    assert "dmy" not in with_formats(TABLES)
    monkeypatch.setitem(tables.FORMATS, "dummy", dummy)
    assert with_formats(TABLES).split(", ")[-1] == "dmy"


def test_a_new_container_and_a_new_image_format_are_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(codecs.CONTAINERS, "dmy", codecs.CONTAINERS["mp4"])
    monkeypatch.setitem(FORMATS["depth"], "dummy", replace(FORMATS["depth"]["npy"], suffixes=(".dmy",)))
    assert with_formats(VIDEOS).endswith(", dmy")
    assert with_formats(DEPTH_IMAGES).endswith(", dmy")
    assert "dmy" not in with_formats(RGB_IMAGES)


def test_what_is_listed_can_be_written() -> None:
    assert {f".{name}" for name in with_formats(TABLES).split(", ")} <= set(tables.suffixes())
    assert {f".{name}" for name in with_formats(VIDEOS).split(", ")} <= set(codecs.suffixes())
    assert set(with_formats(CODECS).split(", ")) <= set(codecs.CODECS)
    for placeholder, view in ((RGB_IMAGES, "rgb"), (DEPTH_IMAGES, "depth"), (SEGMENTATION_IMAGES, "seg")):
        assert {f".{name}" for name in with_formats(placeholder).split(", ")} <= set(suffixes(view))


def test_every_table_format_is_listed_once() -> None:
    assert len(with_formats(TABLES).split(", ")) == len(tables.FORMATS)


def test_every_loader_of_policies_is_listed_by_a_name_with_a_suffix_that_it_reads() -> None:
    names = with_formats(POLICIES).split(", ")
    assert len(names) == len(loaders())
    for name, loader in zip(names, loaders(), strict=True):
        assert any(suffix in name for suffix in loader.suffixes)


def test_other_text_and_other_braces_stay() -> None:
    assert with_formats("'{time:.2f} s'") == "'{time:.2f} s'"
    assert with_formats(f"a {TABLES} b {VIDEOS}").startswith("a csv, ")


def test_listing_formats_loads_no_library() -> None:
    code = "import sys, json\nfrom mjrun.outputs.format_lists import LISTS, with_formats\n"
    code += "[with_formats(each) for each in LISTS]\nprint(json.dumps([*sys.modules]))"
    loaded = json.loads(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
    assert set(loaded).isdisjoint({"numpy", "PIL", "pyarrow", "scipy", "orjson", "mujoco", "imageio_ffmpeg"})
    assert LISTS
