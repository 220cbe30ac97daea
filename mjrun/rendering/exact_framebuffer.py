"""A framebuffer for images of ids and depth: one sample per pixel, and depth in 32 bits.

MuJoCo's own has as many samples as the model requests for colours, which take time and are useless here.
"""

from typing import Any

import mujoco
import numpy as np

from mjrun.errors import DrawError


class ExactFramebuffer:
    """A framebuffer for one image in the current OpenGL context. To be used in the thread of that context, and freed.

    Args:
      size: width and height [pixels].

    Raises:
      DrawError: OpenGL refused.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        from OpenGL import GL  # which looks for its platform when it is imported

        self._gl: Any = GL
        width, height = size
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._colors, self._depth = np.empty((height, width, 3), np.uint8), np.empty((height, width), np.float32)
        self._frame = GL.glGenFramebuffers(1)
        self._parts = GL.glGenRenderbuffers(2)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._frame)
        kinds = ((GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8), (GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT32F))
        for part, (place, kind) in zip(self._parts, kinds, strict=True):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, part)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, kind, width, height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, place, GL.GL_RENDERBUFFER, part)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise DrawError(f"OpenGL has no framebuffer of {width}x{height} with a depth of 32 bits")

    def draw(self, scene: mujoco.MjvScene, context: mujoco.MjrContext) -> tuple[np.ndarray, np.ndarray]:
        """Draws `scene`, whose flags ask for ids as colours.

        Returns:
          Colours `(h, w, 3)` uint8, and OpenGL's depth `(h, w)` float32, 1 near and 0 far, as MuJoCo reverses it. Both
          are reused by the next call.
        """
        self._bind()
        mujoco.mjr_render(self._rect, scene, context)
        self._bind()  # a shadow map may have come between
        place = (0, 0, self._rect.width, self._rect.height)
        self._gl.glPixelStorei(self._gl.GL_PACK_ALIGNMENT, 1)
        self._gl.glReadPixels(*place, self._gl.GL_RGB, self._gl.GL_UNSIGNED_BYTE, self._colors)
        self._gl.glReadPixels(*place, self._gl.GL_DEPTH_COMPONENT, self._gl.GL_FLOAT, self._depth)
        mujoco.mjr_restoreBuffer(context)
        return self._colors[::-1], self._depth[::-1]  # OpenGL's rows run upward

    def free(self) -> None:
        """Frees the resources of the graphics driver."""
        self._gl.glDeleteFramebuffers(1, [self._frame])
        self._gl.glDeleteRenderbuffers(2, self._parts)

    def _bind(self) -> None:
        self._gl.glBindFramebuffer(self._gl.GL_FRAMEBUFFER, self._frame)
        self._gl.glDrawBuffer(self._gl.GL_COLOR_ATTACHMENT0)
        self._gl.glReadBuffer(self._gl.GL_COLOR_ATTACHMENT0)
