"""Images of many episodes, one after the other: what each camera sees in recorded states."""

from collections.abc import Iterator, Sequence
from contextlib import closing

import mujoco
import numpy as np

from mjrun.camera.pose import Pose, PoseArray
from mjrun.dataclass import dataclass
from mjrun.model.source import Source
from mjrun.options.rendering import ViewOptions
from mjrun.outputs.drawn_frames import check_drawing, scene_compositor
from mjrun.outputs.frame_schedule import shot_spans
from mjrun.outputs.recorded_scene import camera_motions
from mjrun.physics.recorded_states import StateBuffer
from mjrun.rendering.backend import BackendDetection
from mjrun.rendering.compositor import CameraPanel, FrameStream, FrameStyle, SceneCompositor
from mjrun.rendering.compositor_pool import CompositorPool, CompositorProcesses
from mjrun.rendering.drawn_model import drawn_model, place_stage
from mjrun.timeline import Timeline


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
        self._backend = BackendDetection(options.gl).result(require_gpu=options.require_gpu)
        self._processes = CompositorProcesses(processes) if processes > 1 else None
        self._model: mujoco.MjModel | None = None  # the last one
        self._staged: _StagedModel | None = None  # the one drawn for it
        self._compositor: SceneCompositor | None = None  # the last one, whose renderer is open

    def images(
        self, source: Source, model: mujoco.MjModel, states: StateBuffer, times: Sequence[float], timeline: Timeline
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
        drawn, is_framed = self._model_to_draw(source, model, states[0])
        motions = camera_motions(options.camera, options.size, model, is_framed=is_framed)
        poses = list[Iterator[Pose]]()
        for motion in motions:
            spans = [(float(start), float(end)) for start, end in shot_spans(motion.script, timeline, {})]
            motion.frame_subject(iter(states), times, spans)
            poses.append(motion.poses(iter(states), times, times, spans))
        streams = [
            FrameStream([CameraPanel(index, "rgb")], options.size, FrameStyle()) for index in range(len(motions))
        ]
        compositor = scene_compositor(options, drawn, self._backend, streams, PoseArray(poses))
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

    def _model_to_draw(self, source: Source, model: mujoco.MjModel, start: np.ndarray) -> tuple[mujoco.MjModel, bool]:
        """Returns the model on its stage, and whether a camera frames it closely; episodes with one model share it."""
        if self._staged is None or self._model is not model:
            drawn, _, is_framed = drawn_model(self._options, model, source)
            self._model, self._staged = model, _StagedModel(drawn, is_framed, drawn.body_pos.copy())
        staged = self._staged
        if staged.model is not model:
            staged.model.body_pos[:] = staged.positions  # so that no episode depends on the one before
            place_stage(staged.model, start)
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
