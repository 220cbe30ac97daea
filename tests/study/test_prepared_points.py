"""Points of any picklable specification: resumed by their keys, and isolated."""

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from mjrun.experiment.design import Design
from mjrun.model.source import ModelSource
from mjrun.options.sweep import ExecutionOptions
from mjrun.python_code import PickledWithCode
from mjrun.reporter import PythonApiReporter
from mjrun.simulation.input_snapshot import InputSnapshot
from mjrun.study.prepared_points import PreparedPoints
from mjrun.study.spec import PointResult, ShippedStudy, StudyPoint


class Squares:
    """A specification whose points are squares; 3 ends its process."""

    packages = ()

    def stored_at(self, root: Path) -> "Squares":
        assert root.is_dir()
        return self

    def simulator(self) -> "Squares":
        return self

    def models(self, points: Iterable[Sequence[str]]) -> list[ModelSource]:
        return []

    def run(self, points: Sequence[StudyPoint]) -> Iterator[Sequence[PointResult]]:
        for point in points:
            if point.values == ("3",):
                os._exit(9)
            yield [PointResult(point.index, "ok", (float(point.values[0]) ** 2,), 1)]


class PreparedSquares(PreparedPoints):
    def __init__(self, folder: Path, numbers: Sequence[int]) -> None:
        spec, snapshot = Squares(), InputSnapshot.empty()
        shipped = ShippedStudy(PickledWithCode.of(spec, [Squares]), 1, snapshot)
        super().__init__(spec, Design(("x",), [(str(x),) for x in numbers]), shipped, folder, ["square"])

    def keys_of(self, indices: Sequence[int] | np.ndarray) -> list[str]:
        return [f"{int(values[0]):032x}" for values in self.points.at(indices)]


@pytest.mark.slow
def test_points_are_computed_once_and_cost_no_other(tmp_path: Path, point_processes: None) -> None:
    first = PreparedSquares(tmp_path, [1, 2, 3, 4])
    first.files.create()
    assert [*first.missing()] == [0, 1, 2, 3]
    statuses = first.simulate(first.missing(), ExecutionOptions(jobs=1), PythonApiReporter())
    assert statuses == {"ok": 3, "crashed": 1}
    more = PreparedSquares(tmp_path, [5, 4, 3, 2])
    assert [*more.missing()] == [0]
    assert [*more.missing(retry_failed=True)] == [0, 2]
    assert [result.status for result in more.known] == ["missing", "ok", "crashed", "ok"]
    assert [result.metrics for result in more.known][1::2] == [(16.0,), (4.0,)]
    assert more.noun == "point"
