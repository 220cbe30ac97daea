"""Makes films of episodes: each is that very episode, as `mjrun video TASK --policy P --seed S` shows it."""

from collections.abc import Sequence

from mjrun.errors import MjrunError
from mjrun.evaluation.episode import EpisodeSpec
from mjrun.evaluation.films import FilmChoice, chosen_films
from mjrun.evaluation.folder import ResultsFolder
from mjrun.evaluation.prepared import PreparedEvaluation
from mjrun.evaluation.result import Film
from mjrun.evaluation.table import PlayedEpisodes
from mjrun.options.evaluation import FilmOptions
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.video import Video
from mjrun.reporter import Reporter, WarningReporter
from mjrun.simulation.simulation import Simulation

Failures = list[tuple[str, MjrunError]]


class FilmMaker:
    """Makes the films that `options` ask for.

    Args:
      seed: of the first episode.

    Raises:
      UsageError: there is no such camera, or a size that cannot be.
    """

    def __init__(self, options: FilmOptions, prepared: PreparedEvaluation, seed: int) -> None:
        self._options, self._prepared = options, prepared
        if options.films:
            preview([self._video(prepared.groups[0].spec, seed, "film.mp4")], WarningReporter())

    def make(
        self, groups: Sequence[PlayedEpisodes], folder: ResultsFolder, reporter: Reporter
    ) -> tuple[list[Film], Failures]:
        """The films of episodes of `groups`, which are the first of those prepared; and which could not be made."""
        films, failures, warnings = list[Film](), Failures(), _Warnings(reporter)
        chosen = chosen_films(groups, self._options.films) if self._options.films else []
        for done, choice in enumerate(chosen, 1):
            path = str(folder.path / choice.name(groups, varies=bool(self._prepared.points.names)))
            try:
                video = self._video(self._prepared.groups[choice.group].spec, self._seed(groups, choice), path)
                perform([video], warnings)
                films.append(self._film(groups, choice, path))
            except MjrunError as error:
                failures.append((path, error))
            reporter.progress("films", done, len(chosen))
        return films, failures

    def _film(self, groups: Sequence[PlayedEpisodes], choice: FilmChoice, path: str) -> Film:
        group = groups[choice.group]
        episode = group.episodes[choice.episode]
        point = group.point if self._prepared.points.names else None
        return Film(choice.rank, path, episode.seed, point, episode.total, episode.ending)

    def _seed(self, groups: Sequence[PlayedEpisodes], choice: FilmChoice) -> int:
        return groups[choice.group].episodes[choice.episode].seed

    def _video(self, spec: EpisodeSpec, seed: int, path: str) -> Video:
        options, chosen = self._options, spec.chosen
        return Video(
            Simulation(
                spec.task,
                policy=chosen.policy,
                normalize=chosen.normalize,
                trust=chosen.trust,
                seed=seed,
                snapshot=chosen.snapshot,
            ),
            path,
            camera=options.camera,
            size=options.size,
            quality=options.quality,
            fps=options.fps,
            speed=options.speed,
        )


class _Warnings(WarningReporter):
    """Passes on each warning once, and nothing else: films are told of together."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter, self._told = reporter, set[str]()

    def warn(self, text: str) -> None:
        kind = text.partition(":")[0]
        if kind not in self._told:
            self._told.add(kind)
            self._reporter.warn(text)
