"""The scene of an output at the instants of its frames: cameras, decorations, the drawn model, and recorded states.

While the simulation runs, the state of every frame is saved; what the frames show is computed from the states.
"""

import pkgutil
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from importlib import import_module
from typing import Protocol, TypeVar

import mujoco
import numpy as np

from mjrun.camera.pose import PoseArray
from mjrun.camera.script import CameraScript, Event, parse_camera
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

# Schedules frames from the scripts of the cameras, the timeline and the steps of events; raises UsageError if an event
# does not happen or the schedule is impossible.
Scheduler = Callable[[Sequence[CameraScript], Timeline, EventSteps], FrameSchedule]
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
      scheduler: schedules the frames once the events are known.
      schedule: the schedule of the frames; None if events decide.
    """

    context: Context
    motions: Sequence[CameraMotion]
    decorations: Sequence[PlannedDecoration]
    drawn_model: mujoco.MjModel
    is_bare: bool
    conditions: Sequence[str]
    scheduler: Scheduler
    schedule: FrameSchedule | None


def plan_scene(
    job: SceneJob[OutputResult], context: Context, scheduler: Scheduler, cameras: Sequence[object] | None = None
) -> ScenePlan:
    """Resolves every name in the model and schedules the frames unless events decide.

    Args:
      scheduler: schedules the frames, at once unless events decide.
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
    scripts = [motion.script for motion in motions]
    events = {**shot_events(scripts), **job.events}
    awaited = conditions(events, model, context.episode) if events else ()
    schedule = None if awaited else scheduler(scripts, context.timeline, {})
    if schedule:
        _warn(schedule, context)
    return ScenePlan(
        context=context,
        motions=motions,
        decorations=planned_decorations(job, model, context.simulation),
        drawn_model=drawn,
        is_bare=bool(remark) and not job.is_measured,
        conditions=awaited,
        scheduler=scheduler,
        schedule=schedule,
    )


def _warn(schedule: FrameSchedule, context: Context) -> None:
    """Warns about shots that are not shown."""
    for text in schedule.warnings:
        context.reporter.warn(text)


class RecordedFrames:
    """The states of all frames, recorded during the simulation, and the scene that is placed for them afterwards.

    Attributes:
      states: the state of each frame, after the simulation.
      schedule: the schedule of the frames, once the simulation begins.
      model: the model that is drawn; its stage is in place after `place_scene`.
      times: the simulated time of each frame [s], after `place_scene`.
      poses: the poses of every camera for each frame, after `place_scene`.
    """

    schedule: FrameSchedule
    times: Sequence[float]
    poses: PoseArray

    def __init__(self, plan: ScenePlan, stack: ExitStack) -> None:
        model = plan.context.model
        self._scene, self._reporter, self.model = plan, plan.context.reporter, plan.drawn_model
        self.states = stack.enter_context(closing(StateBuffer(model)))
        self._decoration_states = [stack.enter_context(closing(StateBuffer(model))) for _ in plan.decorations]

    def taps(self, event_steps: EventSteps) -> Sequence[AnyTap]:
        """Returns the taps that record the states of frames and of decorations."""
        plan = self._scene
        if plan.schedule:
            self.schedule = plan.schedule
        else:
            scripts = [motion.script for motion in plan.motions]
            self.schedule = plan.scheduler(scripts, plan.context.timeline, event_steps)
            _warn(self.schedule, plan.context)
        taps: list[AnyTap] = [Tap(self.schedule.steps, lambda stepper: stepper.state(), self.states.append)]
        for decoration, states in zip(plan.decorations, self._decoration_states, strict=True):
            taps.append(Tap(decoration.steps(self.schedule.observed), lambda stepper: stepper.state(), states.append))
        return taps

    def place_scene(self) -> None:
        """Places the stage and the cameras for the frames that were recorded: fewer if the simulation became unstable.

        Raises:
          UsageError: a camera coincides at some time with the point that it looks at.
        """
        made, count, context = self.schedule, len(self.states), self._scene.context
        if count < len(made.steps):
            self.schedule = replace(
                made, steps=made.steps[:count], times=made.times[:count], speeds=made.speeds[:count]
            )
        self.times = array("d", (float(context.timeline.time(step)) for step in self.schedule.steps))
        if self.model is not context.model:
            place_stage(self.model, self.states[0])
        if self._scene.is_bare and (remark := ground_remark(self.model, self.states[0])):
            self._reporter.note(remark)
        self.poses = self._camera_poses()

    def decorations(self) -> list[Decoration]:
        """Returns the decorations of all frames."""
        made = list[Decoration]()
        for decoration, states in zip(self._scene.decorations, self._decoration_states, strict=True):
            made += decoration.drawn(iter(states), self.times)
        return made

    def _camera_poses(self) -> PoseArray:
        """Moves the cameras that frame their subject, and returns the poses of all cameras."""
        motions, spans_of = self._scene.motions, self.schedule.spans
        for motion, spans in zip(motions, spans_of, strict=True):
            for text in motion.frame_subject(iter(self.states), self.times, spans):
                self._reporter.note(text)
        return PoseArray(
            motion.poses(iter(self.states), self.times, self.schedule.times, spans)
            for motion, spans in zip(motions, spans_of, strict=True)
        )


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
