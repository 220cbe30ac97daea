"""Pages about evaluations, against the table of episodes."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy

from mjrun.errors import UnknownNameError
from mjrun.evaluation.evaluation import Evaluation
from mjrun.evaluation.summaries import FILES
from mjrun.formats.study_reader import read_study
from tests.evaluation.tasks import cart_task
from tests.page_cells import PageCells
from tests.study.in_process import simulate_here


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    simulate_here(monkeypatch)


def made(folder: Path, **options: object) -> str:
    """Returns the page of an evaluation."""
    arguments = {"policy": "random", "episodes": 7, "jobs": 1, "html": str(folder / "page.html"), **options}
    Evaluation(cart_task(folder), str(folder / "out"), **arguments).run()  # type: ignore[arg-type]
    return (folder / "page.html").read_text("utf-8")


def test_the_page_shows_the_numbers_of_the_episodes(tmp_path: Path) -> None:
    page = made(tmp_path)
    rows = pd.read_csv(tmp_path / "out" / FILES[1])
    cells = PageCells(page)
    values = rows["return"].to_numpy()
    start = cells.texts.index("return")
    count, mean, _, iqm, _, median, std, least, most = cells.texts[start + 1 : start + 10]
    shown = [float(text.replace("−", "-")) for text in (mean, iqm, median, std, least, most)]
    assert count == "7"
    quarters = scipy.stats.trim_mean(values, 0.25)
    expected = [values.mean(), quarters, np.median(values), values.std(ddof=1), values.min(), values.max()]
    assert "48 % of samples of 7 episodes lack an event" in page
    np.testing.assert_allclose(shown, expected, rtol=1e-4)
    assert page.count("<svg") == 1
    assert {*rows["ending"]} <= {*cells.texts}


def test_seeds_that_a_float_would_round_are_texts_in_the_table_and_no_numbers_of_requirements(tmp_path: Path) -> None:
    page = made(tmp_path, seed=2**53 - 1, episodes=3)
    rows = (tmp_path / "out" / FILES[1]).read_text().splitlines()
    assert [row.split(",")[1] for row in rows] == ["seed", *(str(2**53 + place) for place in (-1, 0, 1))]
    assert page.count("<svg") == 1
    with pytest.raises(UnknownNameError, match="'seed'"):
        made(tmp_path, seed=2**53 - 1, episodes=3, require=["seed > 0"])


def test_two_policies_are_compared_and_parameters_listed(tmp_path: Path) -> None:
    page = made(tmp_path, compare="zero", vary={"geom/box.mass": "1,2"})
    cells = PageCells(page).texts
    assert "random minus zero, over 14 pairs of episodes" in page
    assert cells[cells.index("geom/box.mass [kg]") + 1 :][:2] == ["2", "1, 2"]
    assert read_study(tmp_path / "out").units == {
        "geom/box.mass": "kg",
        "length": "s",
        "length_low": "s",
        "length_high": "s",
    }
    ending = cells.index("Ending")
    assert cells[ending : ending + 5] == ["Ending", "Policy", "Outcome", "Share", "95 % interval"]
    comparison = cells[cells.index("Difference") : ending]
    difference, ends = comparison[comparison.index("success") + 1 :][:2]
    assert difference.endswith(" %")
    assert ends.endswith(" %")
    assert "Results of zero" in page
