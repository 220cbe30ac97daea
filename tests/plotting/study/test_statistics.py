"""Rank correlations against pandas."""

import numpy as np
import pandas as pd
import pytest

from mjrun.errors import MissingExtraError
from mjrun.plotting.study.statistics import rank_correlations


def test_correlations_are_those_of_pandas_without_what_is_missing() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=(60, 3)).round(1)  # with ties
    metric = np.exp(values[:, 0]) - values[:, 1] ** 3 + 0.1 * rng.normal(size=60)
    metric[[4, 9, 33]] = np.nan
    frame = pd.DataFrame(np.column_stack([values, metric]))
    expected = frame.corr(method="spearman").to_numpy()[:3, 3]
    np.testing.assert_allclose(rank_correlations(list(values.T), metric), expected, rtol=1e-12)


def test_what_does_not_vary_has_none() -> None:
    found = rank_correlations([np.ones(5), np.arange(5.0)], np.arange(5.0) ** 3)
    assert np.isnan(found[0])
    assert found[1] == pytest.approx(1)
    assert np.isnan(rank_correlations([np.arange(5.0)], np.array([1, 2, np.nan, np.nan, np.nan]))).all()


def test_without_scipy_the_extra_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match="scipy"):
        rank_correlations([], np.empty(0))
