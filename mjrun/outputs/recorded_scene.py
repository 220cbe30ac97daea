"""The scene of an output at the instants of its frames: cameras, decorations, the drawn model, and recorded states.

A schedule sets when each shot begins and ends, and which instant each frame shows. While the simulation runs, the state
of every frame is saved; what the frames show is computed from the states.
"""

import math
import pkgutil
from array import array
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from importlib import import_module
from itertools import repeat
from typing import Protocol

import mujoco
import numpy as np

from mjrun.camera.pose import CameraPoseArray
from mjrun.camera.script import CameraScript, ConditionEvent, parse_camera
from mjrun.camera.script_poses import BoundCameraScript
from mjrun.camera.targets import GhostMotion
from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, OptionPath, UsageError, clean, concerning, option
from mjrun.options.option import is_given, options, options_of
from mjrun.options.rendering import SceneOptions
from mjrun.outputs import decorations
from mjrun.outputs.decorations.ghost import ghost_files
from mjrun.outputs.event_detection import conditions, time_of
from mjrun.outputs.output import OutputRequest, OutputResult, PassContext, R_co
from mjrun.physics.simulation_loop import StateBuffer, Tap
from mjrun.rendering.added_geoms import Decoration, Ghost
from mjrun.rendering.drawn_model import drawn_model, ground_remark, place_stage, visual_remark
from mjrun.rendering.visual import visual_of
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

Span = tuple[Fraction, Fraction]
MOST_FRAMES = 2_000_000  # 18 hours at 30 frames per second; a schedule takes 100 bytes per frame


@dataclass(frozen=True)
class FrameSchedule:
    """The schedule of a video's frames; an image is a video of one frame.

    Attributes:
      steps: the step of each frame.
      times: the time of each frame in the video [s].
      speeds: simulated seconds per second of video, for each frame.
      spans: simulated start and end of each shot [s], for each camera.
      observed: the part of the simulation that trails show.
      warnings: warnings for the user.
    """

    steps: Sequence[int]
    times: Sequence[float]
    speeds: Sequence[float]
    spans: Sequence[Sequence[tuple[float, float]]]
    observed: Timeline
    warnings: Sequence[str] = ()


def video_schedule(
    scripts: Sequence[CameraScript],
    timeline: Timeline,
    event_steps: Mapping[str, Sequence[int]],
    *,
    fps: Fraction,
    speed: Fraction,
) -> FrameSchedule:
    """Schedules the frames of a video with the shots of all cameras.

    Args:
      event_steps: the steps at which each condition becomes true.
      speed: the speed of shots without one.

    Raises:
      UsageError: an event does not happen, a shot ends before it begins, cameras require different speeds, or the
        video exceeds `MOST_FRAMES`.
    """
    spans = [shot_spans(script, timeline, event_steps) for script in scripts]
    pieces = _pieces(scripts, spans, timeline.duration, speed)
    _check_count(fps, pieces)
    steps = timeline.paced(fps, pieces)
    # Arrays, as a video may have a hundred thousand frames.
    speeds = array("d", (float(pace) for part, (_, pace) in zip(steps, pieces, strict=True) for _ in part))
    return FrameSchedule(
        steps=array("q", (step for part in steps for step in part)),
        times=array("d", (float(k / fps) for k in range(len(speeds)))),
        speeds=speeds,
        spans=_seconds(spans),
        observed=timeline,
        warnings=[text for part in map(_unseen, scripts, spans, repeat(timeline.duration)) for text in part],
    )


def image_schedule(
    scripts: Sequence[CameraScript], timeline: Timeline, event_steps: Mapping[str, Sequence[int]], *, step: int
) -> FrameSchedule:
    """Schedules the single frame of an image, at `step`.

    Raises:
      UsageError: an event does not happen, or a shot ends before it begins.
    """
    spans = [shot_spans(script, timeline, event_steps) for script in scripts]
    observed = Timeline.of_steps(timeline.timestep, step)
    return FrameSchedule([step], [float(timeline.time(step))], [1.0], _seconds(spans), observed)


def shot_events(scripts: Sequence[CameraScript]) -> dict[OptionPath, ConditionEvent]:
    """Returns the events that end shots, keyed by the option paths of their conditions."""
    return {
        ("camera", i, "shots", j, "until", "when"): shot.until
        for i, script in enumerate(scripts)
        for j, shot in enumerate(script.shots)
        if isinstance(shot.until, ConditionEvent)
    }


