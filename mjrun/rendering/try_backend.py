"""A script or module, run in a child process, that tests a graphics library and reports its renderer.

A broken driver may hang, print or crash, so drivers are never tried in the main process.
Prints one JSON object: `renderer`, `vendor`, `version`, `max_size` [pixels]; or `error`. With `draw` an image is
rendered and checked. `vulkan` always does so, using MuJoCo's Filament, its only user here, whose log must go to a
file on stderr. `devices` prints the devices that EGL knows, under `devices`.
"""

import ctypes
import ctypes.util
import importlib
import importlib.util
import json
import os
import re
import sys
import types
from typing import NoReturn

LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "GL", "vulkan": "vulkan"}
# Fields of VkPhysicalDeviceProperties, which is smaller than PROPERTIES.
API_VERSION, DEVICE_NAME, LARGEST_IMAGE = slice(0, 4), slice(20, 276), slice(300, 304)
PROPERTIES = 1024  # bytes
SIDE = 16  # [pixels]
BALL = "<mujoco><worldbody><geom size='.5'/></worldbody></mujoco>"
DRM_DEVICE_FILE = 0x3233  # of EGL_EXT_device_drm
VENDOR, RENDERER, VERSION, MAX_RENDERBUFFER_SIZE = 0x1F00, 0x1F01, 0x1F02, 0x84E8  # of OpenGL


class _VulkanInstanceInfo(ctypes.Structure):
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


def vulkan() -> dict[str, str | int]:
    """Renders a ball with Filament, and queries Vulkan about the device that Filament has chosen."""
    library, instance = ctypes.CDLL("libvulkan.so.1"), ctypes.c_void_p()
    info = _VulkanInstanceInfo(type=1)  # VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO
    code = library.vkCreateInstance(ctypes.byref(info), None, ctypes.byref(instance))
    if code:
        return {"error": f"no driver works (vkCreateInstance: {code})"}
    known = devices(library, instance)
    if not known:
        return {"error": "no device"}
    if not ball_is_seen():
        return {"error": "Filament drew nothing"}
    messages = os.pread(2, 2**16, 0).decode(errors="replace")
    chosen = re.search(r"Selected physical device '(.*?)' from", messages)
    driver = re.search(r"Vulkan device driver: (.*)", messages)
    name = chosen[1] if chosen and chosen[1] in known else next(iter(known))
    return {"renderer": name, "vendor": driver[1].strip() if driver else "", **known[name]}


def devices(library: ctypes.CDLL, instance: ctypes.c_void_p) -> dict[str, dict[str, str | int]]:
    """Returns the Vulkan version and the maximum image size, by name of the device."""
    count = ctypes.c_uint32()
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    handles = (ctypes.c_void_p * count.value)()
    library.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles)
    by_name: dict[str, dict[str, str | int]] = {}
    for handle in handles:
        properties = ctypes.create_string_buffer(PROPERTIES)
        library.vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), properties)
        name = properties.raw[DEVICE_NAME].partition(b"\0")[0].decode(errors="replace")
        version = int.from_bytes(properties.raw[API_VERSION], sys.byteorder)
        by_name[name] = {
            "version": f"{version >> 22}.{version >> 12 & 0x3FF}.{version & 0xFFF}",
            "max_size": int.from_bytes(properties.raw[LARGEST_IMAGE], sys.byteorder),
        }
    return by_name


