"""The origin of an output, for its manifest: versions, command, model, resolved options and time."""

import dataclasses
import platform
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import NotRequired, TypedDict, cast

import mujoco
import numpy as np

from mjrun.confinement.confinement import confinement
from mjrun.model.source import ModelSource, content_fingerprint
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline
from mjrun.version import __version__


class ModelOrigin(TypedDict):
    """The origin of a model: its source, and the fingerprint of its compiled form."""

    path: str
    sha256: str


class OutputOrigin(TypedDict):
    """The origin of an output: facts that determine it."""

    mjrun: str
    mujoco: str
    numpy: str
    python: str
    machine: str
    command: str
    model: ModelOrigin
    inputs: Sequence[Mapping[str, object]]
    untrusted: NotRequired[Mapping[str, object]]
    options: dict[str, object]
    seed: int
    timestep: float
    steps: int


def origin(request: object, simulation: Simulation, model: mujoco.MjModel, timeline: Timeline) -> OutputOrigin:
    """Returns the facts that determine the outputs of `request`, a dataclass, as plain values for JSON.

    The fingerprint is that of the compiled model with all its assets and overrides, wherever its files are.
    """
    options = cast(dict[str, object], plain(request))
    made: OutputOrigin = {
        "mjrun": __version__,
        "mujoco": mujoco.mj_versionString(),
        "numpy": np.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "command": str(options.pop("command", "")),
        "model": {"path": simulation.source.text, "sha256": content_fingerprint(model)},
        "inputs": simulation.fingerprints,
        "options": options,
        "seed": simulation.seed,
        "timestep": float(timeline.timestep),
        "steps": timeline.steps,
    }
    if limits := confinement():
        made["untrusted"] = limits.facts()
    return made


def plain(value: object) -> object:
    """Converts a value for JSON: dataclasses to the fields of their repr, exact numbers to floats, code to its name."""
    if isinstance(value, mujoco.MjModel):
        return "a compiled model"
    if isinstance(value, ModelSource):
        return value.text
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value) if field.repr}
    if isinstance(value, Mapping):
        items = cast(Mapping[object, object], value)
        return {str(key): plain(item) for key, item in items.items()}
    if isinstance(value, Fraction):
        return float(value)
    if isinstance(value, (str, int, float, type(None))):
        return value
    if isinstance(value, Sequence):
        return [plain(item) for item in cast(Sequence[object], value)]
    if isinstance(value, (np.ndarray, np.generic)):
        return cast(object, value.tolist())
    return getattr(value, "__qualname__", None) or str(value)
