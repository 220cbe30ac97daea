"""How many processes draw, as a table."""

import pytest

from mjrun.errors import BadValueError
from mjrun.rendering.process_count import estimated_cost, jobs_for


@pytest.mark.parametrize(
    ("asked", "software", "frames", "cost", "cores", "expected"),
    [
        ("auto", False, 10_000, 1.0, 8, 1),  # a GPU
        ("auto", True, 300, 0.005, 8, 1),  # short
        ("auto", True, 300, 0.1, 8, 8),
        ("auto", True, 300, 0.1, 2, 2),
        ("auto", True, 19, 0.1, 2, 1),
        ("auto", True, 5, 60.0, 8, 5),
        ("auto", True, 300, 1.0, 1, 1),
        (3, False, 300, 0.001, 1, 3),
        (3, True, 2, 0.1, 8, 2),
        (2, True, 0, 0.1, 8, 1),
    ],
)
def test_processes_are_as_many_as_are_worth_it(
    asked: int | str, software: bool, frames: int, cost: float, cores: int, expected: int
) -> None:
    assert jobs_for(asked, software, frames, cost, cores) == expected


def test_a_guess_grows_with_pixels_and_panels() -> None:
    assert estimated_cost((640, 480)) == pytest.approx(0.06072)
    assert estimated_cost((640, 480), 3) == pytest.approx(3 * 0.06072)


@pytest.mark.parametrize("asked", [0, -1, "many", "2"])
def test_a_number_of_processes_that_is_none_is_refused(asked: int | str) -> None:
    with pytest.raises(BadValueError, match=r"jobs: .* is not a number of processes from 1 on, or auto"):
        jobs_for(asked, True, 100, 0.1, 2)
