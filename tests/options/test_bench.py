"""Options of `mjrun bench`."""

from fractions import Fraction
from inspect import signature

import pytest

from mjrun.bench import warp_timing
from mjrun.errors import BadValueError, UsageError
from mjrun.options.bench import ENGINES, BenchOptions, EngineOptions, ReportOptions
from mjrun.options.option import options_of
from mjrun.options.view import ViewOptions
from mjrun.physics.parameter_grid import scan_values


def test_engines_are_those_that_bench_knows() -> None:
    assert ENGINES == (warp_timing.C, warp_timing.WARP)
    of_warp = set(signature(warp_timing.WarpOptions).parameters)
    assert {each.name for each in options_of(EngineOptions)} - {"engine"} == of_warp


def test_what_is_drawn_is_chosen_as_for_a_video() -> None:
    of_view = {each.name: each.kind.metavar for each in options_of(ViewOptions)}
    of_bench = {each.name: each.kind.metavar for each in options_of(BenchOptions)}
    assert all(of_bench[name] == of_view[name] for name in ("size", "camera", "view", "quality", "renderer", "gl"))


def test_threads_are_numbers_or_auto_and_one_size_is_one() -> None:
    options = BenchOptions(threads=["1,2", "auto"], size=(64, 48))
    assert (options.threads, options.size) == ((1, 2, "auto"), ((64, 48),))
    with pytest.raises(BadValueError, match=r"^threads: 'many' is not a number of threads from 1 on, or auto"):
        BenchOptions(threads="1,many")


def test_a_grid_of_values_is_text_by_path() -> None:
    options = BenchOptions(scan={"timestep": [0.001, 0.002], "opt.gravity": [[0, 0, -1], [0, 0, -2]]})
    assert options.scan == (("timestep", "0.001,0.002"), ("opt.gravity", "0,0,-1;0,0,-2"))
    assert [len(scan_values(path, text)) for path, text in options.scan] == [2, 2]


def test_a_share_is_a_number_in_python() -> None:
    assert BenchOptions(fail_above=0.1, budget="1/3").fail_above == 0.1
    assert BenchOptions(budget="1/3").budget == Fraction(1, 3)


def test_one_table_goes_to_standard_output() -> None:
    with pytest.raises(UsageError, match=r"^csv and markdown exclude each other"):
        ReportOptions(csv=True, markdown=True)
