"""Which episodes are filmed."""

import pytest

from mjrun.evaluation.films import chosen_films
from mjrun.evaluation.folder import FILMS
from tests.evaluation.episodes import played, totals


def chosen(returns: list[float], count: int) -> list[tuple[str, float]]:
    groups = [played(*returns)]
    return [(film.rank, totals(groups)[film.episode]) for film in chosen_films(groups, count)]


def test_three_are_the_worst_the_median_and_the_best() -> None:
    assert chosen([5, 1, 4, 2, 3], 3) == [("worst", 1), ("median", 3), ("best", 5)]


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (1, [("median", 3)]),
        (2, [("worst", 1), ("best", 5)]),
        (4, [("worst", 1), ("rank2", 2), ("median", 3), ("best", 5)]),
        (9, [("worst", 1), ("rank2", 2), ("median", 3), ("rank4", 4), ("best", 5)]),
    ],
)
def test_any_number_is_spaced_by_rank(count: int, expected: list[tuple[str, float]]) -> None:
    found = chosen([5, 1, 4, 2, 3], count)
    assert [value for _, value in found] == sorted(value for _, value in found)
    if count != 4:
        assert found == expected
    assert (found[0], found[-1]) == (expected[0], expected[-1])
    assert len(found) == min(count, 5)


def test_of_an_even_number_the_median_is_the_lower_in_the_middle() -> None:
    assert chosen([4, 3, 2, 1], 3)[1] == ("median", 2)


@pytest.mark.parametrize("count", [1, 3])
def test_a_lone_episode_is_filmed_once(count: int) -> None:
    assert len(chosen([7], count)) == 1


def test_equal_returns_are_ranked_by_their_seeds_and_what_is_no_number_is_the_worst() -> None:
    groups = [played(1, 1, 1)]
    assert [film.episode for film in chosen_films(groups, 3)] == [0, 1, 2]
    assert chosen_films([played(1, float("nan"), 0)], 2)[0].episode == 1


def test_names_tell_rank_point_and_seed_and_are_known_as_films() -> None:
    groups = [played(3, 4, seed=10), played(1, 2, point=1, seed=10)]
    worst, best = chosen_films(groups, 2)
    assert worst.name(groups, varies=True) == "worst_point1_seed10.mp4"
    assert best.name(groups, varies=False) == "best_seed11.mp4"
    for film in (worst, best):
        assert FILMS.fullmatch(film.name(groups, varies=True))
