"""What an episode is, in words that steppers share."""

import pytest

from mjrun.task.episode import Ending, EpisodeOver


@pytest.mark.parametrize(("kind", "terminated"), [("success", True), ("failure", True), ("timeout", False)])
def test_a_timeout_truncates_and_anything_else_terminates(kind, terminated: bool) -> None:
    assert Ending("end", kind).terminated is terminated


def test_the_end_of_an_episode_says_where_and_how() -> None:
    over = EpisodeOver(40, Ending("fallen", "failure"))
    assert (over.step, over.ending.name, str(over)) == (40, "fallen", "the episode ended at step 40: fallen")
