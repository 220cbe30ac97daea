"""The table of episodes, read back."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from mjrun.evaluation.table import FILES, PlayedEpisodes, episode_columns
from mjrun.study.design import Design
from mjrun.study.results import write_results
from tests.evaluation.episodes import episodes

ALONE = Design((), [()])


def test_a_row_is_an_episode_with_integers_as_integers(tmp_path: Path) -> None:
    some = episodes(20, np.random.default_rng(1), seed=7)
    columns, rows = episode_columns([PlayedEpisodes("p", 0, some)], ALONE, ["near", "cost"], ["m"], compared=False)
    write_results(tmp_path, columns, rows, {}, FILES)

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
    columns, rows = episode_columns(groups, points, [], [], compared=True)
    table = {column.name: rows[:, i] for i, column in enumerate(columns) if column.name != "policy"}
    assert [column.name for column in columns[:4]] == ["policy", "point", "geom/floor.friction[0]", "model"]
    assert columns[0].labels == ("mine", "other")
    assert table["point"].tolist() == [0, 0, 0, 1, 1, 1] * 2
    assert table["geom/floor.friction[0]"].tolist() == [0.5] * 3 + [1.0] * 3 + [0.5] * 3 + [1.0] * 3
    assert table["episode"].tolist() == [0, 1, 2] * 4


def test_a_term_that_an_episode_lacks_is_no_number() -> None:
    some = episodes(2, np.random.default_rng(1))
    columns, rows = episode_columns([PlayedEpisodes("p", 0, some)], ALONE, ["near", "other"], [], compared=False)
    place = [column.name for column in columns].index("reward/other")
    assert np.isnan(rows[:, place]).all()
    assert rows[:, place - 1] == pytest.approx([each.rewards["near"] for each in some])
