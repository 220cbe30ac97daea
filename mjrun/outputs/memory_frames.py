"""Videos whose frames stay in memory."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mjrun.formats.atomic_output import OutputWriter
from mjrun.model.mujoco_globals import collected_warnings, without_timers
from mjrun.options.option import options
from mjrun.outputs import output
from mjrun.outputs.frame_output import plan_frames
from mjrun.outputs.perform import Pass
from mjrun.outputs.video import DrawnFrames, Video
from mjrun.reporter import WarningReporter, pass_on


@options
class VideoInMemory(Video):
    """A video whose frames stay in memory."""

    @property
    def files(self) -> list[tuple[str, str]]:
        return []

    def plan(self, context: output.Context) -> output.Plan[Any]:
        """Resolves every name in the model and schedules the frames unless events decide."""
        drawn = plan_frames(self, context, self.plot, self.plot_side)
        preview = output.Preview("video", self.output, None, "frames", self.size)
        opened = partial(FramesInMemory, self, drawn)
        return output.Plan(preview, context.timeline.steps, opened, drawn.enable_flags, drawn.conditions)


class FramesInMemory(DrawnFrames[output.OutputResult]):
    """The frames of a video, without a file."""

    def __init__(self, job: Video, *planned: Any) -> None:
        super().__init__(job, *planned)
        self.start_drawing()

    def finish(self) -> Sequence[OutputWriter]:
        return []

    def result(self, files: Sequence[Path], summary: output.PassSummary) -> output.OutputResult:
        raise NotImplementedError

    def arrays(self) -> Iterator[np.ndarray]:
        """Draws the frames after the simulation."""
        return (parts[0] for parts in self.parts())

    def parts(self) -> Generator[list[np.ndarray]]:
        """Draws the frames after the simulation, and yields the image of each file."""
        for parts in self.drawn(self.compositor()):
            yield [part.copy() for part in parts]


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
        (frames,) = current.outputs
        assert isinstance(frames, FramesInMemory)
        yield from frames.arrays()
