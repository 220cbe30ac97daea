"""A dataset of episodes: simulated or replayed once each, on any machine, and written for readers of its format.

Episodes wait in `mjrun/` within the folder until all are there. The dataset is then published at once, and a file there
lists the keys of its episodes, hashes of everything that determines them: an interrupted export continues, a larger one
adds episodes, and those of another task, policy, model or option are never mixed with them.
"""

import json
import math
import os
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import field, replace
from fractions import Fraction
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco

from mjrun.dataclass import dataclass
from mjrun.errors import FailedEpisodesError, FileError, UsageError, clean, counted, option
from mjrun.experiment.design import Design
from mjrun.experiment.results_table import manifest_writer, raise_failures
from mjrun.formats.codecs import encoding
from mjrun.formats.episodes import CameraVideoLayout, EpisodeLayout, EpisodeRows
from mjrun.formats.input_file import exists, is_folder
from mjrun.formats.local_and_remote_folders import written_file
from mjrun.formats.output_writer import publish_together
from mjrun.formats.temporary_output import one_at_a_time, published_in, remove_left_behind
from mjrun.model.mujoco_globals import reported_warnings
from mjrun.model.sources import demonstration_in
from mjrun.model.sources.demonstration import errors_of_models, open_demonstrations
from mjrun.options.datasets import EXTRAS, KEYFRAMES, EpisodeDatasetOptions
from mjrun.options.option import options, values_of
from mjrun.options.rendering import SceneOptions, ViewOptions, decoration_options
from mjrun.options.sweep import PARTS, ExecutionOptions
from mjrun.options.video import FPS
from mjrun.outputs.exports import export_format
from mjrun.outputs.frame_drawing import check_drawing
from mjrun.outputs.recorded_scene import camera_motions
from mjrun.packages import require
from mjrun.platform.cores import available_cores
from mjrun.rendering.backend import AUTO, GL, BackendDetector
from mjrun.rendering.drawn_model import drawn_model
from mjrun.reporter import PythonApiReporter, Reporter
from mjrun.simulation.simulation import Simulation, require_simulation, require_whole
from mjrun.study.dataset_specs import FOLDER, NEARLY, EpisodeSpec, camera_keys
from mjrun.study.episode_files import observed_columns
from mjrun.study.executors import WARP, check_engine
from mjrun.study.part_files import kept_results_in_errors
from mjrun.study.prepared import PreparedStudy
from mjrun.study.spec import MODEL, PointResult
from mjrun.study.study import Study
from mjrun.suffixes import split_episode
from mjrun.task.task import Task
from mjrun.version import __version__

SCHEMA = "mjrun-episodes-1"
OWN, MANIFEST = "mjrun", "mjrun/dataset.json"  # folder and file of the dataset that belong to mjrun
KEY = "key"  # file of an episode that waits, written last
POLICY_EPISODES = 10
RATES = 6  # that a message lists


