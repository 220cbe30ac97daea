"""Ranges are a section of a study document."""

from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml

from mjrun.errors import UsageError
from mjrun.fit.free_parameter import FreeParameter
from mjrun.fit.ranges import write_ranges
from mjrun.fit.result import FittedParameter
from mjrun.physics.distribution import parse_distribution

FREE = [
    FreeParameter("joint/hinge.damping", 0.001, 1.0, 0.3),
    FreeParameter("delay:ctrl/motor", 0, 0.1, 0, delayed=("ctrl/motor",)),
]
FITTED = [FittedParameter(each.path, each.start, 0.05, 0.0304, 0.0696, 100.0, "") for each in FREE]


def test_the_interval_is_that_of_the_distribution(tmp_path: Path) -> None:
    with ExitStack() as stack:
        files = write_ranges(stack, str(tmp_path / "ranges.yaml"), FREE, FITTED, 0.95).publish()
    document = yaml.safe_load(Path(files[0]).read_text("utf-8"))
    assert list(document["vary"]) == ["joint/hinge.damping"]  # no study varies a delay of a signal
    mean, spread, low, high = document["vary"]["joint/hinge.damping"]["truncnormal"]
    assert (mean, low, high) == (0.05, 0.001, 1.0)
    assert spread == pytest.approx(0.01, rel=1e-3)
    assert parse_distribution(f"truncnormal({mean}, {spread}, {low}, {high})", "vary")


def test_they_are_yaml(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"\.yaml"):
        write_ranges(ExitStack(), str(tmp_path / "ranges.json"), FREE, FITTED, 0.95)