def shot_spans(script: CameraScript, timeline: Timeline, event_steps: Mapping[str, Sequence[int]]) -> list[Span]:
    """Returns start and end of each shot [s]; the last may end before or after the simulation."""
    spans: list[Span] = []
    start = Fraction(0)
    for index, shot in enumerate(script.shots):
        where = f"{clean(script.name)}: shots[{index}]"
        if isinstance(shot.until, ConditionEvent):
            after = start if index else Fraction(-1)  # the event that ended the previous shot cannot end this one too
            end = time_of(shot.until, event_steps.get(shot.until.when, ()), timeline, where, after)
        elif shot.until is not None:
            end = shot.until
        else:
            end = max(start, timeline.duration) if shot.lasting is None else start + shot.lasting
        if end < start:
            raise UsageError(f"{where} would end at {float(end):g} s, before it begins at {float(start):g} s")
        spans.append((start, end))
        start = end
    return spans


def _seconds(spans: Sequence[Sequence[Span]]) -> list[list[tuple[float, float]]]:
    return [[(float(start), float(end)) for start, end in part] for part in spans]


def _unseen(script: CameraScript, spans: Sequence[Span], duration: Fraction) -> list[str]:
    """Returns the warning that the simulation ends before some shots begin."""
    late = [index for index, (start, _) in enumerate(spans) if start >= duration and start > 0]
    if not late:
        return []
    which = f"shots[{late[0]}]" + (" and later are" if len(late) > 1 else " is")
    return [f"{clean(script.name)}: {which} not seen: the simulation ends at {float(duration):g} s"]


def _pieces(
    scripts: Sequence[CameraScript], spans: Sequence[Sequence[Span]], duration: Fraction, speed: Fraction
) -> list[tuple[Fraction, Fraction]]:
    """Returns the stretches of the video: the simulated end of each [s], and its speed."""
    paced = [index for index, script in enumerate(scripts) if any(shot.speed for shot in script.shots)]
    if len({tuple(_stretches(scripts[i], spans[i], duration, speed)) for i in paced}) > 1:
        raise UsageError("the camera scripts set different speeds at the same time; a video has only one speed")
    if paced:
        return _stretches(scripts[paced[0]], spans[paced[0]], duration, speed)
    return [(min(duration, max(part[-1][1] for part in spans)), speed)]


def _check_count(fps: Fraction, pieces: Sequence[tuple[Fraction, Fraction]]) -> None:
    """Raises UsageError if the pieces of a video have too many frames in total."""
    starts = [Fraction(0), *(end for end, _ in pieces)]
    lengths = [(end - start) / pace for start, (end, pace) in zip(starts, pieces, strict=False)]
    count = math.ceil(sum(lengths) * fps)
    if count <= MOST_FRAMES:
        return
    slowest = pieces[lengths.index(max(lengths))][1]
    raise UsageError(
        f"{option('speed')} {_rounded(slowest)} at {option('fps')} {_rounded(fps)} makes "
        f"{_rounded(count)} frames; the maximum is {MOST_FRAMES:,}\n"
        f"set a higher speed, fewer frames per second or a shorter {option('duration')}"
    )


def _rounded(number: Fraction | int) -> str:
    """Formats a number of any size for a message."""
    return f"{Decimal(number.numerator) / Decimal(number.denominator):.4g}"


def _stretches(
    script: CameraScript, spans: Sequence[Span], duration: Fraction, speed: Fraction
) -> list[tuple[Fraction, Fraction]]:
    return [(min(end, duration), shot.speed or speed) for shot, (_, end) in zip(script.shots, spans, strict=True)]


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
    decorations = list[Decoration]()
    for decoration, buffer in zip(plan.decorations, states.decorations, strict=True):
        decorations += decoration.drawn(iter(buffer), times)
    ghosts = [GhostMotion(each.states, each.offset) for each in decorations if isinstance(each, Ghost)]
    if model is not context.model:
        place_stage(model, iter(frames), ghosts)
    if plan.is_bare and (remark := ground_remark(model, frames[0])):
        context.reporter.note(remark)

    for motion, spans in zip(plan.motions, schedule.spans, strict=True):
        for text in motion.aim_at_motion(iter(frames), times, spans, ghosts):
            context.reporter.note(text)
    poses = CameraPoseArray(  # computed now, one camera after the other
        motion.poses(iter(frames), times, schedule.times, spans)
        for motion, spans in zip(plan.motions, schedule.spans, strict=True)
    )
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