@options
class EpisodeDataset(EpisodeDatasetOptions, ExecutionOptions):
    """Episodes of `simulation`: of its policy or its random numbers, each with another seed, or of its recording.

    If its model is a file of demonstrations, these are the episodes.

    Its options are keywords.

    Args:
      command: command line, for the manifest.
    """

    simulation: Simulation = field(kw_only=False)
    command: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_simulation(self.simulation)
        if self.simulation.policy is not None or self._file or self.simulation.demonstration is not None:
            require_whole(self.simulation, "an episode, which its task or its demonstration ends")
        if self.engine == WARP:
            raise UsageError(
                f"{option('engine')} warp plays no policies and renders nothing; {option('engine')} local does"
            )
        for name in decoration_options(self):
            raise UsageError(f"{option(name)}: images of a dataset show what a policy would see", (name,))
        if self.simulation.replay is not None and self.episodes not in (None, 1) and not self._file:
            raise UsageError(f"{option('replay')} gives one episode, not {self.episodes}", ("episodes",))

    def run(self, reporter: Reporter | None = None) -> "EpisodeDatasetResult":
        """Simulates the episodes that are missing, and writes the dataset.

        Raises:
          FailedEpisodesError: episodes failed; the dataset has the others.
          FileError: the folder contains something else, or other episodes.
          UsageError: the name of the folder ends like that of a file of another format.
          MjrunError: nothing could be simulated.
        """
        reporter, start = reporter or PythonApiReporter(), time.perf_counter()
        export_format(self.output, self.format)
        libraries, use = EXTRAS[self.format]
        require(use, self.format, *libraries)
        with reported_warnings(reporter):
            known, points, simulation = self._known_episodes(), self._points, self.simulation
            if self._file:
                simulation = replace(simulation, model=points.points[0][0], replay=None)
            simulation = simulation.with_snapshot()
            with simulation.snapshot.original_names_in_errors() if simulation.snapshot else nullcontext():
                layout, spec = self._planned(simulation, reporter)
            study = self._study(simulation)
            prepared = PreparedStudy(study, replace(study.spec, product=spec), points)
            self._require_same(known, prepared)
            check_engine(self.engine)
            prepared.files.create()
            known = self._begun(layout, prepared)
            prepared.warn(reporter)
            missing = self._missing(prepared, known)
            prepared.note_known(missing, reporter)
            simulated = 0
            if missing:
                simulated = prepared.simulate(missing, study, reporter, publish=self._publish).total()
            with one_at_a_time(self._own), kept_results_in_errors(prepared.folder, prepared.noun):
                known = self._known_episodes()  # another process may have published some
                self._require_same(known, prepared)
                return self._conclude(layout, prepared, known, simulated, start, reporter)

    # --- before the simulation --------------------------------------------------------------------

    @property
    def _own(self) -> Path:
        return Path(self.output) / OWN

    @property
    def _file(self) -> str:
        """The file whose demonstrations are the episodes; empty for another simulation, or one demonstration."""
        text = demonstration_in(self.simulation.model)
        return text if text and text == self.simulation.replay and not split_episode(text)[1] else ""

    @cached_property
    def _points(self) -> Design:
        simulation, count = self.simulation, self.episodes
        if self._file:
            with errors_of_models(), open_demonstrations(Path(self._file)) as file:
                names = file.names
            if count and count > len(names):
                raise UsageError(f"{clean(self._file)} has {counted(len(names), 'demonstration')}", ("episodes",))
            return Design((MODEL,), [(f"{self._file}:{name}",) for name in names[:count]])
        if simulation.replay is not None:
            return Design((), [()])
        count = count or (POLICY_EPISODES if simulation.policy is not None else 1)
        return Design(("seed",), [(str(simulation.seed + index),) for index in range(count)])

    def _study(self, simulation: Simulation) -> Study:
        values = values_of(self, ExecutionOptions)
        return Study(simulation, output=str(self._own), command=self.command, **values)

    def _planned(self, simulation: Simulation, reporter: Reporter) -> tuple[EpisodeLayout, EpisodeSpec]:
        """Checks everything that does not depend on an episode, and returns what all of them share."""
        model = simulation.load()
        if simulation.episode is None:
            simulation.timeline(model)
            simulation.stepper(model)
        demonstration = simulation.demonstration
        if demonstration and simulation.snapshot:
            for text in simulation.replay_remarks(model):
                reporter.note(simulation.snapshot.with_original_names(text))
        observed, acted = observed_columns(simulation, model, self.probe)
        fps, every = self._rate(simulation, reporter)
        names = camera_keys(self.camera)
        source = simulation.source
        spec = EpisodeSpec(
            view=self._view(),
            cameras=names,
            encoding=replace(
                encoding("a.mp4", None, self.codec, self.crf, self.preset), keyframe_every=KEYFRAMES, alone=True
            ),
            probe=self.probe,
            fps=str(fps),
            every=every,
            task=clean(self.instruction or ("" if demonstration else source.stem.replace("_", " "))),
            observed=tuple(column.name for column in observed),
            acted=tuple(column.name for column in acted),
            precision=import_module(f"mjrun.formats.episodes.{self.format}").PRECISION,
            processes=self._drawing_processes(),
        )
        episode = simulation.episode
        low, high = (episode.actions.low.tolist(), episode.actions.high.tolist()) if episode else _control_bounds(model)
        if demonstration:
            low, high = [-math.inf] * len(acted), [math.inf] * len(acted)
        layout = EpisodeLayout(
            fps=fps,
            observations=observed,
            actions=acted,
            action_low=low,
            action_high=high,
            cameras=[CameraVideoLayout(name, self.size, spec.encoding) for name in names],
            has_rewards=episode is not None or (demonstration is not None and demonstration.rewards is not None),
            robot=_robot(simulation),
            environment=episode.specification if episode else "",
            origin=self._origin(simulation),
        )
        import_module(f"mjrun.formats.episodes.{self.format}").check(layout)
        if names:
            backend = BackendDetector(spec.view.gl).result(require_gpu=self.require_gpu)
            for text in check_drawing(spec.view, model, backend):
                reporter.warn(text)
            drawn, remark, is_framed = drawn_model(spec.view, model, source)
            if remark:
                reporter.note(remark)
            with source.named_in_errors():
                camera_motions(self.camera, self.size, drawn, is_framed=is_framed)
        return layout, spec

    def _rate(self, simulation: Simulation, reporter: Reporter) -> tuple[Fraction, int]:
        """Returns the rows per second, and the control periods from one row to the next; 0 without a policy.

        Raises:
          UsageError: the rate does not fit the control period.
        """
        if simulation.demonstration:
            rate = simulation.demonstration.rate
            if self.fps is None or abs(self.fps - rate) < NEARLY * rate:
                return self.fps or rate, 0
            raise UsageError(
                f"{option('fps')} {float(self.fps):g}: the demonstrations have {float(rate):g} actions per second",
                ("fps",),
            )
        if simulation.episode is None:
            return self.fps or FPS, 0
        rate = 1 / simulation.episode.control_dt
        if self.fps is None:
            return rate, 1
        if (rate / self.fps).denominator == 1:
            if self.format == "minari" and rate != self.fps:
                raise UsageError(f"{option('fps')}: each row of a Minari dataset is a control period", ("fps",))
            return self.fps, int(rate / self.fps)
        if abs(self.fps - rate) < NEARLY * rate:
            reporter.note(
                f"the dataset states {float(self.fps):g} rows per second; actions are {float(rate):.6g} per second"
            )
            return self.fps, 1
        whole = [rate / every for every in range(1, int(rate) + 1) if (rate / every).denominator == 1][:RATES]
        valid = f"such as {', '.join(map(str, whole))}" if whole else f"or {round(rate)}, which is rounded"
        raise UsageError(
            f"{option('fps')} {float(self.fps):g}: a policy acts {float(rate):.6g} times per second; rows per second "
            f"are that divided by a whole number, {valid}",
            ("fps",),
        )

    def _view(self) -> ViewOptions:
        """Returns the options of images; processes that simulate have a MUJOCO_GL that switches rendering off."""
        return ViewOptions(**{**values_of(self, SceneOptions), "gl": self.gl or os.environ.get(GL) or AUTO})

    def _drawing_processes(self) -> int:
        """Returns the number of processes that render an episode: more than one if cores would idle otherwise."""
        if not self.camera or self.engine != "local":
            return 1
        processes = self.processes if isinstance(self.processes, int) else available_cores()
        return max(1, processes // len(self._points.points))

    def _origin(self, simulation: Simulation) -> dict[str, str]:
        policy = simulation.policy
        return {
            "source": self._file or simulation.source.text,
            "policy": policy if isinstance(policy, str) else type(policy).__name__ if policy is not None else "",
            "command": self.command,
            "mjrun": __version__,
            "mujoco": mujoco.mj_versionString(),
        }

    # --- what the folder has -----------------------------------------------------------------------

    def _known_episodes(self) -> list[dict[str, Any]]:
        """Returns what the manifest says about the episodes of the dataset in the folder.

        Raises:
          FileError: the folder contains something else.
        """
        path = Path(self.output)
        if not exists(path):
            return []
        if not is_folder(path):
            raise FileError(path, "is not a folder", f"{option('output')} names the folder of the dataset")
        if not published_in(path) or self._has_begun():
            return []
        try:
            manifest = json.loads((path / MANIFEST).read_text("utf-8"))
            if manifest["schema"] == SCHEMA and manifest["format"] == self.format:
                return [_facts_of(each) for each in manifest["episodes"]]
            made = clean(str(manifest["format"]))
        except (OSError, ValueError, KeyError, TypeError):
            hint = f"{option('output')} names a folder that is new, empty, or of an earlier export of episodes"
            raise FileError(
                path, f"contains other files, but no dataset of episodes: it has no {MANIFEST}", hint
            ) from None
        raise FileError(path, f"contains a {made} dataset", f"choose another folder for {self.format}")

    def _has_begun(self) -> bool:
        """Returns whether another process is about to write the manifest, or ended before it did."""
        names = {each.name for each in published_in(Path(self.output))}
        return names == {OWN} and is_folder(self._own) and {each.name for each in published_in(self._own)} <= {PARTS}

    def _require_same(self, known: Sequence[Mapping[str, Any]], prepared: PreparedStudy) -> None:
        """Refuses to add episodes to a dataset with others.

        Raises:
          FileError: the dataset has episodes that this command would not make.
        """
        others = [each for each in known if each["key"] not in prepared.keys]
        if not others:
            return
        seeds = {values[0] for values in prepared.points.points if values}
        more = [each for each in others if str(each.get("seed")) not in seeds and not self._file]
        if more and seeds and len(more) == len(others):
            reason = f"has {counted(len(known), 'episode')}, of seeds that this command does not ask for"
            raise FileError(
                self.output, reason, f"ask for at least those with {option('episodes')}, or choose another folder"
            )
        reason = "has episodes of another task, policy, model, version or options, which are not mixed"
        raise FileError(self.output, reason, "choose another folder, or remove this one")

    def _missing(self, prepared: PreparedStudy, known: Sequence[Mapping[str, Any]]) -> list[int]:
        """Returns the points to simulate: those without a result, and those whose files are lost."""
        have = {each["key"] for each in known}
        numbered = enumerate(zip(prepared.keys, prepared.known, strict=True))
        prepared.known.forget(
            [index for index, (key, result) in numbered if result.status == "ok" and not self._waits(index, key)]
        )
        return [index for index in prepared.missing(self.retry_failed) if prepared.keys[index] not in have]

    def _waits(self, index: int, key: str) -> bool:
        """Returns whether the files of an episode are there, and of this episode."""
        try:
            return (self._own / FOLDER / f"{index:06}" / KEY).read_text() == key
        except (OSError, ValueError):
            return False

    # --- what is written ---------------------------------------------------------------------------

    def _publish(self, key: str, result: PointResult) -> None:
        """Writes the files of an episode, and its key last."""
        if not result.files:
            return
        own_key = (f"{FOLDER}/{result.index:06}/{KEY}", key.encode())
        (self._own / own_key[0]).unlink(missing_ok=True)
        for path, content in (*result.files, own_key):
            with written_file(self._own / path, content) as output:
                output.publish()

    def _begun(self, layout: EpisodeLayout, prepared: PreparedStudy) -> list[dict[str, Any]]:
        """Writes the manifest before the first episode; returns the episodes of the dataset, which it repeats."""
        with one_at_a_time(self._own):
            known = self._known_episodes()
            self._require_same(known, prepared)
            with manifest_writer(Path(self.output) / MANIFEST, self._facts(layout, known)) as output:
                output.publish()
        return known

    def _facts(self, layout: EpisodeLayout, episodes: Sequence[Mapping[str, Any]]) -> dict[str, object]:
        return {
            "schema": SCHEMA,
            "format": self.format,
            **layout.origin,
            "fps": float(layout.fps),
            "episodes": episodes,
        }

    def _conclude(
        self,
        layout: EpisodeLayout,
        prepared: PreparedStudy,
        known: Sequence[Mapping[str, Any]],
        simulated: int,
        start: float,
        reporter: Reporter,
    ) -> "EpisodeDatasetResult":
        results, have = prepared.known, {each["key"] for each in known}
        new = [
            index
            for index, (key, result) in enumerate(zip(prepared.keys, results, strict=True))
            if result.status == "ok" and key not in have and self._waits(index, key)
        ]
        episodes = [*known]
        if new:
            made = list[dict[str, Any]]()
            with ExitStack() as stack:
                write = import_module(f"mjrun.formats.episodes.{self.format}").write
                waiting = self._waiting(new, prepared, layout, made, reporter)
                writers = write(stack, Path(self.output), layout, waiting, len(known))
                episodes += made
                facts = self._facts(layout, episodes)
                writers.append(stack.enter_context(manifest_writer(Path(self.output) / MANIFEST, facts)))
                publish_together(writers)
        for inner, _, _ in os.walk(self.output):  # older files that a process left that was killed as it published
            remove_left_behind(Path(inner))
        written = {each["key"] for each in episodes}
        for index, key in enumerate(prepared.keys):  # also what a process left that was killed here
            if key in written:  # another process may be about to publish others
                shutil.rmtree(self._own / FOLDER / f"{index:06}", ignore_errors=True)
        with suppress(OSError):
            (self._own / FOLDER).rmdir()
        failures = {
            self._name(prepared, index): result.message
            for index, result in enumerate(results)
            if result.status not in ("ok", "missing") and prepared.keys[index] not in have
        }
        missing = sum(key not in written for key in prepared.keys) - len(failures)
        returns = [each["return"] for each in episodes]
        result = EpisodeDatasetResult(
            path=self.output,
            format=self.format,
            episodes=len(episodes),
            rows=sum(each["rows"] for each in episodes),
            fps=float(layout.fps),
            seeds=[each["seed"] for each in episodes],
            successes=sum(each["success"] for each in episodes),
            mean_return=sum(returns) / len(returns) if layout.has_rewards and returns else None,
            cameras=[camera.name for camera in layout.cameras],
            simulated=simulated,
            failures=failures,
            wall=time.perf_counter() - start,
        )
        is_complete = not failures and not missing
        error = None if is_complete else FailedEpisodesError(failures, len(results), missing=missing)
        raise_failures(result, [], error)
        return result

    def _waiting(
        self,
        indices: Sequence[int],
        prepared: PreparedStudy,
        layout: EpisodeLayout,
        made: list[dict[str, Any]],
        reporter: Reporter,
    ) -> Iterator[EpisodeRows]:
        """Yields the episodes that wait, and adds facts about each to `made`."""
        names = [camera.name for camera in layout.cameras]
        for done, index in enumerate(indices, 1):
            episode = EpisodeRows.read(self._own / FOLDER / f"{index:06}", names)
            facts: dict[str, Any] = {"key": prepared.keys[index], "seed": episode.seed, "rows": len(episode)}
            facts |= {"demonstration": prepared.points.points[index][0]} if self._file else {}
            made.append({**facts, "return": float(episode.rewards.sum()), "success": episode.success})
            yield episode
            reporter.progress("episodes written", done, len(indices))

    def _name(self, prepared: PreparedStudy, index: int) -> str:
        values = prepared.points.points[index]
        seed = "" if self._file else "seed "
        return f"{seed}{values[0]}" if values else f"episode {index}"


@dataclass(frozen=True)
class EpisodeDatasetResult:
    """The result of an export of episodes.

    Attributes:
      path: folder of the dataset.
      format: name of the format.
      episodes: number of episodes in the dataset.
      rows: number of rows of all episodes.
      fps: rows per second.
      seeds: seed of each episode; None for a recording.
      successes: number of episodes that ended in success.
      mean_return: mean of the sums of rewards; None without rewards.
      cameras: names of the cameras in the dataset.
      simulated: number of episodes that were simulated now; the others were known.
      failures: reasons for the episodes that the dataset lacks, by their seeds.
      wall: wall time [s].
      schema: name of this schema.
    """

    path: str
    format: str
    episodes: int
    rows: int
    fps: float
    seeds: Sequence[int | None]
    successes: int
    mean_return: float | None
    cameras: Sequence[str]
    simulated: int
    failures: Mapping[str, str]
    wall: float
    schema: str = SCHEMA


def _robot(simulation: Simulation) -> str:
    """Returns the name of the robot, or of the model."""
    source = simulation.source
    if simulation.demonstration and simulation.demonstration.robot:
        return simulation.demonstration.robot
    return source.model.stem if isinstance(source, Task) else source.stem


def _facts_of(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the facts about an episode in a manifest; raises KeyError, TypeError or ValueError for invalid ones."""
    seed = entry["seed"]
    return {
        "key": str(entry["key"]),
        "seed": None if seed is None else int(seed),
        "rows": int(entry["rows"]),
        "return": float(entry["return"]),
        "success": bool(entry["success"]),
        **({"demonstration": str(entry["demonstration"])} if "demonstration" in entry else {}),
    }


def _control_bounds(model: mujoco.MjModel) -> tuple[list[float], list[float]]:
    """Returns the lowest and the highest value of each control; infinite for none."""
    limits = [
        tuple(bounds) if is_limited else (-float("inf"), float("inf"))
        for bounds, is_limited in zip(model.actuator_ctrlrange.tolist(), model.actuator_ctrllimited, strict=True)
    ]
    return [low for low, _ in limits], [high for _, high in limits]
