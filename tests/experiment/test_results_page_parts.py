"""Parts of pages about results."""

from pathlib import Path

import pytest

from mjrun.errors import BadValueError, FileError
from mjrun.experiment.design import Design
from mjrun.experiment.results_page_parts import check_page, number, parameters_table, study_figures


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (["1", "2.50", "1"], ("2", "1, 2.5")),
        ([str(k / 7) for k in range(8)], ("8", "0 … 1")),
        (list("abcdefgh"), ("8", "a, b, c, d, e, f, …")),
    ],
)
def test_parameters_are_listed_or_have_a_range(values: list[str], expected: tuple[str, str]) -> None:
    (facts,) = parameters_table(Design(("p",), [(value,) for value in values]))
    assert facts.rows == [("p", *expected)]


def test_parameters_have_their_units() -> None:
    (facts,) = parameters_table(Design(("opt.timestep", "p"), [("1", "2"), ("3", "4")]), {"opt.timestep": "s"})
    assert [row[0] for row in facts.rows] == ["opt.timestep [s]", "p"]


def test_nothing_varies_without_parameters() -> None:
    assert parameters_table(Design((), [()])) == []


def test_pages_can_be_written_and_have_names_that_end_with_html(tmp_path: Path) -> None:
    check_page(str(tmp_path / "new" / "a.html"))
    assert not [*tmp_path.iterdir()]
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="is not a folder"):
        check_page(str(tmp_path / "file" / "a.html"))
    with pytest.raises(BadValueError, match=r"a file that ends with \.html"):
        check_page("a.pdf")


def test_numbers_have_five_digits_and_a_minus() -> None:
    assert (number(-1234567.0), number(None)) == ("−1.2346e+06", "")


def test_a_folder_without_a_study_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"results\.parquet"):
        study_figures(tmp_path)
