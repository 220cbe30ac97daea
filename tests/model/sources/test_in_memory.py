"""Theorems about a compiled model as a source."""

import dataclasses

import mujoco
import pytest

from mjrun.errors import CompiledOverrideError
from mjrun.model.override import Override
from mjrun.model.sources import source_of

MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")


def test_it_loads_as_itself_and_has_no_file() -> None:
    source = source_of(MODEL)
    assert source.load() is MODEL
    assert (source.text, source.stem, source.main_file, source.files) == ("", "model", None, ())


def test_overrides_come_too_late() -> None:
    source = dataclasses.replace(source_of(MODEL), overrides=(Override("opt.cone", "elliptic"),))
    with pytest.raises(CompiledOverrideError, match=r"^the model is compiled: set opt\.cone=elliptic "):
        source.load()
