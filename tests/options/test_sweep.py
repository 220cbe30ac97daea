"""Options of `mjrun sweep`."""

import pytest

from mjrun.errors import MjrunError
from mjrun.options.sweep import EXTRAS, ExecutionOptions, StudyOptions, VariationOptions
from mjrun.study.executors import ENGINES


def test_values_are_text_by_path_whatever_python_gives() -> None:
    options = VariationOptions(vary={"opt.timestep": [0.001, 0.002], "seed": "1..3:3", "a.b": "uniform(0, 1)"})
    assert options.vary == (("opt.timestep", "0.001,0.002"), ("seed", "1..3:3"), ("a.b", "uniform(0, 1)"))


def test_metrics_are_names_and_expressions() -> None:
    options = StudyOptions(None, "study", metric={"drift": "max(abs(energy/drift))", "up": "share(x >= 1)"})
    assert options.metric == (("drift", "max(abs(energy/drift))"), ("up", "share(x >= 1)"))


@pytest.mark.parametrize("options", [{"samples": 0}, {"design": "star"}, {"sampler": "dice"}, {"repeats": 0}])
def test_values_that_cannot_be_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(MjrunError, match=next(iter(options))):
        VariationOptions(**options)  # type: ignore[arg-type]


def test_every_engine_that_needs_a_library_has_an_extra() -> None:
    assert ExecutionOptions().engine in ENGINES
    assert set(EXTRAS) - {"sweep"} <= {engine.partition(":")[0] for engine in ENGINES}
