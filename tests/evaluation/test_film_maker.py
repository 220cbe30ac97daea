"""Films of episodes."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import UsageError
from mjrun.evaluation.evaluation import Evaluation
from mjrun.formats.video_reader import read_video
from mjrun.outputs.video import Video
from mjrun.simulation.simulation import Simulation
from tests.evaluation.tasks import cart_task, play_here, write_policies

SMALL = {"size": (64, 48), "fps": 20, "quality": "draft"}


@pytest.mark.gl
def test_a_film_is_the_video_of_that_episode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    play_here(monkeypatch)
    task, policy = cart_task(tmp_path, duration=0.3), f"{write_policies(tmp_path)}:act"
    out = tmp_path / "out"
    some = Evaluation(task, str(out), policy=policy, episodes=3, films=2, jobs=1, **SMALL)  # type: ignore[arg-type]
    result = some.run()
    assert [film.rank for film in result.films] == ["worst", "best"]
    assert result.films[0].returned == result.policies[0].returns.min
    for film in result.films:
        assert film.path in result.files
        path = str(tmp_path / "own.mp4")
        Video(Simulation(task, policy=policy, seed=film.seed), path, **SMALL).run()  # type: ignore[arg-type]
        ours, own = (np.stack(list(read_video(each))) for each in (film.path, path))
        assert len(ours) == 6
        assert np.array_equal(ours, own)


def test_a_camera_that_is_not_there_is_told_before_anything_is_played(tmp_path: Path) -> None:
    some = Evaluation(cart_task(tmp_path), str(tmp_path / "out"), policy="zero", films=1, camera="front")
    with pytest.raises(UsageError, match="front"):
        some.run()
    assert not (tmp_path / "out").exists()
