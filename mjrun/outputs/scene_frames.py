"""The scene of an output at the instants of its frames: cameras, decorations, the drawn model, and recorded states.

While the simulation runs, the state of every frame is saved; what the frames show is computed from the states.
"""

import pkgutil
from abc import abstractmethod
from array import array
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from typing import Protocol, TypeVar

import mujoco
import numpy as np

from mjrun.camera.argument import parse_camera
from mjrun.camera.pose import PoseArray
from mjrun.camera.script import CameraScript, Event
from mjrun.camera.script_poses import CameraMotion
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UsageError, concerning, option
from mjrun.options.option import is_given, options, options_of
from mjrun.options.rendering import SceneOptions
from mjrun.outputs import decorations
from mjrun.outputs.decorations.ghost import ghost_files
from mjrun.outputs.event_detection import conditions
from mjrun.outputs.frame_schedule import FrameSchedule, shot_events
from mjrun.outputs.output import Context, EventSteps, Job, OutputResult
from mjrun.physics.recorded_states import StateBuffer
from mjrun.physics.simulation_loop import AnyTap, Tap
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.drawn_model import drawn_model, ground_remark, place_stage
from mjrun.rendering.visual import visual_of
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

R_co = TypeVar("R_co", bound=OutputResult, covariant=True)


@options
class SceneJob(SceneOptions, Job[R_co]):
    """A requested output that shows the scene at the instants of frames."""

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """The camera scripts, and the files that ghosts follow."""
        scripts = [camera.file for camera in self.camera if isinstance(camera, CameraScript) and camera.file]
        return [*(("camera script", file) for file in scripts), *ghost_files(self)]

    @property
    def events(self) -> Mapping[OptionPath, Event]:
        """Events that the output waits for in addition to those of shots, keyed by option path."""
        return {}

    @property
    def is_measured(self) -> bool:
        """True if the frames measure what exists, and must not show what the simulation lacks unless requested."""
        return False

    @abstractmethod
    def schedule(self, context: Context, scripts: Sequence[CameraScript], event_steps: EventSteps) -> FrameSchedule:
        """Schedules the frames.

        Args:
          scripts: the script of each camera.

        Raises:
          UsageError: an event does not happen, or the schedule is impossible.
        """


class PlannedDecoration(Protocol):
    """Decorations of one option, with every name resolved in the model."""

    @property
    def remarks(self) -> Sequence[str]:
        """Remarks for the user."""
        ...

    def steps(self, timeline: Timeline) -> Sequence[int]:
        """Returns the steps of the observed simulation whose states it needs."""
        ...

    def drawn(self, states: Iterable[np.ndarray], times: Sequence[float]) -> Sequence[Decoration]:
        """Returns the decorations of frames at `times` [s], given the states at `steps`."""
        ...


def planned_decorations(
    options: SceneOptions, model: mujoco.MjModel, simulation: Simulation | None = None
) -> list[PlannedDecoration]:
    """Plans the decorations in `options`, in the order in which the options are declared.

    Args:
      simulation: specifies how tables are read; if None, their columns have mjrun's names.

    Raises:
      UnknownNameError: an object, keyframe or setting is unknown.
      UsageError: a setting is invalid, or a trace lacks positions.
      FileError: a trace cannot be read.
    """
    known = {module.name for module in pkgutil.iter_modules(decorations.__path__)}
    names = [each.name for each in options_of(type(options)) if each.name in known and is_given(options, each.name)]
    modules = [import_module(f"{decorations.__name__}.{name}") for name in names]
    return [module.planned(options, model, simulation or Simulation(model)) for module in modules]


@dataclass(frozen=True)
class ScenePlan:
    """The scene of all frames, with every name resolved in the model.

    Attributes:
      motions: the motion of each camera.
      decorations: trails, ghosts and the like.
      drawn_model: the model that is drawn.
      is_bare: whether it has a stage that the user has not requested.
      conditions: the conditions of the events that the schedule depends on.
      schedule: the schedule of the frames; None if events decide.
    """

    job: SceneJob[OutputResult]
    context: Context
    motions: Sequence[CameraMotion]
    decorations: Sequence[PlannedDecoration]
    drawn_model: mujoco.MjModel
    is_bare: bool
    conditions: Sequence[str]
    schedule: FrameSchedule | None


def _scheduled(
    job: SceneJob[OutputResult], context: Context, motions: Sequence[CameraMotion], event_steps: EventSteps
) -> FrameSchedule:
    """Schedules the frames, given the onsets of each condition, and warns about shots that are not shown."""
    made = job.schedule(context, [motion.script for motion in motions], event_steps)
    for text in made.warnings:
        context.reporter.warn(text)
    return made


