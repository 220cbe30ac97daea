"""The table of episodes, read back."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from mjrun.evaluation.episode import PlayedEpisodes
from mjrun.evaluation.result import PointSummary
from mjrun.evaluation.statistics import mean_interval, wilson_interval
from mjrun.evaluation.summaries import compared, summary_of
from mjrun.evaluation.table import FILES, episode_table, point_table
from mjrun.experiment.design import Design
from tests.evaluation.episodes import episodes, played

ALONE = Design((), [()])


def test_a_row_is_an_episode_with_integers_as_integers(tmp_path: Path) -> None:
    some = episodes(20, np.random.default_rng(1), seed=7)
    table = episode_table([PlayedEpisodes("p", 0, some)], ALONE, ["near", "cost"], ["m"], compared=False)
    table.write(tmp_path, {}, FILES)

    csv, parquet = (
        pd.read_csv(tmp_path / FILES[1], converters=dict.fromkeys(["return", "reward/cost", "m"], float)),
        pq.read_table(tmp_path / FILES[0]),
    )
    names = ["episode", "seed", "return", "length", "steps", "ending", "outcome", "reward/near", "reward/cost", "m"]
    assert [*csv.columns] == parquet.column_names == names
    for name in ("episode", "seed", "steps"):
        assert str(csv[name].dtype) == str(parquet.schema.field(name).type) == "int64"
    assert csv["seed"].tolist() == list(range(7, 27))
    assert csv["return"].tolist() == [each.total for each in some]
    assert csv["reward/cost"].tolist() == [each.rewards["cost"] for each in some]
    assert csv["ending"].tolist() == parquet["ending"].to_pylist() == [each.ending for each in some]
    assert csv["outcome"].tolist() == [each.outcome for each in some]
    assert csv["m"].tolist() == [each.metrics[0] for each in some]


def test_policies_and_points_tell_rows_apart() -> None:
    generator = np.random.default_rng(1)
    points = Design(("geom/floor.friction[0]", "model"), [("0.5", "a.xml"), ("1", "b.xml")])
    groups = [PlayedEpisodes(name, point, episodes(3, generator)) for name in ("mine", "other") for point in range(2)]
    made = episode_table(groups, points, [], [], compared=True)
    table = made.numbers
    assert [column.name for column in made.columns[:4]] == ["policy", "point", "geom/floor.friction[0]", "model"]
    assert made.columns[0].labels == ("mine", "other")
    assert table["point"].tolist() == [0, 0, 0, 1, 1, 1] * 2
    assert table["geom/floor.friction[0]"].tolist() == [0.5] * 3 + [1.0] * 3 + [0.5] * 3 + [1.0] * 3
    assert table["episode"].tolist() == [0, 1, 2] * 4


def test_a_term_that_an_episode_lacks_is_no_number() -> None:
    some = episodes(2, np.random.default_rng(1))
    table = episode_table([PlayedEpisodes("p", 0, some)], ALONE, ["near", "other"], [], compared=False).numbers
    assert np.isnan(table["reward/other"]).all()
    assert table["reward/near"] == pytest.approx([each.rewards["near"] for each in some])


def test_points_make_the_table_of_a_study_with_intervals_last() -> None:
    ours = [played(1, -2, 3), played(5, 6, 7, point=1)]
    theirs = [played(1, -1, 1, policy="q"), played(5, 5, 5, point=1, policy="q")]
    points = [
        PointSummary(
            point,
            {},
            [summary_of(each.policy, each.episodes, [], [], 0.95, can_succeed=True) for each in pair],
            compared([pair[0]], [pair[1]], 0.95, can_succeed=True),
        )
        for point, pair in enumerate(zip(ours, theirs, strict=True))
    ]
    made, metrics = point_table(Design(("mass",), [("1",), ("2",)]), points)
    table, names = made.numbers, [column.name for column in made.columns]
    assert names[: names.index("status")] == ["point", "mass", *metrics]
    assert [*metrics] == ["success", "return", "length", "return_difference", "success_difference"]
    assert table["success"] == pytest.approx([2 / 3, 1])
    assert table["return_difference"] == pytest.approx([1 / 3, 1])
    expected = mean_interval(np.array([5.0, 6, 7]))
    assert (table["return_low"][1], table["return_high"][1]) == (expected.low, expected.high)
    assert table["success_low"][0] == wilson_interval(2, 3).low
