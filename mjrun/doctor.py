"""The diagnosis of `mjrun doctor`: the state of all components, and how to fix those that fail."""

import importlib.metadata
import importlib.util
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mjrun import errors
from mjrun.confinement.confinement import CHECKS
from mjrun.confinement.self_confinement import means
from mjrun.dataclass import dataclass
from mjrun.diff import images_and_videos
from mjrun.formats.ffmpeg import encoder_version, working_codecs
from mjrun.formats.tables import FORMATS
from mjrun.model.source import bugs_of_version
from mjrun.model.sources import model_collections
from mjrun.options import check, datasets, evaluation, fit, sweep, task
from mjrun.outputs import exports
from mjrun.packages import installed_wrong, require
from mjrun.physics import warp_device
from mjrun.platform import system
from mjrun.platform.cores import available_cores
from mjrun.platform.installation import install_command, pip
from mjrun.plotting import figure_writer
from mjrun.rendering import backend
from mjrun.version import __version__

OK, WARNING, MISSING = "ok", "warning", "missing"
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
STUDIO, WEBSOCKETS = "mujoco-studio", "websockets"  # a dependency of mujoco-studio


@dataclass(frozen=True)
class ComponentState:
    """The state of one component that mjrun uses.

    Attributes:
      group, name: the group and the name of the component.
      status: `ok`, `warning` or `missing`.
      value: its version, or why it does not work.
      remedy: how to fix it, or an empty text.
    """

    group: str
    name: str
    status: str
    value: str
    remedy: str = ""


@dataclass(frozen=True)
class DoctorReport:
    """The report of `mjrun doctor`: the state of all components.

    Attributes:
      findings: the state of each component.
      can_draw: true if the backend requested by the environment can render, or any backend if none is requested.
      can_encode: true if videos can be encoded.
    """

    findings: Sequence[ComponentState]
    can_draw: bool
    can_encode: bool


def examine(spelling: errors.Spelling = str) -> DoctorReport:
    """Tests all components, including backends and drivers, in child processes.

    Args:
      spelling: spells the names of options in remedies.
    """
    trials = {name: backend.BackendTrialProcess(name, draw=True) for name in ("egl", "osmesa", "glfw", "vulkan")}
    if platform.system() == "Darwin":
        trials["cgl"] = backend.BackendTrialProcess("cgl", draw=True)
    devices = backend.BackendTrialProcess("devices").answer().get("devices", [])
    encoder = _encoder()

    backends = {name: trial.result() for name, trial in trials.items() if name != "vulkan"}
    opengl = _opengl(backends)
    filament = _filament(trials["vulkan"].result(), opengl.used)

    views = [_window(backends["glfw"]), _studio()]
    findings = [
        *_versions(),
        *_extras(),
        *_collections(),
        *opengl.findings,
        *_devices(devices),
        filament,
        *views,
        *encoder,
        *_untrusted(),
    ]
    return DoctorReport(
        [replace(finding, remedy=errors.spelled(finding.remedy, spelling)) for finding in findings],
        can_draw=bool(opengl.used) or (filament.status == OK and not opengl.variables),
        can_encode=any(finding.name == "codecs" for finding in encoder),
    )


def _versions() -> list[ComponentState]:
    version = mujoco.mj_versionString()
    known = bugs_of_version(version)
    system = f"{platform.system()} {platform.machine()}, {errors.counted(available_cores(), 'core')}"
    versions = [
        ComponentState("software", "mujoco", WARNING if known else OK, version, "; ".join(known)),
        ComponentState("software", "numpy", OK, np.__version__),
    ]
    wrong = {error.package: _wrong_version("software", error.package, MISSING, error) for error in installed_wrong()}
    return [
        ComponentState("software", "mjrun", OK, __version__),
        ComponentState("software", "python", OK, f"{platform.python_version()} ({sys.executable})"),
        ComponentState("software", "system", OK, system),
        *(each for each in versions if each.name not in wrong),
        *wrong.values(),
    ]


def _wrong_version(group: str, name: str, status: str, error: errors.WrongVersionError) -> ComponentState:
    value = f"{error.package} {error.version}; mjrun needs {error.needed}"
    return ComponentState(group, name, status, value, error.remedy.replace("\n", "; "))


