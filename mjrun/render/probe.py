"""Run as a script in a child process: does this OpenGL backend work, and what draws behind it?

A broken driver may hang, print or crash, so backends are never tried in the process that needs one.
Prints one JSON object: `renderer`, `vendor`, `version`, `max_size` [pixels], or `error`.
"""

import ctypes.util
import importlib
import json
import os
import sys

LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}


def describe(name: str) -> dict[str, str | int]:
    """Makes a context of the backend `name` and asks OpenGL who draws."""
    context = importlib.import_module(f"mujoco.{name}").GLContext(64, 64)
    try:
        context.make_current()
        from OpenGL import GL

        def text(what: int) -> str:
            return (GL.glGetString(what) or b"").decode(errors="replace")

        if not text(GL.GL_RENDERER):
            return {"error": "made no OpenGL context (it needs a display)"}
        return {
            "renderer": text(GL.GL_RENDERER),
            "vendor": text(GL.GL_VENDOR),
            "version": text(GL.GL_VERSION),
            "max_size": int(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE)),
        }
    finally:
        context.free()


def reason(name: str, error: BaseException) -> str:
    """Why the backend `name` does not work; a missing library shows up as any kind of error."""
    library = LIBRARIES.get(name)
    if library and not ctypes.util.find_library(library):
        return f"lib{library} is not installed"
    return f"{type(error).__name__}: {error}".splitlines()[0]


if __name__ == "__main__":
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # drivers print to stdout
    try:
        answer = describe(sys.argv[1])
    except BaseException as error:  # a probe reports whatever happens
        answer = {"error": reason(sys.argv[1], error)}
    json.dump(answer, out)
    out.close()
