"""What the outputs of one pass share to draw with: the detection of a backend, and worker processes.

Rendering is imported only once something is drawn: a trace alone starts without it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjrun.closable import Closable

if TYPE_CHECKING:
    from mjrun.options.view import ViewOptions
    from mjrun.rendering.backend import Backend
    from mjrun.rendering.backend_detection import BackendDetection, VulkanDetection
    from mjrun.rendering.workers import PainterProcesses


@dataclass(frozen=True)
class RendererRequest:
    """A renderer, as options ask for it: `classic` by an OpenGL backend, or `filament` by Vulkan."""

    renderer: str
    gl: str | None
    require_gpu: bool

    @classmethod
    def of(cls, options: "ViewOptions") -> "RendererRequest":
        """What `options` ask for."""
        return cls(options.renderer, None if options.renderer == "filament" else options.gl, options.require_gpu)

    def detection(self) -> "BackendDetection | VulkanDetection":
        """Starts to try what can draw."""
        from mjrun.rendering.backend_detection import BackendDetection, VulkanDetection

        return VulkanDetection() if self.renderer == "filament" else BackendDetection(self.gl)


class SharedRendering(Closable):
    """Detects each backend once and starts each worker process once, for all outputs of a pass. To be closed."""

    def __init__(self) -> None:
        self._detections: dict[RendererRequest, BackendDetection | VulkanDetection] = {}
        self._backends: dict[RendererRequest, Backend] = {}
        self._workers: PainterProcesses | None = None

    def detect(self, choice: RendererRequest) -> None:
        """Starts the detection in a child process, so that it runs while the model loads.

        Raises:
          UnknownNameError: no such backend.
          NoRendererError: rendering is switched off by MUJOCO_GL.
        """
        if choice not in self._detections:
            self._detections[choice] = choice.detection()

    def backend(self, choice: RendererRequest) -> "Backend":
        """The backend that was detected.

        Raises:
          RendererError: there is none.
        """
        if choice not in self._backends:
            self.detect(choice)
            self._backends[choice] = self._detections[choice].result(choice.require_gpu)
        return self._backends[choice]

    def workers(self, count: int) -> "PainterProcesses":
        """At least `count` processes that draw, started without waiting for them.

        Raises:
          DrawError: they cannot be started.
        """
        from mjrun.rendering.compositor import SceneCompositor
        from mjrun.rendering.workers import PainterProcesses

        if self._workers is None:
            self._workers = PainterProcesses(count, SceneCompositor.__module__)
        else:
            self._workers.grow(count)
        return self._workers

    def close(self) -> None:
        """Ends the workers, and detections that are still running."""
        if self._workers:
            self._workers.close()
        for detection in self._detections.values():
            detection.cancel()