def extras() -> dict[str, tuple[Sequence[str], list[str]]]:
    """Returns the extras of mjrun: the libraries that each installs, and the features that need them."""
    extras: dict[str, tuple[Sequence[str], list[str]]] = {}
    for table in FORMATS.values():
        if table.extra:
            extras.setdefault(table.extra, ([table.library], []))[1].extend(table.suffixes)
    extras[figure_writer.EXTRA] = ([figure_writer.LIBRARY], ["plots"])
    rooms = (check, sweep, datasets, fit, evaluation, task)
    declared = {name: facts for room in rooms for name, facts in room.EXTRAS.items()}
    return {
        **extras,
        **{extra: (libraries, [use]) for extra, (libraries, use) in declared.items()},
        **{each.extra: (each.libraries, [*each.suffixes]) for each in exports.FORMATS.values() if each.extra},
        images_and_videos.EXTRA: ([images_and_videos.LIBRARY], [errors.option("min_ssim")]),
        warp_device.EXTRA: (warp_device.LIBRARIES, [f"{errors.option('engine')} warp"]),
    }


def _extras() -> list[ComponentState]:
    findings = list[ComponentState]()
    for extra, (libraries, uses) in extras().items():
        try:
            versions = require(", ".join(uses), extra, *libraries)
        except errors.MissingExtraError as error:
            remedy = f"for {', '.join(uses)}: {install_command(f'mjrun[{extra}]')}"
            findings.append(ComponentState("extras", extra, WARNING, f"{error.library} is not installed", remedy))
        except errors.WrongVersionError as error:
            findings.append(_wrong_version("extras", extra, WARNING, error))
        else:
            value = ", ".join(f"{package} {version}" for package, version in versions.items())
            findings.append(ComponentState("extras", extra, OK, value))
    return findings


def _collections() -> list[ComponentState]:
    """Yields the state of the collections of models, such as `scene:` and `menagerie:`."""
    findings = list[ComponentState]()
    for prefix, collection in sorted(model_collections().items()):
        try:
            count = len(collection.descriptions())
        except (errors.ModelError, errors.MissingExtraError) as error:
            message, _, advice = str(error).partition("\n")
            remedy = f"not needed; {advice}" if advice else "not needed"
            findings.append(ComponentState("models", prefix, MISSING, message.removeprefix(f"{prefix}: "), remedy))
        else:
            value = f"{errors.counted(count, collection.KIND)}: mjrun info {prefix}:"
            findings.append(ComponentState("models", prefix, OK, value))
    return findings


@dataclass(frozen=True)
class _OpenGL:
    """The OpenGL backends: the one in use, if any, and the environment variables that request one."""

    findings: Sequence[ComponentState]
    used: str | None
    variables: Mapping[str, str]


def _opengl(results: Mapping[str, backend.WorkingBackend | str]) -> _OpenGL:
    """Yields the state of the tested backends, and the one that mjrun would use."""
    variables = {name: os.environ[name] for name in (backend.GL, backend.DEVICE) if os.environ.get(name)}
    names, error = _requested()
    if names == backend.candidates():
        variables.pop(backend.GL, None)
    used = next((name for name in names if isinstance(results.get(name), backend.WorkingBackend)), None)
    failed = (
        []
        if used
        else [ComponentState("opengl", "used", MISSING, error or _nothing(variables), backend.alternative(names))]
    )
    return _OpenGL([*failed, *_backends(results, used, default=backend.GL not in variables)], used, variables)


def _requested() -> tuple[Sequence[str], str]:
    """Returns the backends that mjrun would try; or an empty list, and the reason."""
    try:
        return backend.requested_backends(), ""
    except errors.NoRendererError as error:
        return (), f"nothing: {backend.GL} {error.tried[backend.GL]}"
    except errors.UnknownNameError as error:
        return (), f"nothing: {str(error).splitlines()[0]}"


def _nothing(variables: Mapping[str, str]) -> str:
    settings = " and ".join(f"{variable}={value}" for variable, value in variables.items())
    return f"nothing draws with {settings or 'OpenGL'}"


def _backends(
    results: Mapping[str, backend.WorkingBackend | str], used: str | None, default: bool
) -> list[ComponentState]:
    findings = list[ComponentState]()
    for name, result in results.items():
        if isinstance(result, backend.WorkingBackend):
            kind = "software" if result.software else "GPU"
            mark = "" if name != used else ", used by default" if default else f", used by {backend.GL}"
            findings.append(ComponentState("opengl", name, OK, f"{result.renderer} ({kind}{mark}), {result.version}"))
        else:
            advice = (
                f"not needed; {backend.repair_advice(name)}" if used else backend.repair_advice(name)
            )  # one is enough
            findings.append(ComponentState("opengl", name, MISSING, result, advice))
    return findings


