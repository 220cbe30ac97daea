"""What works on this machine, and what to do about what does not."""

import importlib.metadata
import importlib.util
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from mjrun.errors import EncoderError, NoRendererError, UnknownNameError
from mjrun.formats.video import encoder_version, working_codecs
from mjrun.model import mujoco_bugs
from mjrun.rendering.backend import DEVICE, GL, Backend, candidates, requested_backends
from mjrun.rendering.backend_detection import BackendTrial, alternative, repair_advice
from mjrun.rendering.install_advice import VULKAN, install_advice
from mjrun.version import __version__

EXTRAS = {"parquet": "pyarrow", "mat": "scipy", "plot": "matplotlib", "warp": "mujoco_warp"}
OK, WARNING, MISSING = "ok", "warning", "missing"


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    Attributes:
      group, name: what it is.
      status: `ok`, `warning` or `missing`.
      value: what was found.
      remedy: what to do about it; empty when nothing.
    """

    group: str
    name: str
    status: str
    value: str
    remedy: str = ""


@dataclass(frozen=True)
class Examination:
    """All findings.

    Attributes:
      can_draw: whether what the environment asks for draws; where it asks for nothing, whether anything does.
      can_encode: whether films can be encoded.
    """

    findings: Sequence[Finding]
    can_draw: bool
    can_encode: bool


def examine() -> Examination:
    """Looks at everything mjrun needs; backends and drivers in child processes."""
    trials = {name: BackendTrial(name, draw=True) for name in ("egl", "osmesa", "glfw", "vulkan")}
    if platform.system() == "Darwin":
        trials["cgl"] = BackendTrial("cgl", draw=True)
    devices = BackendTrial("devices").answer().get("devices", [])
    encoder = _encoder()
    backends = {name: trial.result() for name, trial in trials.items() if name != "vulkan"}
    drawing = _drawing(backends)
    filament = _filament(trials["vulkan"].result(), drawing.used)
    findings = [*_versions(), *_extras(), *drawing.findings, *_devices(devices), filament, *encoder]
    return Examination(
        findings,
        can_draw=bool(drawing.used) or (filament.status == OK and not drawing.asked),
        can_encode=any(finding.name == "codecs" for finding in encoder),
    )


def _versions() -> list[Finding]:
    version = mujoco.mj_versionString()
    known = mujoco_bugs.of_version(version)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    system = f"{platform.system()} {platform.machine()}, {cores} cores"
    return [
        Finding("software", "mjrun", OK, __version__),
        Finding("software", "python", OK, f"{platform.python_version()} ({sys.executable})"),
        Finding("software", "system", OK, system),
        Finding("software", "mujoco", WARNING if known else OK, version, "; ".join(known)),
        Finding("software", "numpy", OK, np.__version__),
    ]


def _extras() -> list[Finding]:
    findings = []
    for extra, package in EXTRAS.items():
        if importlib.util.find_spec(package):
            findings.append(Finding("extras", extra, OK, f"{package} {importlib.metadata.version(package)}"))
        else:
            what = f"{package} is not installed"
            findings.append(Finding("extras", extra, WARNING, what, f"pip install 'mjrun[{extra}]'"))
    return findings


@dataclass(frozen=True)
class _Drawing:
    """What OpenGL does here: which backend mjrun uses, and what the environment asks for."""

    findings: Sequence[Finding]
    used: str | None
    asked: Mapping[str, str]


def _drawing(found: Mapping[str, Backend | str]) -> _Drawing:
    """What a search of mjrun would find, with each backend."""
    asked = {variable: os.environ[variable] for variable in (GL, DEVICE) if os.environ.get(variable)}
    names, fault = _sought()
    if names == candidates():
        asked.pop(GL, None)
    used = next((name for name in names if isinstance(found.get(name), Backend)), None)
    failed = [] if used else [Finding("opengl", "used", MISSING, fault or _nothing(asked), alternative(names))]
    return _Drawing([*failed, *_backends(found, used, default=GL not in asked)], used, asked)


def _sought() -> tuple[Sequence[str], str]:
    """The backends that are tried; or none, and why."""
    try:
        return requested_backends(), ""
    except NoRendererError as error:
        return (), f"nothing: {GL} {error.tried[GL]}"
    except UnknownNameError as error:
        return (), f"nothing: {str(error).splitlines()[0]}"


def _nothing(asked: Mapping[str, str]) -> str:
    told = " and ".join(f"{variable}={value}" for variable, value in asked.items())
    return f"nothing draws with {told}" if told else "nothing draws with OpenGL"


def _backends(found: Mapping[str, Backend | str], used: str | None, default: bool) -> list[Finding]:
    findings = []
    for name, answer in found.items():
        if isinstance(answer, Backend):
            kind = "software" if answer.software else "GPU"
            mark = "" if name != used else ", used by default" if default else f", used by {GL}"
            findings.append(Finding("opengl", name, OK, f"{answer.renderer} ({kind}{mark}), {answer.version}"))
        else:
            advice = f"not needed; {repair_advice(name)}" if used else repair_advice(name)  # one is enough
            findings.append(Finding("opengl", name, MISSING, answer, advice))
    return findings


def _devices(devices: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """Those that EGL knows, each tried. MuJoCo takes CUDA's number for one where the driver tells it."""
    numbers = [device["index"] if device["cuda"] is None else device["cuda"] for device in devices]
    trials = [BackendTrial("egl", draw=True, device=number) for number in numbers]
    findings = []
    for device, number, trial in zip(devices, numbers, trials, strict=True):
        answer, cuda = trial.result(), "" if device["cuda"] is None else f", CUDA device {device['cuda']}"
        where = f"MUJOCO_EGL_DEVICE_ID={number}{cuda}" + (f", {device['file']}" if device["file"] else "")
        name = f"device {device['index']}"
        if isinstance(answer, Backend):
            findings.append(Finding("egl devices", name, OK, f"{answer.renderer} ({where})"))
        else:
            findings.append(Finding("egl devices", name, MISSING, f"{answer} ({where})", "not needed; choose another"))
    return findings


def _filament(answer: Backend | str, used: str | None) -> Finding:
    if isinstance(answer, str):
        return Finding(
            "vulkan", "filament", MISSING, answer, f"not needed but for --renderer filament; {install_advice(VULKAN)}"
        )
    kind = "software" if answer.software else "GPU"
    alone = "" if used else "--renderer filament draws, the default renderer does not"
    return Finding("vulkan", "filament", OK, f"{answer.renderer} ({kind}, Vulkan {answer.version})", alone)


def _encoder() -> list[Finding]:
    try:
        version = encoder_version()
    except EncoderError as error:
        return [Finding("encoder", "ffmpeg", MISSING, str(error), "pip install --force-reinstall imageio-ffmpeg")]
    codecs = working_codecs()
    working = [codec for codec, works in codecs.items() if works]
    failing = [codec for codec, works in codecs.items() if not works]
    findings = [Finding("encoder", "ffmpeg", OK, version), Finding("encoder", "codecs", OK, ", ".join(working))]
    if failing:
        findings.append(Finding("encoder", "not here", MISSING, ", ".join(failing), "use another --codec"))
    return findings
