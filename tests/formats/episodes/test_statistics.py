"""Statistics that arrive piece by piece, compared with those of NumPy."""

import numpy as np
import pytest

from mjrun.formats.episodes import lerobot
from mjrun.formats.episodes.lerobot import QUANTILES, RunningStatistics, color_statistics


def test_statistics_of_pieces_are_those_of_all_rows() -> None:
    rows = np.random.default_rng(0).normal(1e6, 1, (1000, 3))
    made = RunningStatistics()
    for piece in np.split(rows, [0, 1, 7, 600]):
        made.add(piece)
    result = made.result()
    assert result.count == 1000
    np.testing.assert_array_equal([result.min, result.max], [rows.min(axis=0), rows.max(axis=0)])
    np.testing.assert_allclose(result.mean, rows.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(result.std, rows.std(axis=0), rtol=1e-9)
    for name, share in QUANTILES.items():
        np.testing.assert_array_equal(result.quantiles[name], np.quantile(rows, share, axis=0))


def test_quantiles_of_many_rows_are_those_of_rows_at_equal_distances(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lerobot, "SAMPLED", 100)
    rows = np.random.default_rng(1).normal(size=(777, 2))
    made = RunningStatistics()
    for piece in np.array_split(rows, 13):
        made.add(piece)
    assert made.result().quantiles["q50"].tolist() == np.median(rows[::8], axis=0).tolist()


def test_statistics_of_colours_are_those_of_the_pixels() -> None:
    images = np.random.default_rng(2).integers(5, 200, (4, 6, 8, 3)).astype(np.uint8)
    channels = images.reshape(-1, 3)
    counts = np.array([np.bincount(channel, minlength=256) for channel in channels.T])
    result, values = color_statistics(counts, 4), channels / 255
    assert result.count == 4
    np.testing.assert_allclose(result.mean, values.mean(axis=0))
    np.testing.assert_allclose(result.std, values.std(axis=0))
    np.testing.assert_array_equal([result.min, result.max], [values.min(axis=0), values.max(axis=0)])
    for name, share in QUANTILES.items():
        expected = np.quantile(values, share, axis=0, method="inverted_cdf")
        np.testing.assert_array_equal(result.quantiles[name], expected)
