"""Metrics of episodes, against the table of a trace."""

from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import UnknownNameError
from mjrun.evaluation.episode import EpisodeSpec, PolicyChoice
from mjrun.evaluation.player import player_of
from mjrun.formats.table_reader import read_table
from mjrun.model.sources import parse_source
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from tests.evaluation.tasks import cart_task, write_policies

METRICS = {
    "far": "max(abs(qpos/slider))",
    "effort": "mean(abs(ctrl/push))",
    "seen": "last(obs/v)",
    "done": "mean(abs(action/push))",
    "total": "last(return)",
    "end": "last(time)",
    "never": "first(time, qpos/slider > 50)",
}


def test_metrics_are_those_of_the_trace_at_control_instants(tmp_path: Path) -> None:
    task, policy = cart_task(tmp_path), f"{write_policies(tmp_path)}:act"
    plain = player_of(EpisodeSpec(task, PolicyChoice(policy))).play([3, 8])
    found = player_of(EpisodeSpec(task, PolicyChoice(policy), tuple(METRICS.items()))).play([3, 8])
    for episode, other in zip(found, plain, strict=True):
        path = tmp_path / f"{episode.seed}.csv"
        simulation = Simulation(task, policy=policy, seed=episode.seed)
        Trace(simulation, str(path), probe=["qpos", "ctrl", "obs", "action", "return"], every=2).run()
        table = read_table(path).columns
        expected = {
            "far": np.abs(table["qpos/slider"]).max(),
            "effort": np.abs(table["ctrl/push"]).mean(),
            "seen": table["obs/v"][-1],
            "done": np.abs(table["action/push"]).mean(),
            "total": episode.total,
            "end": episode.length,
            "never": np.nan,
        }
        assert episode.metrics == pytest.approx([*expected.values()], rel=1e-12, nan_ok=True)
        assert table["return"][-1] == episode.total
        assert (episode.total, episode.steps, episode.ending) == (other.total, other.steps, other.ending)


def test_an_environment_is_measured_too() -> None:
    spec = EpisodeSpec(parse_source("gym:InvertedPendulum-v5"), PolicyChoice("zero"), (("last", "last(return)"),))
    (episode,) = player_of(spec).play([2])
    assert episode.metrics == (episode.total,)


def test_a_metric_of_nothing_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="qpos/knee") as found:
        player_of(EpisodeSpec(cart_task(tmp_path), PolicyChoice("zero"), (("m", "max(qpos/knee)"),)))
    assert found.value.path == ("metric", "m")
