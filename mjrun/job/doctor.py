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

from mjrun.errors import EncoderError
from mjrun.export.video import encoder_version, working_codecs
from mjrun.model import faults
from mjrun.render.backend import DISPLAY, OPENGL, OSMESA, VULKAN, Backend, Probe, candidates, remedy
from mjrun.version import __version__

EXTRAS = {"parquet": "pyarrow", "mat": "scipy", "plot": "matplotlib", "warp": "mujoco_warp"}
CURES = {"egl": OPENGL, "osmesa": OSMESA, "glfw": DISPLAY}
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
    """All findings, and whether anything can draw."""

    findings: Sequence[Finding]
    can_draw: bool
    can_encode: bool


def examine() -> Examination:
    """Looks at everything mjrun needs; backends and drivers in child processes."""
    probes = {name: Probe(name, draw=True) for name in ("egl", "osmesa", "glfw", "vulkan")}
    if platform.system() == "Darwin":
        probes["cgl"] = Probe("cgl", draw=True)
    devices = Probe("devices").answer().get("devices", [])
    encoder = _encoder()
    backends = {name: probe.result() for name, probe in probes.items() if name != "vulkan"}
    drawing = _backends(backends)
    filament = _filament(probes["vulkan"].result())
    findings = [*_versions(), *_extras(), *drawing, *_devices(devices), filament, *encoder]
    return Examination(
        findings,
        can_draw=any(finding.status != MISSING for finding in drawing),
        can_encode=any(finding.name == "codecs" for finding in encoder),
    )


def _versions() -> list[Finding]:
    version = mujoco.mj_versionString()
    known = faults.of_version(version)
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


def _backends(found: dict[str, Backend | str]) -> list[Finding]:
    chosen = next((name for name in candidates() if isinstance(found.get(name), Backend)), None)
    findings = []
    for name, answer in found.items():
        if isinstance(answer, Backend):
            kind = "software" if answer.software else "GPU"
            mark = ", used by default" if name == chosen else ""
            findings.append(Finding("opengl", name, OK, f"{answer.renderer} ({kind}{mark}), {answer.version}"))
        else:
            cure = remedy(CURES.get(name, OPENGL))
            # One backend that works is enough.
            findings.append(Finding("opengl", name, MISSING, answer, f"not needed; {cure}" if chosen else cure))
    return findings


def _devices(devices: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """Those that EGL knows, each tried. MuJoCo takes CUDA's number for one where the driver tells it."""
    numbers = [device["index"] if device["cuda"] is None else device["cuda"] for device in devices]
    probes = [Probe("egl", draw=True, device=number) for number in numbers]
    findings = []
    for device, number, probe in zip(devices, numbers, probes, strict=True):
        answer, cuda = probe.result(), "" if device["cuda"] is None else f", CUDA device {device['cuda']}"
        where = f"MUJOCO_EGL_DEVICE_ID={number}{cuda}" + (f", {device['file']}" if device["file"] else "")
        name = f"device {device['index']}"
        if isinstance(answer, Backend):
            findings.append(Finding("egl devices", name, OK, f"{answer.renderer} ({where})"))
        else:
            findings.append(Finding("egl devices", name, MISSING, f"{answer} ({where})", "not needed; choose another"))
    return findings


def _filament(answer: Backend | str) -> Finding:
    if isinstance(answer, str):
        return Finding(
            "vulkan", "filament", MISSING, answer, f"not needed but for --renderer filament; {remedy(VULKAN)}"
        )
    kind = "software" if answer.software else "GPU"
    return Finding("vulkan", "filament", OK, f"{answer.renderer} ({kind}, Vulkan {answer.version})")


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
