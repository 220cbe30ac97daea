"""Schedules of shots and frames: when each shot begins and ends, and which instant each frame shows."""

import math
from array import array
from collections.abc import Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from itertools import repeat

from mjrun.camera.script import CameraScript, ConditionEvent
from mjrun.dataclass import dataclass
from mjrun.errors import OptionPath, UsageError, clean, option
from mjrun.outputs.event_detection import time_of
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
