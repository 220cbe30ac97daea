"""Files of the episodes of a dataset: each episode is simulated once, and what it saw is rendered from its states."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPose, CameraPoseArray
from mjrun.dataclass import dataclass
from mjrun.errors import EncoderError, InvalidEpisodeError, UsageError, clean, listing, option
from mjrun.formats.episodes import EpisodeRows
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.mp4_joining import read_samples
from mjrun.formats.temporary_output import scratch_folder
from mjrun.model import state
from mjrun.model.names import control_names
from mjrun.model.source import ModelSource
from mjrun.model.table_column import Column
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.event_detection import final_timeline
from mjrun.outputs.frame_drawing import check_drawing, scene_compositor
from mjrun.outputs.recorded_scene import camera_motions, shot_spans
from mjrun.outputs.trace_rows import ProbeSampler
from mjrun.physics.kinematic_samples import KinematicMotion
from mjrun.physics.replay_stepper import ReplayStepper
from mjrun.physics.simulation_loop import StateBuffer, Tap, run_with_taps
from mjrun.physics.stepper import Stepper
from mjrun.probe.episode_columns import OBSERVATION
from mjrun.probe.select import selected_columns
from mjrun.rendering.backend import BackendDetector
from mjrun.rendering.compositor import CameraPanel, FrameComposition, FrameSpec, SceneCompositor
from mjrun.rendering.compositor_pool import CompositorPool, CompositorProcesses
from mjrun.rendering.drawn_model import drawn_model, place_stage
from mjrun.simulation import policy_episode as played
from mjrun.simulation.demonstration import DemonstratedEpisode
from mjrun.simulation.simulation import Simulation
from mjrun.study.dataset_specs import FOLDER, NEARLY, EpisodeSpec
from mjrun.task.task import TIMED_OUT, UNSTABLE
from mjrun.timeline import Timeline, rational

PROBES = ("qpos", "qvel")  # that are observed without a policy
SAMPLED = 100  # pixels across an image at most whose colours are counted
VALUES = 256  # of a colour


class EpisodeFileMaker:
    """A maker of the files of episodes, in the process that simulates them."""

    def __init__(self, spec: EpisodeSpec) -> None:
        self._spec = spec
        self._images: EpisodeImageRenderer | None = None
        self._episode: played.Episode | None = None  # the last one, which the next shares its world with

    def make(
        self, index: int, values: Mapping[str, str], simulation: Simulation
    ) -> tuple[int, tuple[tuple[str, bytes], ...]]:
        """Simulates an episode, and returns the number of its steps, and its files by their paths.

        Args:
          index, values: the number of its point, and its values.

        Raises:
          SimulationError: the simulation became unstable, or the policy failed.
          MjrunError: a number is not finite, a camera is unknown, or OpenGL or the encoder failed.
        """
        with ExitStack() as stack:
            rollout = self._simulated(simulation, stack)
            folder = stack.enter_context(scratch_folder())
            videos, colors = self._videos(simulation, rollout, folder)
            task = self._spec.task or rollout.rows.task
            seed = simulation.seed if simulation.replay is None else None
            episode = replace(rollout.rows, task=task, seed=seed, infos=_infos(rollout), colors=colors)
            _require_finite(episode, self._spec, rollout)
            files = episode.files(videos)
            return rollout.steps[-1], tuple((f"{FOLDER}/{index:06}/{name}", content) for name, content in files)

    def _simulated(self, simulation: Simulation, stack: ExitStack) -> "EpisodeTrajectory":
        spec = self._spec
        if simulation.demonstration is not None:
            return demonstrated(simulation, spec, stack)
        if simulation.policy is None:
            return recorded(simulation, spec.probe or PROBES, Fraction(spec.fps), stack)
        if self._episode is None:
            self._episode = simulation.episode
        assert self._episode
        self._episode = self._episode.of_seed(simulation.seed)
        return acted(self._episode, spec.probe, spec.every, stack)

    def _videos(
        self, simulation: Simulation, rollout: "EpisodeTrajectory", folder: Path
    ) -> tuple[dict[str, bytes], dict[str, np.ndarray]]:
        """Returns the video of each camera, and how often each value of each channel occurs in its images."""
        spec = self._spec
        if not spec.cameras:
            return {}, {}
        if self._images is None:
            os.environ.setdefault("LP_NUM_THREADS", "1")  # of llvmpipe: the other cores have processes, too
            self._images = EpisodeImageRenderer(spec.view, spec.processes)
        colors = {name: np.zeros((3, VALUES), np.int64) for name in spec.cameras}
        size, fps, count = spec.view.size, Fraction(spec.fps), len(rollout.states)
        distance = max(1, min(size) // SAMPLED)
        timeline = Timeline.of_steps(rational(rollout.model.opt.timestep), rollout.steps[-1])
        frames = self._images.images(simulation.source, rollout.model, rollout.states, rollout.times, timeline)
        with ExitStack() as stack:
            writers = {
                name: stack.enter_context(VideoWriter(str(folder / f"{name}.mp4"), spec.encoding, size, fps, count))
                for name in spec.cameras
            }
            for images in frames:
                for (name, writer), image in zip(writers.items(), images, strict=True):
                    writer.write(image)
                    _count(image[::distance, ::distance], colors[name])
            return {name: _encoded(writer, count) for name, writer in writers.items()}, colors


@dataclass(frozen=True)
class EpisodeTrajectory:
    """The course of an episode of T rows.

    Attributes:
      model: the model of the episode.
      steps: the step of each row and of the end (T + 1); of a demonstration, the nearest ones.
      times: the simulated time of each row [s].
      states: the state of each row.
      last: the state at the end `(nstate,)`.
      rows: what was observed and done, without seed, infos and colours; the task is empty if it is unknown.
    """

    model: mujoco.MjModel
    steps: Sequence[int]
    times: Sequence[float]
    states: StateBuffer
    last: np.ndarray
    rows: EpisodeRows


def acted(episode: played.Episode, probe: Sequence[str], every: int, stack: ExitStack) -> EpisodeTrajectory:
    """Simulates an episode of a policy.

    Args:
      probe: the observed columns; empty for the observation of the policy.
      every: the number of control periods from one row to the next, whose rewards are added.
      stack: closes the states.

    Raises:
      SimulationError: the simulation became unstable, or the policy failed.
    """
    model, columns = episode.model(), episode.columns if probe else None
    timeline = Timeline.of_steps(rational(model.opt.timestep), episode.longest)
    sampler = ProbeSampler(model, probe, timeline, columns) if probe else None
    stepper = episode.stepper(sampler.model.opt.enableflags if sampler else 0)
    states = stack.enter_context(closing(StateBuffer(model)))
    steps, observations, actions, rewards = list[int](), list[np.ndarray](), list[np.ndarray](), list[float]()

    def observe_here() -> None:
        steps.append(stepper.step)
        observations.append(sampler.values(stepper) if sampler else stepper.now().observation)

    ending, periods = None, 0
    while ending is None:
        if periods % every == 0:
            observe_here()
            states.append(stepper.state())
            actions.append(stepper.now().action)
            rewards.append(0.0)
        stepper.advance(stepper.step + stepper.control_steps)
        periods += 1
        rewards[-1] += stepper.now().reward
        ending = stepper.now().ending or (TIMED_OUT if stepper.step >= episode.longest else None)
    if ending.name == UNSTABLE.name:
        stepper.advance(stepper.step + stepper.control_steps)  # which raises the error, with its joint
    observe_here()
    rows = EpisodeRows(
        "",
        None,
        np.array(observations),
        np.array(actions),
        np.array(rewards),
        terminated=ending.terminated,
        truncated=not ending.terminated,
        success=ending.kind == "success",
    )
    return EpisodeTrajectory(model, steps, _times(timeline, steps[:-1]), states, stepper.state(), rows)


def recorded(simulation: Simulation, probe: Sequence[str], fps: Fraction, stack: ExitStack) -> EpisodeTrajectory:
    """Simulates or replays without a policy; actions are the controls, and there are no rewards.

    Args:
      probe: the observed columns.
      fps: rows per second of simulated time.
      stack: closes the states.

    Raises:
      SimulationError: the simulation became unstable.
      UsageError: it has no length.
    """
    model = simulation.load()
    timeline = final_timeline(simulation, model)
    rows = timeline.frame_steps(fps)
    if not rows:
        raise UsageError(f"{clean(simulation.source.text)}: an episode of 0 s has no rows")
    sampler = ProbeSampler(model, probe, timeline)
    states, controls = stack.enter_context(closing(StateBuffer(model))), state.controls(model)
    steps, observations, actions = [*rows, timeline.steps], list[np.ndarray](), list[np.ndarray]()

    def record(stepper: Stepper) -> None:
        observations.append(sampler.values(stepper))
        row = stepper.state()
        if len(states) < len(rows):
            states.append(row)
            actions.append(row[controls])
        else:
            last.append(row)

    last = list[np.ndarray]()
    run_with_taps(simulation.stepper(sampler.model), [Tap(steps, record)], timeline.steps)
    episode = EpisodeRows("", None, np.array(observations), np.array(actions), np.zeros(len(rows)), truncated=True)
    return EpisodeTrajectory(model, steps, _times(timeline, rows), states, last[0], episode)


def demonstrated(simulation: Simulation, spec: EpisodeSpec, stack: ExitStack) -> EpisodeTrajectory:
    """Replays a demonstration, of which each state is a row with its action.

    A demonstration has no state after the last action: the last state is observed twice.

    Args:
      stack: closes the states.

    Raises:
      UsageError: the demonstration has other columns than the dataset, or another rate.
      FileError: it cannot be read.
    """
    demonstration = simulation.demonstration
    assert demonstration
    model = simulation.load()
    timeline = simulation.timeline(model)
    motion = simulation.replayed(model)
    assert isinstance(motion, KinematicMotion)
    sampler = ProbeSampler(model, spec.probe or PROBES, timeline)
    _require_alike(demonstration, sampler, spec)
    states = stack.enter_context(closing(StateBuffer(model)))
    observations = list[np.ndarray]()

    def record(stepper: Stepper) -> None:
        observations.append(sampler.values(stepper))
        states.append(stepper.state())

    samples = motion.samples  # not the steps, between which a state may be
    stepper = ReplayStepper(sampler.model, samples, simulated=False)
    run_with_taps(stepper, [Tap(samples.steps, record)], samples.steps[-1])
    steps = [min(step, timeline.steps) for step in demonstration.steps(timeline.timestep)]
    rewards = demonstration.rewards
    episode = EpisodeRows(
        demonstration.task,
        None,
        np.array([*observations, observations[-1]]),
        demonstration.actions,
        np.zeros(len(steps)) if rewards is None else rewards,
        terminated=bool(demonstration.success),
        truncated=not demonstration.success,
        success=bool(demonstration.success),
    )
    times = demonstration.times.tolist()
    return EpisodeTrajectory(model, [*steps, steps[-1]], times, states, states.state(len(states) - 1), episode)


def _times(timeline: Timeline, steps: Sequence[int]) -> list[float]:
    return [float(timeline.time(step)) for step in steps]


def _require_alike(demonstration: DemonstratedEpisode, sampler: ProbeSampler, spec: EpisodeSpec) -> None:
    """Raises UsageError if a demonstration does not fit a dataset, which begins with another one."""
    source, fps = clean(demonstration.source), Fraction(spec.fps)
    observed = sampler.names[1:]  # after the time
    if tuple(observed) != spec.observed:
        differing = sorted({*observed} ^ {*spec.observed})
        raise UsageError(
            f"{source} has another model than the first demonstration: {listing(differing)}\n"
            f"{option('probe')} selects values that all of them have"
        )
    if tuple(demonstration.action_names) != spec.acted:
        counts = f"{len(demonstration.action_names)} numbers, not {len(spec.acted)}"
        raise UsageError(f"{source} has actions of {counts} as the first demonstration")
    if abs(demonstration.rate - fps) > NEARLY * fps:
        raise UsageError(f"{source} has {float(demonstration.rate):g} states per second, not {float(fps):g}")


def observed_columns(
    simulation: Simulation, model: mujoco.MjModel, probe: Sequence[str]
) -> tuple[list[Column], list[Column]]:
    """Returns the columns of an observation and of an action.

    Raises:
      UnknownNameError: a probe is unknown.
    """
    episode, demonstration = simulation.episode, simulation.demonstration
    columns = selected_columns(model, probe or ([OBSERVATION] if episode else PROBES), episode and episode.columns)
    if episode is None:
        names = control_names(model) if demonstration is None else demonstration.action_names
        return columns, [Column(name) for name in names]
    if not probe:
        columns = [replace(column, name=column.name.removeprefix(f"{OBSERVATION}/")) for column in columns]
    return columns, [Column(name) for name in episode.actions.names]


def _encoded(writer: VideoWriter, count: int) -> bytes:
    """Returns the video of a writer, which is not published."""
    writer.end()
    path = Path(writer.destination.path)
    if (found := len(read_samples(path))) != count:
        raise EncoderError(f"the encoder wrote {found} frames, expected {count}")
    return path.read_bytes()


def _count(image: np.ndarray, colors: np.ndarray) -> None:
    """Adds how often each value of each channel occurs in an image to `colors` `(3, 256)`."""
    for channel, counts in enumerate(colors):
        counts += np.bincount(image[..., channel].ravel(), minlength=VALUES)


def _infos(rollout: EpisodeTrajectory) -> dict[str, np.ndarray]:
    """Returns the positions and velocities at each observation."""
    slices = state.fields(state.sizes(rollout.model))
    rows = [*(rollout.states[k] for k in range(len(rollout.states))), rollout.last]
    return {name: np.array([row[slices[name]] for row in rows]) for name in ("qpos", "qvel")}


def _require_finite(episode: EpisodeRows, spec: EpisodeSpec, rollout: EpisodeTrajectory) -> None:
    """Raises InvalidEpisodeError if a number is not finite in the dataset: its readers could not train with it."""
    named = {"observation": spec.observed, "action": spec.acted, "reward": ("",)}
    for (what, names), rows in zip(
        named.items(), (episode.observations, episode.actions, episode.rewards), strict=True
    ):
        numbers = rows.reshape(len(rows), -1)
        with np.errstate(over="ignore"):
            bad = np.argwhere(~np.isfinite(numbers.astype(spec.precision)))
        if len(bad):
            row, column = map(int, bad[0])
            step = rollout.steps[row]
            reason = "is too large for 32 bits" if np.isfinite(numbers[row, column]) else "is not finite"
            raise InvalidEpisodeError(step, step * rollout.model.opt.timestep, what, names[column], row, reason)


class EpisodeImageRenderer:
    """A renderer of the images of episodes. To be used in one thread, and closed.

    Args:
      options: the cameras, and what they show.
      processes: the number of processes that render an episode; 1 renders in this process.

    Raises:
      NoRendererError: no backend works.
    """

    def __init__(self, options: ViewOptions, processes: int) -> None:
        self._options, self._jobs = options, processes
        self._backend = BackendDetector(options.gl).result(require_gpu=options.require_gpu)
        self._processes = CompositorProcesses(processes) if processes > 1 else None
        self._model: mujoco.MjModel | None = None  # the last one
        self._staged: _StagedModel | None = None  # the one drawn for it
        self._compositor: SceneCompositor | None = None  # the last one, whose renderer is open

    def images(
        self,
        source: ModelSource,
        model: mujoco.MjModel,
        states: StateBuffer,
        times: Sequence[float],
        timeline: Timeline,
    ) -> Iterator[Sequence[np.ndarray]]:
        """Yields the image of each camera in each state, `(h, w, 3)` uint8, valid until the next.

        Args:
          model: the model of the episode, which must not be changed before the last image.
          states, times: the states, and their simulated times [s].
          timeline: the timeline of the episode.

        Raises:
          UsageError: a camera is unknown, or does not fit.
          DrawError: OpenGL failed.
        """
        options = self._options
        check_drawing(options, model, self._backend)
        drawn, is_framed = self._model_to_draw(source, model, states)
        motions = camera_motions(options.camera, options.size, model, is_framed=is_framed)
        poses = list[Iterator[CameraPose]]()
        for motion in motions:
            spans = [(float(start), float(end)) for start, end in shot_spans(motion.script, timeline, {})]
            motion.aim_at_motion(iter(states), times, spans)
            poses.append(motion.poses(iter(states), times, times, spans))
        specs = [
            FrameSpec([CameraPanel(index, "rgb")], options.size, FrameComposition()) for index in range(len(motions))
        ]
        compositor = scene_compositor(options, drawn, self._backend, specs, CameraPoseArray(poses))
        for flat in self._flat_frames(compositor, states):
            yield compositor.parts(flat)

    def close(self) -> None:
        """Frees the driver's resources, and ends the processes."""
        if self._compositor:
            self._compositor.close()
        if self._processes:
            self._processes.close()
        self._compositor = self._processes = None

    def _flat_frames(self, compositor: SceneCompositor, states: StateBuffer) -> Iterator[np.ndarray]:
        count = len(states)
        if self._processes:
            pool = CompositorPool(compositor, (compositor.bytes,), self._jobs, workers=self._processes)
            with closing(pool):
                yield from pool.frames(iter(states))
            return
        previous, self._compositor = self._compositor, compositor
        if previous:
            compositor.continue_from(previous)
        compositor.open()
        frame = np.empty(compositor.bytes, np.uint8)
        for index in range(count):
            compositor.compose(states[index], index, frame)
            yield frame

    def _model_to_draw(
        self, source: ModelSource, model: mujoco.MjModel, states: StateBuffer
    ) -> tuple[mujoco.MjModel, bool]:
        """Returns the model on its stage, and whether a camera frames it closely; episodes with one model share it."""
        if self._staged is None or self._model is not model:
            drawn, _, is_framed = drawn_model(self._options, model, source)
            self._model, self._staged = model, _StagedModel(drawn, is_framed, drawn.body_pos.copy())
        staged = self._staged
        if staged.model is not model:
            staged.model.body_pos[:] = staged.positions  # so that no episode depends on the one before
            place_stage(staged.model, iter(states))
        return staged.model, staged.is_framed


@dataclass(frozen=True, eq=False)
class _StagedModel:
    """A model that is drawn.

    Attributes:
      is_framed: true if the default camera frames it closely.
      positions: positions of its bodies, before the floor is placed.
    """

    model: mujoco.MjModel
    is_framed: bool
    positions: np.ndarray