def _devices(devices: Sequence[Mapping[str, Any]]) -> list[ComponentState]:
    """Yields the EGL devices, each tested. MuJoCo uses the numbering of CUDA if the driver reports it."""
    numbers = [device["index"] if device["cuda"] is None else device["cuda"] for device in devices]
    trials = [backend.BackendTrialProcess("egl", draw=True, device=number) for number in numbers]
    findings = list[ComponentState]()
    for device, number, trial in zip(devices, numbers, trials, strict=True):
        result, cuda = trial.result(), "" if device["cuda"] is None else f", CUDA device {device['cuda']}"
        where = f"MUJOCO_EGL_DEVICE_ID={number}{cuda}" + (f", {device['file']}" if device["file"] else "")
        name = f"device {device['index']}"
        if isinstance(result, backend.WorkingBackend):
            findings.append(ComponentState("egl devices", name, OK, f"{result.renderer} ({where})"))
        else:
            findings.append(
                ComponentState("egl devices", name, MISSING, f"{result} ({where})", "not needed; choose another")
            )
    return findings


def _filament(vulkan: backend.WorkingBackend | str, used: str | None) -> ComponentState:
    renderer = f"{errors.option('renderer')} filament"
    if isinstance(vulkan, str):
        advice = backend.install_advice(backend.VULKAN)
        if not importlib.util.find_spec("mujoco.studio"):
            advice = install_command(STUDIO)
        remedy = f"not needed except for {renderer}; {advice}"
        return ComponentState("vulkan", "filament", MISSING, vulkan, remedy)
    kind = "software" if vulkan.software else "GPU"
    remedy = "" if used else f"{renderer} draws, the default renderer does not"
    return ComponentState("vulkan", "filament", OK, f"{vulkan.renderer} ({kind}, Vulkan {vulkan.version})", remedy)


def _window(glfw: backend.WorkingBackend | str) -> ComponentState:
    """Returns whether `mjrun view` can open a window, which requires GLFW."""
    if isinstance(glfw, backend.WorkingBackend):
        return ComponentState("view", "window", OK, f"{glfw.renderer} draws on this display")
    displays = [f"{name}={os.environ[name]}" for name in DISPLAYS if os.environ.get(name)]
    where = (
        f"{' and '.join(displays)} cannot be used: {glfw}" if displays else f"neither {' nor '.join(DISPLAYS)} is set"
    )
    return ComponentState(
        "view", "window", MISSING, where, "not needed; mjrun view serves a page for a browser instead"
    )


def _studio() -> ComponentState:
    """Returns whether `mjrun view` can serve a page."""
    if importlib.util.find_spec("mujoco.studio") and importlib.util.find_spec(WEBSOCKETS):
        return ComponentState("view", "browser", OK, f"MuJoCo Studio {importlib.metadata.version(STUDIO)}")
    return ComponentState("view", "browser", MISSING, f"{STUDIO} is not installed", install_command(STUDIO))


def _untrusted() -> list[ComponentState]:
    """Returns the mechanisms that confine untrusted models from other files and the network."""
    if not system.CAN_FORK:
        remedy = f"this system refuses {errors.option('untrusted')}; run mjrun on Linux, or in a container"
        return [ComponentState("untrusted", name, WARNING, "not confined", remedy) for name in ("files", "network")]
    files, network = means()
    kernel = (
        f"{errors.option('untrusted')} checks paths; Linux 5.13 or later, with Landlock, confines the process itself"
    )
    confined = ComponentState(
        "untrusted", "files", WARNING if files == CHECKS else OK, files, kernel * (files == CHECKS)
    )
    if network:
        return [confined, ComponentState("untrusted", "network", OK, network)]
    remedy = f"{errors.option('untrusted')} leaves it the network; run it in a container that has none"
    return [confined, ComponentState("untrusted", "network", WARNING, "not confined", remedy)]


def _encoder() -> list[ComponentState]:
    try:
        version = encoder_version()
    except errors.EncoderError as error:
        remedy = f"{pip('install')} --force-reinstall imageio-ffmpeg"
        what, *details = (line.strip() for line in str(error).splitlines())
        return [ComponentState("encoder", "ffmpeg", MISSING, ": ".join([what, *details[:1]]), remedy)]
    codecs = working_codecs()
    working = [codec for codec, works in codecs.items() if works]
    failing = [codec for codec, works in codecs.items() if not works]
    findings = [
        ComponentState("encoder", "ffmpeg", OK, version),
        ComponentState("encoder", "codecs", OK, ", ".join(working)),
    ]
    if failing:
        findings.append(
            ComponentState("encoder", "not here", MISSING, ", ".join(failing), f"use another {errors.option('codec')}")
        )
    return findings