def plan_scene(job: SceneJob[OutputResult], context: Context, cameras: Sequence[object] | None = None) -> ScenePlan:
    """Resolves every name in the model and schedules the frames unless events decide.

    Args:
      cameras: the cameras; by default, those of the job.

    Raises:
      UsageError: a name is unknown, or a value invalid.
    """
    model = context.model
    shown, source = job.camera if cameras is None else cameras, context.simulation.source
    drawn, remark, is_framed = drawn_model(job, model, source, shown, is_measured=job.is_measured)
    if remark:
        context.reporter.note(remark)
    with source.named_in_errors():
        motions = camera_motions(shown, job.size, model, is_framed=is_framed)
    events = {**shot_events([motion.script for motion in motions]), **job.events}
    awaited = conditions(events, model, context.episode) if events else ()
    return ScenePlan(
        job=job,
        context=context,
        motions=motions,
        decorations=planned_decorations(job, model, context.simulation),
        drawn_model=drawn,
        is_bare=bool(remark) and not job.is_measured,
        conditions=awaited,
        schedule=None if awaited else _scheduled(job, context, motions, {}),
    )


class RecordedFrames:
    """The states of all frames, recorded during the simulation, and the poses of the cameras.

    Attributes:
      states: the state of each frame, after the simulation.
      schedule: the schedule of the frames, once the simulation begins.
    """

    schedule: FrameSchedule

    def __init__(self, plan: ScenePlan, stack: ExitStack) -> None:
        model = plan.context.model
        self._scene, self._reporter = plan, plan.context.reporter
        self.states = stack.enter_context(closing(StateBuffer(model)))
        self._decoration_states = [stack.enter_context(closing(StateBuffer(model))) for _ in plan.decorations]

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        """Returns the taps that record the states of frames and of decorations."""
        plan = self._scene
        self.schedule = plan.schedule or _scheduled(plan.job, plan.context, plan.motions, event_steps)
        taps: list[AnyTap] = [Tap(self.schedule.steps, lambda stepper: stepper.state(), self.states.append)]
        for decoration, states in zip(plan.decorations, self._decoration_states, strict=True):
            taps.append(Tap(decoration.steps(self.schedule.observed), lambda stepper: stepper.state(), states.append))
        return taps

    def keep_recorded(self) -> None:
        """Shortens the schedule to the frames that were recorded, fewer if the simulation became unstable."""
        made, count = self.schedule, len(self.states)
        if count < len(made.steps):
            self.schedule = replace(
                made, steps=made.steps[:count], times=made.times[:count], speeds=made.speeds[:count]
            )

    @cached_property
    def times(self) -> Sequence[float]:
        """The simulated time of each frame [s]."""
        return array("d", (float(self._scene.context.timeline.time(step)) for step in self.schedule.steps))

    @cached_property
    def poses(self) -> PoseArray:
        """The poses of every camera for each frame.

        Raises:
          UsageError: a camera coincides at some time with the point that it looks at.
        """
        motions, spans_of = self._scene.motions, self.schedule.spans
        for motion, spans in zip(motions, spans_of, strict=True):
            for text in motion.frame_subject(iter(self.states), self.times, spans):
                self._reporter.note(text)
        cameras = (
            motion.poses(iter(self.states), self.times, self.schedule.times, spans)
            for motion, spans in zip(motions, spans_of, strict=True)
        )
        return PoseArray(cameras)

    @cached_property
    def drawn_model(self) -> mujoco.MjModel:
        """The model that is drawn, with its stage in place."""
        model, context = self._scene.drawn_model, self._scene.context
        if model is not context.model:
            place_stage(model, self.states[0])
        if self._scene.is_bare and (remark := ground_remark(model, self.states[0])):
            self._reporter.note(remark)
        return model

    @property
    def decorations(self) -> list[Decoration]:
        """The decorations of all frames."""
        made = list[Decoration]()
        for decoration, states in zip(self._scene.decorations, self._decoration_states, strict=True):
            made += decoration.drawn(iter(states), self.times)
        return made


def check_scene(options: SceneOptions) -> None:
    """Checks everything about the scene that does not depend on the model.

    Raises:
      UsageError: MuJoCo has no such name, a camera is repeated, or a stage is invalid.
    """
    visual_of(options)
    if len(options.stage) > 1 and {"auto", "none"} & {*options.stage}:
        raise BadValueError(
            option("stage"), ", ".join(options.stage), "auto, none, or parts: floor, light, sky, camera"
        )
    check_once("camera", options.camera)


def check_once(name: str, values: Sequence[object]) -> None:
    """Raises UsageError if a value of an option is repeated."""
    if any(value in values[:index] for index, value in enumerate(values)):
        raise UsageError(f"{option(name)}: give at least one, and each only once")


def camera_motions(
    cameras: Sequence[object], size: tuple[int, int], model: mujoco.MjModel, *, is_framed: bool = False
) -> list[CameraMotion]:
    """Returns the motion of each camera.

    Args:
      size: width and height of the images [pixels].
      is_framed: whether the default camera frames the model closely.

    Raises:
      UsageError: a name is not in the model, or a value is invalid.
    """
    motions: list[CameraMotion] = []
    for index, camera in enumerate(cameras):
        with concerning("camera", index):
            described = camera if isinstance(camera, CameraScript) else parse_camera(str(camera), model)
            described.check()
            motions.append(CameraMotion(described, model, size, is_framed=is_framed))
    return motions
