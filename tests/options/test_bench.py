"""Options of `mjrun bench`."""

from mjrun.bench import step_timing
from mjrun.experiment.design import value_list
from mjrun.options.bench import ENGINES, BenchOptions


def test_engines_are_those_that_bench_knows() -> None:
    assert ENGINES == (step_timing.C, step_timing.WARP)


def test_a_grid_of_values_is_text_by_path() -> None:
    options = BenchOptions(scan={"timestep": [0.001, 0.002], "opt.gravity": [[0, 0, -1], [0, 0, -2]]})
    assert options.scan == (("timestep", "0.001,0.002"), ("opt.gravity", "0,0,-1;0,0,-2"))
    assert [len(value_list(path, text, "scan")) for path, text in options.scan] == [2, 2]
