"""From jobs back to the run document that makes them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from mjrun.camera.script import CameraScript, Event
from mjrun.document.camera_writer import event, known, written
from mjrun.document.document_model import ComplaintError
from mjrun.document.output_folder import WRITTEN, refusal
from mjrun.document.simulation import INTEGRATORS, setting_text
from mjrun.document.view import ALL
from mjrun.document.yaml_scalars import meaning
from mjrun.document.yaml_writer import exact, number, yaml_text
from mjrun.errors import UsageError, clean
from mjrun.job.image import Image
from mjrun.job.perform import Job
from mjrun.job.plot import Plot
from mjrun.job.recording import Recording
from mjrun.job.simulation import Simulation
from mjrun.job.trace import Trace
from mjrun.job.video import Video
from mjrun.model.override import Override
from mjrun.rendering.visual import Visual

Plain = dict[str, Any]

KINDS: dict[type, str] = {Video: "films", Image: "stills", Trace: "traces", Plot: "plots"}
# Fields of jobs that documents call otherwise.
NAMES = {"probes": "probe", "asserts": "assert"}
# Fields of jobs that are said elsewhere, or by the command line only.
ELSEWHERE = ("simulation", "visual", "gl", "require_gpu", "command")
EXACT = ("fps", "speed", "rate", "at")


def document_text(jobs: Sequence[Job], command: str = "") -> str:
    """The run document that makes `jobs`, which have one simulation in common; it says what is not as usual.

    How the machine draws is not in it, `--gl` and `--require-gpu`; files are as they are from the current folder.

    Args:
      command: what made the jobs, for a comment.

    Raises:
      UsageError: no document says this: code, a compiled model, an output outside of a folder.
    """
    if not jobs or any(job.simulation is not jobs[0].simulation for job in jobs):
        raise UsageError("a run document is of the outputs of one simulation")
    document = _simulation(jobs[0].simulation)
    for job in jobs:
        said = _job(job)
        if isinstance(job, Recording):
            if "recording" in document:
                raise UsageError("a run document has one recording")
            document["recording"] = said["output"] if [*said] == ["output"] else said
        else:
            document.setdefault(KINDS[type(job)], []).append(said)
    head = f"# {clean(command)}\n" if command else ""
    return head + yaml_text(_escaped(document))


def _escaped(value: Any) -> Any:
    """`value` with texts that no variables are found in."""
    match value:
        case str():
            return value.replace("${", "$${")
        case dict():
            return {key: _escaped(inner) for key, inner in value.items()}
        case list():
            return [_escaped(inner) for inner in value]
    return value


# --- the simulation ----------------------------------------------------------------------------------


def _simulation(simulation: Simulation) -> Plain:
    if simulation.controller is not None:
        raise UsageError("--controller: code stays on the command line; a document cannot hold it")
    source = simulation.source
    if not source.text:
        raise UsageError("a compiled model has no file that a document could name")
    numbers = {name: number(getattr(simulation, name)) for name in ("ctrl_noise", "ctrl_noise_time", "perturb", "seed")}
    return known(
        {
            "model": source.text,
            **_settings(source.overrides),
            "key": simulation.key,
            **{name: _by_name(getattr(simulation, name)) for name in ("qpos", "qvel", "ctrl")},
            "ctrl_from": None if simulation.ctrl_from is None else str(simulation.ctrl_from),
            "ctrl_interpolation": None if simulation.ctrl_interpolation == "hold" else simulation.ctrl_interpolation,
            **{name: value or None for name, value in numbers.items()},
            "replay": None if simulation.replay is None else str(simulation.replay),
            "duration": None if simulation.duration is None else exact(simulation.duration),
            "steps": simulation.steps,
        }
    )


def _settings(settings: Sequence[Override]) -> Plain:
    """Overrides; those by `--integrator` and `--timestep` come last, as the document's own do."""
    rest, ends = [*settings], {}
    for key, fits in (("timestep", _is_timestep), ("integrator", lambda text: text in INTEGRATORS)):
        last = rest[-1] if rest else None
        if last and (last.path, last.option) == (f"opt.{key}", key) and fits(last.value):
            ends[key] = float(last.value) if key == "timestep" else last.value
            rest.pop()
    found: Plain = {}
    for setting in rest:
        if setting.path in found:
            raise UsageError(f"{clean(setting.path)} is set twice, and a document says it once")
        found[setting.path] = _setting(setting.value)
    return {
        **({"set": found} if found else {}),
        **{key: ends[key] for key in ("integrator", "timestep") if key in ends},
    }


def _is_timestep(text: str) -> bool:
    value = meaning(text)
    return type(value) is float and value > 0 and repr(value) == text


def _setting(text: str) -> Any:
    """The value that is set by `text`: numbers, a list of them or a truth value, if that comes to the same text."""
    parts = [meaning(part) for part in text.split(",")]
    value = parts[0] if len(parts) == 1 else parts
    try:
        return value if setting_text(value) == text else text
    except ComplaintError:
        return text


def _by_name(given: Mapping[str, Any]) -> Plain | None:
    return {name: _numbers(value) for name, value in given.items()} or None


def _numbers(value: Any) -> Any:
    """A number, or a list of several."""
    parts = [number(float(part)) for part in value] if hasattr(value, "__iter__") else [number(float(value))]
    return parts[0] if len(parts) == 1 else parts


# --- outputs -----------------------------------------------------------------------------------------


def _job(job: Any) -> Plain:
    """What a document says of an output."""
    for name in WRITTEN:
        if (path := getattr(job, name, None)) is not None and (reason := refusal(path)):
            raise UsageError(f"{reason}; give a path relative to a folder")
    said: Plain = {}
    for field in dataclasses.fields(job):
        value = getattr(job, field.name)
        if field.name not in ELSEWHERE and not _is_usual(value, field.default):
            said[NAMES.get(field.name, field.name)] = _value(field.name, value)
        if field.name == "visual":
            said |= _visual(job.visual)
    return {"output": said.pop("output", job.output), **known(said)}


def _is_usual(value: Any, usual: Any) -> bool:
    """Whether a document need not say `value`; one of something is as good as a list of it."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(value) in (usual, (usual,))
    return value == usual


def _value(name: str, value: Any) -> Any:
    if isinstance(value, Event):
        return event(value, "at")
    if name in EXACT:
        return exact(value)
    if name == "size":
        return f"{value[0]}x{value[1]}"
    if name == "depth_range":
        return [number(part) for part in value]
    if isinstance(value, CameraScript):
        return written(value)
    if isinstance(value, str | bool):
        return value
    if isinstance(value, Sequence):
        return _one_or_all([_value("", part) for part in value])
    return number(value)


def _one_or_all(values: list[Any]) -> Any:
    return values[0] if len(values) == 1 else values


def _visual(visual: Visual) -> Plain:
    """What is drawn, as far as it is not as usual."""
    usual = Visual()
    groups = {kind: _groups(drawn) for kind, drawn in visual.groups.items()}
    words = {"frame_axes": "frame", "label": "label", "quality": "quality"}
    changed = {key: getattr(visual, name) for key, name in words.items()}
    return known(
        {
            "show": _one_or_all([*visual.show]) or None,
            "hide": _one_or_all([*visual.hide]) or None,
            "groups": groups or None,
            **{key: value for key, value in changed.items() if value != getattr(usual, words[key])},
        }
    )


def _groups(drawn: Sequence[int]) -> Any:
    return "all" if tuple(drawn) == ALL else [*drawn] or "none"
