"""The scene of an output at the instants of its frames: cameras, decorations, the drawn model, and recorded states.

While the simulation runs, the state of every frame is saved; what the frames show is computed from the states.
"""

import pkgutil
from array import array
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from importlib import import_module
from typing import Protocol

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPoseArray
from mjrun.camera.script import CameraScript, ConditionEvent, parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UsageError, concerning, option
from mjrun.options.option import is_given, options, options_of
from mjrun.options.rendering import SceneOptions
from mjrun.outputs import decorations
from mjrun.outputs.decorations.ghost import ghost_files
from mjrun.outputs.event_detection import conditions
from mjrun.outputs.frame_schedule import FrameSchedule, shot_events
from mjrun.outputs.output import OutputRequest, OutputResult, PassContext, R_co
from mjrun.physics.recorded_states import StateBuffer
from mjrun.physics.simulation_loop import Tap
from mjrun.rendering.added_geoms import Decoration
from mjrun.rendering.drawn_model import drawn_model, ground_remark, place_stage, visual_remark
from mjrun.rendering.visual import visual_of
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline


@options
class SceneOutputRequest(SceneOptions, OutputRequest[R_co]):
    """A requested output that shows the scene at the instants of frames."""

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """The camera scripts, and the files that ghosts follow."""
        scripts = [camera.file for camera in self.camera if isinstance(camera, CameraScript) and camera.file]
        return [*(("camera script", file) for file in scripts), *ghost_files(self)]


class PlannedDecorations(Protocol):
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
) -> list[PlannedDecorations]:
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
    """The plan of the scene of all frames, with every name resolved in the model.

    Attributes:
      motions: the motion of each camera.
      decorations: trails, ghosts and the like.
      drawn_model: the model that is drawn.
      is_bare: whether it has a stage that the user has not requested.
      conditions: the conditions of the events that the schedule of the frames depends on.
    """

    context: PassContext
    motions: Sequence[BoundCameraScript]
    decorations: Sequence[PlannedDecorations]
    drawn_model: mujoco.MjModel
    is_bare: bool
    conditions: Sequence[str]

    @property
    def scripts(self) -> list[CameraScript]:
        """The script of each camera."""
        return [motion.script for motion in self.motions]


def plan_scene(
    request: SceneOutputRequest[OutputResult],
    context: PassContext,
    cameras: Sequence[object],
    *,
    events: Mapping[OptionPath, ConditionEvent] | None = None,
    is_measured: bool = False,
) -> ScenePlan:
    """Resolves every name in the model.

    Args:
      events: events that the output waits for in addition to those of shots, keyed by option path.
      is_measured: the frames measure what exists, and must not show what the simulation lacks unless requested.

    Raises:
      UsageError: a name is unknown, or a value invalid.
    """
    model, source = context.model, context.simulation.source
    drawn, remark, is_framed = drawn_model(request, model, source, cameras, is_measured=is_measured)
    for text in filter(None, (remark, visual_remark(source))):
        context.reporter.note(text)
    with source.named_in_errors():
        motions = camera_motions(cameras, request.size, model, is_framed=is_framed)
    awaited = {**shot_events([motion.script for motion in motions]), **(events or {})}
    return ScenePlan(
        context=context,
        motions=motions,
        decorations=planned_decorations(request, model, context.simulation),
        drawn_model=drawn,
        is_bare=bool(remark) and not is_measured,
        conditions=conditions(awaited, model, context.episode) if awaited else (),
    )


@dataclass(frozen=True, eq=False)
class SceneStates:
    """The states that are recorded during a simulation.

    Attributes:
      frames: the state of each frame.
      decorations: the states that each decoration needs.
    """

    frames: StateBuffer
    decorations: Sequence[StateBuffer]


def open_states(plan: ScenePlan, stack: ExitStack) -> SceneStates:
    """Returns room for the states of a scene, which the stack frees."""
    frames, *others = (stack.enter_context(closing(StateBuffer(plan.context.model))) for _ in (0, *plan.decorations))
    return SceneStates(frames, others)


def state_taps(plan: ScenePlan, schedule: FrameSchedule, states: SceneStates) -> list[Tap]:
    """Returns the taps that record the states of frames and of decorations."""
    taps = [Tap(schedule.steps, states.frames.record)]
    for decoration, buffer in zip(plan.decorations, states.decorations, strict=True):
        taps.append(Tap(decoration.steps(schedule.observed), buffer.record))
    return taps


@dataclass(frozen=True, eq=False)
class RecordedScene:
    """The scene at the frames that were recorded.

    Attributes:
      model: the model that is drawn, with its stage in place.
      states: the state of each frame.
      schedule: the schedule of these frames: fewer than planned if the simulation became unstable.
      times: the simulated time of each frame [s].
      poses: the poses of every camera for each frame.
      decorations: the decorations of all frames.
    """

    model: mujoco.MjModel
    states: StateBuffer
    schedule: FrameSchedule
    times: Sequence[float]
    poses: CameraPoseArray
    decorations: Sequence[Decoration]


def place_scene(plan: ScenePlan, schedule: FrameSchedule, states: SceneStates) -> RecordedScene:
    """Places the stage, the cameras and the decorations for the frames that were recorded.

    Raises:
      UsageError: a camera coincides at some time with the point that it looks at.
    """
    model, context, frames, count = plan.drawn_model, plan.context, states.frames, len(states.frames)
    if count < len(schedule.steps):
        steps, moments, speeds = schedule.steps[:count], schedule.times[:count], schedule.speeds[:count]
        schedule = replace(schedule, steps=steps, times=moments, speeds=speeds)
    times = array("d", (float(context.timeline.time(step)) for step in schedule.steps))
    if model is not context.model:
        place_stage(model, frames[0])
    if plan.is_bare and (remark := ground_remark(model, frames[0])):
        context.reporter.note(remark)

    for motion, spans in zip(plan.motions, schedule.spans, strict=True):
        for text in motion.aim_at_motion(iter(frames), times, spans):
            context.reporter.note(text)
    poses = CameraPoseArray(  # computed now, one camera after the other
        motion.poses(iter(frames), times, schedule.times, spans)
        for motion, spans in zip(plan.motions, schedule.spans, strict=True)
    )
    decorations = list[Decoration]()
    for decoration, buffer in zip(plan.decorations, states.decorations, strict=True):
        decorations += decoration.drawn(iter(buffer), times)
    return RecordedScene(model, frames, schedule, times, poses, decorations)


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
) -> list[BoundCameraScript]:
    """Returns the motion of each camera.

    Args:
      size: width and height of the images [pixels].
      is_framed: whether the default camera frames the model closely.

    Raises:
      UsageError: a name is not in the model, or a value is invalid.
    """
    motions: list[BoundCameraScript] = []
    for index, camera in enumerate(cameras):
        with concerning("camera", index):
            described = camera if isinstance(camera, CameraScript) else parse_camera(str(camera), model)
            described.check()
            motions.append(BoundCameraScript(described, model, size, is_framed=is_framed))
    return motions
