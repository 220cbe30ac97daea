"""What a run document says of the simulation: the model, its start, what drives it, how long."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PlainValidator, Tag

from mjrun.document.document_model import NUMBER, TEXT, Among, ComplaintError, Form, Loc, Maybe, Name, kinds
from mjrun.document.field_types import Exact, Numbers
from mjrun.document.machine import Machine
from mjrun.job.simulation import INTERPOLATIONS, Simulation
from mjrun.model.names import enum_members
from mjrun.model.override import NAMED_INTEGERS, Override
from mjrun.model.sources import parse_source

INTEGRATORS = tuple(enum_members(NAMED_INTEGERS["integrator"]))
PHYSICS = ("key", "qpos", "qvel", "ctrl", "ctrl_from", "ctrl_noise", "perturb")  # nothing of it is in a replay

NotNegative = Annotated[float, Field(ge=0)]
Whole = Annotated[int, Field(ge=0)]


def setting_text(value: Any) -> str:
    """What `--set` would be given for `value`: `0,0,-1.6`, `true`, `elliptic`.

    Raises:
      ComplaintError: it is no such value.
    """
    match value:
        case bool():
            return str(value).lower()
        case int() | float() if abs(value) < float("inf"):
            return repr(value)
        case str() if value:
            return value
        case list() if value and all(type(part) in (int, float) for part in value):
            return ",".join(map(setting_text, value))
    raise ComplaintError("kind", expected="a finite number, text, true or false, or a list of finite numbers")


SettingText = Annotated[str, PlainValidator(setting_text, json_schema_input_type=float | Name | bool | list[float])]


class Simulated(Form):
    """The simulation."""

    model: Name
    """The model: .xml, .urdf, .mjz, .zip or .mjb, relative to the folder of this document."""
    settings: dict[str, SettingText] = Field({}, alias="set")
    """Overrides before compilation, by MuJoCo's own names: {opt.gravity: [0, 0, -1.6], opt.cone: elliptic}."""
    integrator: Maybe[Annotated[str, Among(INTEGRATORS)]] = None
    """Instead of the model's."""
    timestep: Maybe[Exact] = None
    """Instead of the model's [s]."""
    key: Maybe[
        Annotated[
            Annotated[Name, Tag(TEXT)] | Annotated[Whole, Tag(NUMBER)],
            kinds("the name or index of a keyframe", TEXT, NUMBER),
        ]
    ] = None
    """The keyframe to start from, by name or index."""
    qpos: dict[str, Numbers] = Field({})
    """Initial positions of joints by name [m, rad]: {hip: 0.3, root: [0, 0, 1, 1, 0, 0, 0], root/z: 1}."""
    qvel: dict[str, Numbers] = Field({})
    """Initial velocities of joints by name [m/s, rad/s]: {hip: 2, root/wx: 1}."""
    ctrl: dict[str, Numbers] = Field({})
    """Constant controls by actuator, in its units: {motor: 20, "left_*": 0.5}."""
    ctrl_from: Maybe[Name] = None
    """A table of controls in time [s], with columns time and ctrl/ACTUATOR, relative to the folder of this document."""
    ctrl_interpolation: Annotated[str, Among(INTERPOLATIONS)] = "hold"
    """Between the rows of that table."""
    ctrl_noise: NotNegative = 0.0
    """Standard deviation of noise on every control, in its own units."""
    ctrl_noise_time: NotNegative = 0.0
    """Time in which that noise forgets [s]; 0 is new at every step."""
    perturb: NotNegative = 0.0
    """Standard deviation of noise on the initial velocities [m/s, rad/s]."""
    seed: Whole = 0
    """Of the noise."""
    replay: Maybe[Name] = None
    """A recording (.npz) to go through instead of simulating, relative to the folder of this document."""
    duration: Maybe[Exact] = None
    """Simulated time [s]; 5, or that of the recording, if left out."""
    steps: Maybe[Annotated[int, Field(gt=0)]] = None
    """Number of steps, instead of duration."""

    @classmethod
    def complaints(cls, given: Mapping[str, Any]) -> Iterator[tuple[Loc, str]]:
        if "duration" in given and "steps" in given:
            yield ("steps",), "duration and steps exclude each other: both say how long"
        if "replay" in given:
            changing = [key for key in PHYSICS if key in given]
            yield from (((key,), f"a replay goes through a recording, which {key} would change") for key in changing)

    def simulation(self, inputs: Path, machine: Machine) -> Simulation:
        """The simulation; files are relative to the folder `inputs`.

        Raises:
          UsageError: what it says cannot be together.
        """
        settings = [Override(path, text) for path, text in self.settings.items()]
        if self.integrator:
            settings.append(Override("opt.integrator", self.integrator, "integrator"))
        if self.timestep:
            settings.append(Override("opt.timestep", repr(float(self.timestep)), "timestep"))
        same = ("key", "ctrl_interpolation", "ctrl_noise", "ctrl_noise_time", "perturb", "seed", "duration", "steps")
        return Simulation(
            parse_source(self.model, settings, inputs),
            qpos=_tuples(self.qpos),
            qvel=_tuples(self.qvel),
            ctrl=_tuples(self.ctrl),
            ctrl_from=within(inputs, self.ctrl_from),
            controller=machine.controller,
            control_dt=machine.control_dt,
            replay=within(inputs, self.replay),
            **{name: getattr(self, name) for name in same},
        )


def within(inputs: Path, path: str | None) -> str | None:
    """`path`, which is relative to the folder `inputs`, as it is from here."""
    return path if path is None or inputs == Path() else str(inputs / path)


def _tuples(given: Mapping[str, float | list[float]]) -> dict[str, tuple[float, ...]]:
    return {name: tuple(value) if isinstance(value, list) else (value,) for name, value in given.items()}