def ball_is_seen() -> bool:
    """Returns whether Filament renders the ball, in the middle and nowhere else."""
    import mujoco
    import numpy as np

    importlib.import_module("mujoco.studio")  # registers the materials
    mjrf = importlib.import_module("mujoco.mjrf")
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    context = mjrf.Context(mjrf.ContextConfig(graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN))
    resources = mjrf.ModelResources(context, model)
    scene = context.create_scene(mjrf.SceneParams())
    scene.configure_from_model(model)
    lights, renderables = mjrf.ModelLights(scene, resources), mjrf.ModelRenderables(scene, resources)
    lights.update(data)
    renderables.update(data)
    formats, pixels = mjrf.PixelFormat, np.zeros((SIDE, SIDE, 3), np.uint8)
    target = context.create_render_target(
        mjrf.RenderTargetConfig(SIDE, SIDE, formats.PIXEL_FORMAT_RGB8, formats.PIXEL_FORMAT_DEPTH32F)
    )
    reading = mjrf.ReadRequest(target)
    reading.set_buffer(pixels)
    frustum = {"frustum_bottom": -0.1, "frustum_top": 0.1, "frustum_near": 0.2, "frustum_far": 10}
    view = mjrf.Camera([0, 0, 2], [0, 0, -1], [0, 1, 0], **frustum)
    request = mjrf.RenderRequest(scene, view, mjrf.Rect(0, 0, SIDE, SIDE), target)
    context.wait_for_frame(context.render([request], [reading]))
    return bool(pixels[SIDE // 2, SIDE // 2].max() > 20 > pixels[0, 0].max())  # noise is 1


def egl_devices() -> dict[str, list[dict[str, str | int | None]]]:
    """Returns every EGL device: its index, its CUDA index, and its file; None if the driver does not report one."""
    stand_in()
    egl = importlib.import_module("mujoco.egl.egl_ext")
    address = ctypes.cast(egl.eglGetProcAddress("eglQueryDeviceStringEXT"), ctypes.c_void_p).value or 0
    query = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int)(address)
    reports: list[dict[str, str | int | None]] = []
    for index, device in enumerate(egl.eglQueryDevicesEXT()):
        try:
            cuda = int(egl.eglQueryDeviceAttribEXT(device, egl.EGL_CUDA_DEVICE_NV))
        except Exception:  # the driver lacks the extension
            cuda = None
        file = query(ctypes.cast(device, ctypes.c_void_p), DRM_DEVICE_FILE)
        reports.append({"index": index, "cuda": cuda, "file": file.decode(errors="replace") if file else None})
    return {"devices": reports}


def frame_is_right() -> bool:
    """Returns whether MuJoCo renders the ball in the current context, in the middle and nowhere else."""
    import mujoco
    import numpy as np

    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene, context = mujoco.MjvScene(model, 10), mujoco.MjrContext(model, 50)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
    camera = mujoco.MjvCamera()
    camera.distance = 3
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, scene)
    pixels, rect = np.zeros((SIDE, SIDE, 3), np.uint8), mujoco.MjrRect(0, 0, SIDE, SIDE)
    mujoco.mjr_render(rect, scene, context)
    mujoco.mjr_readPixels(pixels, None, rect, context)
    context.free()
    return bool(pixels[SIDE // 2, SIDE // 2].max() > 20 > pixels[0, 0].max())


def opengl(name: str, draw: bool = False) -> dict[str, str | int]:
    """Creates a context of the backend `name`, queries the OpenGL renderer, and tests it with an image if requested."""
    if not draw:
        stand_in()
    context = importlib.import_module(f"mujoco.{name}").GLContext(64, 64)
    try:
        context.make_current()
        # The plain functions: the module OpenGL.GL takes as long to import as everything else here.
        gl = importlib.import_module("OpenGL.raw.GL.VERSION.GL_1_0")

        def text(what: int) -> str:
            return (ctypes.cast(gl.glGetString(what), ctypes.c_char_p).value or b"").decode(errors="replace")

        if not text(RENDERER):
            return {"error": "made no OpenGL context (it needs a display)"}
        if draw and not frame_is_right():
            return {"error": f"{text(RENDERER)} draws wrongly"}
        size = (ctypes.c_int * 1)()
        gl.glGetIntegerv(MAX_RENDERBUFFER_SIZE, size)
        return {"renderer": text(RENDERER), "vendor": text(VENDOR), "version": text(VERSION), "max_size": size[0]}
    finally:
        context.free()


def stand_in() -> None:
    """Lets the modules of MuJoCo's backends be imported without the rest of MuJoCo, which they do not use."""
    spec = importlib.util.find_spec("mujoco")
    package = types.ModuleType("mujoco")
    package.__path__ = list((spec and spec.submodule_search_locations) or ())
    sys.modules["mujoco"] = package


def reason(name: str, error: BaseException) -> str:
    """Returns the reason why the backend `name` does not work; a missing library may raise any kind of error."""
    library = LIBRARIES.get(name)
    if library and (name != "glfw" or sys.platform == "linux") and not ctypes.util.find_library(library):
        return f"lib{library} is not installed"
    return f"{type(error).__name__}: {error}".splitlines()[0]


def report(what: str, *, draw: bool = False) -> NoReturn:
    """Prints the answer about a backend, `vulkan` or `devices`, and ends this process."""
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # drivers print to stdout
    try:
        query = {"vulkan": vulkan, "devices": egl_devices}.get(what)
        answer = query() if query else opengl(what, draw)
    except BaseException as error:  # reported, whatever it is
        answer = {"error": reason(what, error)}
    json.dump(answer, out)
    out.close()
    os._exit(0)  # drivers may be slow to shut down, or crash


if __name__ == "__main__":
    report(sys.argv[1], draw="draw" in sys.argv[2:])
