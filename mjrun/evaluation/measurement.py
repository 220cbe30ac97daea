"""Metrics of episodes, over what a trace of each holds at its control instants."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import mujoco
import numpy as np

from mjrun.errors import SimulationError, concerning, option
from mjrun.evaluation.episode import Episode, EpisodeSpec
from mjrun.evaluation.player import EpisodePlayer
from mjrun.model.mujoco_globals import collected_warnings
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.policy.policy import Policy
from mjrun.probe.available import AvailableProbes
from mjrun.probe.episode import EpisodeColumns
from mjrun.probe.metric import Metric, MetricEvaluation, parse_metric
from mjrun.simulation.simulation import Simulation
from mjrun.task.episode import EpisodeOver, EpisodeStepper
from mjrun.timeline import Timeline, rational


class MeasuringPlayer(EpisodePlayer):
    """Plays as `player` does, and each episode once more, step by step, to measure it.

    Raises:
      UsageError: a metric is not well formed, or names nothing.
    """

    def __init__(self, player: EpisodePlayer, spec: EpisodeSpec, policy: Policy) -> None:
        self._player, self._spec, self._policy = player, spec, policy
        self.rewards, self.endings, self.can_succeed = player.rewards, player.endings, player.can_succeed
        simulation = Simulation(spec.task, policy=policy)
        assert simulation.episode
        self._metrics = self._parsed(simulation.load(), simulation.episode.columns)

    def play(self, seeds: Sequence[int]) -> list[Episode]:
        return [replace(episode, metrics=self._measured(episode)) for episode in self._player.play(seeds)]

    def _parsed(self, model: mujoco.MjModel, columns: EpisodeColumns) -> list[Metric]:
        available = AvailableProbes(model, columns.names)
        metrics: list[Metric] = []
        for name, text in self._spec.metrics:
            with concerning("metric", name):
                metrics.append(parse_metric(text, available, f"{option('metric')} {name}"))
        return metrics

    def _measured(self, episode: Episode) -> tuple[float, ...]:
        """The metrics over the rows at all control instants, the end among them."""
        simulation = Simulation(self._spec.task, policy=self._policy, seed=episode.seed)
        assert simulation.episode
        model = simulation.load()
        names = dict.fromkeys(name for metric in self._metrics for name in metric.columns if name != "time")
        with collected_warnings():  # the simulation has told of them already
            stepper = simulation.stepper(model)
            assert isinstance(stepper, EpisodeStepper)
            period = stepper.control_steps
            timeline = Timeline.of_steps(rational(model.opt.timestep), episode.steps * period)
            sampler = ProbeSampler(model, [*names], timeline, simulation.episode.columns)
            evaluation = MetricEvaluation(self._metrics, [column.name for column in sampler.columns])
            with suppress(EpisodeOver, SimulationError):  # an unstable simulation has no last instant
                for step in range(0, timeline.steps + 1, period):
                    stepper.advance(step)
                    evaluation.feed(_row(sampler, stepper))
        return evaluation.values()


def _row(sampler: ProbeSampler, stepper: EpisodeStepper) -> np.ndarray:
    return sampler.stack([stepper.step], [sampler.read(stepper)]).values
