"""Episodes in processes of their own."""

from pathlib import Path

import pytest

from mjrun.errors import ControllerError, InvalidActionError, LostEpisodesError, MjrunError, UsageError, concerning
from mjrun.evaluation.episode import EpisodeSpec, PolicyChoice
from mjrun.evaluation.player import player_of
from mjrun.evaluation.processes import Chunk, Failure, played
from tests.evaluation.tasks import cart_task, write_policies


def spec(folder: Path, name: str) -> EpisodeSpec:
    return EpisodeSpec(cart_task(folder), PolicyChoice(f"{write_policies(folder)}:{name}"))


def test_the_episodes_are_those_of_this_process(tmp_path: Path) -> None:
    specs = [spec(tmp_path, "act"), spec(tmp_path, "weak")]
    chunks = [Chunk(place, specs[place], seeds) for place, seeds in ((0, [1, 2]), (1, [2]), (0, [3]))]
    found = {(chunk.group, tuple(chunk.seeds)): episodes for chunk, episodes in played(chunks, 2)}
    for chunk in chunks:
        assert found[chunk.group, tuple(chunk.seeds)] == player_of(specs[chunk.group]).play(chunk.seeds)


@pytest.mark.parametrize(
    ("name", "error", "match"),
    [
        ("Broken", InvalidActionError, r"push = nan[\s\S]*seed 5"),
        ("raising", ControllerError, "nothing here"),
        ("Crashing", LostEpisodesError, "the episode of seed 5 was killed by SIGABRT.*"),
    ],
)
def test_what_an_episode_raises_is_raised_here(tmp_path: Path, name: str, error: type[MjrunError], match: str) -> None:
    with pytest.raises(error, match=match):
        list(played([Chunk(0, spec(tmp_path, name), [5, 6])], 1))


def test_an_error_arrives_as_it_was_raised() -> None:
    original = UsageError("--x: wrong", ("x", 3))
    original.add_note("somewhere")
    with pytest.raises(UsageError) as found, concerning("x"):
        raise Failure.of(original).error()
    assert str(found.value) == str(original)
    assert found.value.path == ("x", 3)
    assert found.value.spelled(str) == original.spelled(str)

    nan = InvalidActionError(3, 0.5, "p.onnx", {"knee": float("nan")})
    again = Failure.of(nan).error()
    assert isinstance(again, InvalidActionError)
    assert (again.step, again.time, str(again), again.exit_code) == (3, 0.5, str(nan), 4)
