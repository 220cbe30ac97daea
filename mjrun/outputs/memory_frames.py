"""Videos whose frames stay in memory."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.formats.atomic_output import OutputWriter
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.options.option import options
from mjrun.outputs import output
from mjrun.outputs.drawn_frames import DrawnFrames, FramePlan, plan_frames
from mjrun.outputs.frame_schedule import video_schedule
from mjrun.outputs.perform import Pass
from mjrun.outputs.video import Video
from mjrun.physics.simulation_loop import AnyTap
from mjrun.reporter import WarningReporter, pass_on


@options
class VideoInMemory(Video):
    """A video whose frames stay in memory."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return []

    def plan(self, context: output.Context) -> output.Plan[Any]:
        """Resolves every name in the model and schedules the frames unless events decide."""
        scheduler = partial(video_schedule, fps=self.rate, speed=self.speed)
        drawn = plan_frames(self, context, scheduler, self.plot, self.plot_side)
        preview = output.Preview("video", self.output, None, "frames", self.size)
        open_frames = partial(MemoryOutput, self, drawn)
        return output.Plan(preview, context.timeline.steps, open_frames, drawn.enable_flags, drawn.scene.conditions)


class MemoryOutput(output.Output[output.OutputResult]):
    """The frames of a video, without a file. They are drawn one by one, when they are requested.

    Attributes:
      frames: the frames.
    """

    def __init__(self, job: Video, plan: FramePlan, stack: ExitStack, renderers: output.BackendsAndWorkers) -> None:
        self.frames = DrawnFrames(plan, job.encoded_files, stack, renderers, job.jobs)

    def taps(self, event_steps: output.EventSteps) -> Sequence[AnyTap]:
        return self.frames.taps(event_steps)

    def written(self) -> Sequence[OutputWriter]:
        return []

    def result(self, files: Sequence[Path], simulation_wall: float) -> output.OutputResult:
        raise NotImplementedError


def drawn_frames(video: VideoInMemory) -> Generator[np.ndarray]:
    """Simulates when the first frame is asked for, and yields the frames, which belong to the caller.

    Raises:
      MjrunError: as `Video.run`.
    """
    reporter = WarningReporter()
    with ExitStack() as stack:
        with collected_warnings() as warnings, without_timers():
            current = Pass([video], reporter, stack)
            current.simulate()
        if error := current.error():
            raise error
        pass_on(warnings, reporter)
        (made,) = current.outputs
        assert isinstance(made, MemoryOutput)
        made.frames.place_scene()
        for parts in made.frames.images(made.frames.compositor()):
            yield parts[0].copy()
