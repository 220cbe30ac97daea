"""The table of measurements beside predictions."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjrun.fitting.outputs import comparison_rows, write_comparison
from mjrun.formats.table_reader import read_table
from mjrun.model.table_column import Column
from tests.fitting.logs import NOISE
from tests.fitting.problems import THREE, segments, shooting


def test_each_sample_has_a_row_with_what_both_models_say(tmp_path: Path) -> None:
    shoot, _ = shooting(THREE)
    (log,) = segments()
    parts = {"fitted": log.part(slice(0, 200)), "held": log.part(slice(200, 300))}
    solutions = {}
    for part, segment in parts.items():
        chunks = shoot.cut([segment], 60)
        for which, coordinate in (("nominal", 0.9), ("fitted", 0.5)):
            states = shoot.guessed(chunks, None)
            solutions[part, which] = shoot.look(chunks, np.full(3, coordinate), states, np.array([NOISE]))
    rows = comparison_rows(solutions, ["other", "log"])
    with ExitStack() as stack:
        files = write_comparison(stack, str(tmp_path / "fit.csv"), [Column("qpos/hinge", "rad")], rows).publish()
    table = read_table(files[0]).columns
    np.testing.assert_array_equal(table["time"], log.times)
    np.testing.assert_allclose(table["qpos/hinge"], log.values[:, 0], atol=1e-12)
    assert table["holdout"].tolist() == [0] * 200 + [1] * 100
    assert set(table["log"]) == {1}
    errors = table["qpos/hinge/fitted"] - table["qpos/hinge"]
    expected = solutions["fitted", "fitted"].residuals[0][:, 0] * NOISE
    np.testing.assert_allclose(errors[: len(expected) - 1], expected[:-1], atol=1e-12)
    assert not np.allclose(table["qpos/hinge/nominal"], table["qpos/hinge/fitted"], atol=1e-3)


def test_logs_follow_each_other_although_their_times_overlap() -> None:
    shoot, _ = shooting(THREE)
    one, other = (replace(segments(seconds=1.0, seed=seed)[0], source=name) for seed, name in enumerate("ab"))
    chunks = shoot.cut([one, other], 60)
    looks = [shoot.look(chunks, np.full(3, 0.5), shoot.guessed(chunks, None), np.array([NOISE]))] * 2
    rows = comparison_rows({("fitted", "nominal"): looks[0], ("fitted", "fitted"): looks[1]}, ["a", "b"])
    np.testing.assert_array_equal(rows[:, -1], np.repeat([0, 1], 100))
    np.testing.assert_array_equal(rows[:, 0], np.tile(one.times, 2))
    np.testing.assert_allclose(rows[100:, 1], other.values[:, 0], atol=1e-12)
