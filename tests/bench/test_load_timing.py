"""The wall time of loading a model."""

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from mjrun.bench.output_timing import timed_load
from mjrun.errors import ModelError
from mjrun.model.sources import source_of
from mjrun.physics.parameter_grid import settings

sys.path.append(str(Path(__file__).parent))

from bench_clocks import MODEL, FakeClock


def test_parsing_and_compiling_are_timed_apart_and_the_model_has_its_overrides(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    source = replace(source_of(path), overrides=settings({"timestep": ".5"}))
    model, load = timed_load(source, FakeClock())
    assert model.opt.timestep == 0.5
    assert load.first == 1.0
    assert load.parse is not None
    assert load.compile is not None
    assert (load.parse.samples, load.compile.samples) == ([1.0] * 3, [1.0] * 3)


def test_a_compiled_file_is_neither_parsed_nor_compiled(tmp_path: Path) -> None:
    path = tmp_path / "model.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(MODEL), str(path))
    model, load = timed_load(source_of(path), FakeClock())
    assert model.nv == 1
    assert (load.first, load.parse, load.compile) == (1.0, None, None)


def test_a_file_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ModelError):
        timed_load(source_of(tmp_path / "none.xml"), FakeClock())
