"""Run as a script in a child process: does this graphics library work, and what draws behind it?

A broken driver may hang, print or crash, so drivers are never tried in the process that needs one.
Prints one JSON object: for an OpenGL backend `renderer`, `vendor`, `version`, `max_size` [pixels]; for
`vulkan` its `devices`; or `error`.
"""

import ctypes
import ctypes.util
import importlib
import json
import os
import sys

LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa", "vulkan": "vulkan"}
DEVICE_NAME = slice(20, 276)  # in VkPhysicalDeviceProperties, which is smaller than PROPERTIES
PROPERTIES = 1024  # bytes


class InstanceInfo(ctypes.Structure):
    """VkInstanceCreateInfo of an instance without layers and extensions."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application", ctypes.c_void_p),
        ("layer_count", ctypes.c_uint32),
        ("layers", ctypes.c_void_p),
        ("extension_count", ctypes.c_uint32),
        ("extensions", ctypes.c_void_p),
    )


def vulkan() -> dict[str, list[str] | str]:
    """The names of the Vulkan devices."""
    library = ctypes.CDLL("libvulkan.so.1")
    instance, count = ctypes.c_void_p(), ctypes.c_uint32()
    info = InstanceInfo(type=1)  # VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO
    code = library.vkCreateInstance(ctypes.byref(info), None, ctypes.byref(instance))
    if code:
        return {"error": f"no driver works (vkCreateInstance: {code})"}
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    names = []
    for device in devices:
        properties = ctypes.create_string_buffer(PROPERTIES)
        library.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), properties)
        names.append(properties.raw[DEVICE_NAME].partition(b"\0")[0].decode(errors="replace"))
    return {"devices": names} if names else {"error": "no device"}


def opengl(name: str) -> dict[str, str | int]:
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
        answer = vulkan() if sys.argv[1] == "vulkan" else opengl(sys.argv[1])
    except BaseException as error:  # a probe reports whatever happens
        answer = {"error": reason(sys.argv[1], error)}
    json.dump(answer, out)
    out.close()
