"""Options of models: overrides before compilation, and what `info` prints."""

import math
from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import ChoiceKind, FlagKind, OneOrMoreKind, PathKind, TextKind, optional
from mjrun.options.number_kinds import ExactNumberKind, RealKind, to_float
from mjrun.options.option import FrontEnd, Options, option, options
from mjrun.options.schema_validation import InvalidValueError, Schema
from mjrun.options.setting_kinds import SettingsKind

INTEGRATORS = ("euler", "rk4", "implicit", "implicitfast", "discrete")


AUTO = "auto"  # gains of servos that are derived from the model
GAINS = ("kp", "kd")


class ServoGainsKind(TextKind):
    """Gains of servos: `auto`, or `kp=50,kd=2`; in documents and Python also True, for `auto`."""

    metavar = "[kp=KP,kd=KD]"
    accepted = "auto, or gains as in kp=50,kd=2, which are positive numbers"

    @property
    def form(self) -> Schema:
        number = r"[-+.\deE]+"
        pattern = rf"^(auto|(kp|kd)={number}(,(kp|kd)={number})?)$"
        return {"anyOf": [{"const": True}, {"type": "string", "pattern": pattern}], "expected": self.accepted}

    def __call__(self, value: object) -> str:
        if value is True or value == AUTO:
            return AUTO
        text = super().__call__(value)
        gains = parse_gains(text)
        if not gains or not all(name in GAINS and 0 < gain < math.inf for name, gain in gains.items()):
            raise InvalidValueError(self.accepted)
        return text

    def parse(self, text: str) -> str:
        return self(text)


def parse_gains(text: str) -> dict[str, float]:
    """Returns the gains in a text such as `kp=50,kd=2`, which may be NaN."""
    parts = [part.partition("=") for part in text.split(",")]
    return {name.strip(): to_float(number) for name, _, number in parts}


@options
class ModelOptions(Options):
    """Overrides of a model."""

    section: ClassVar[str] = "Model"

    integrator: str | None = option(
        converter=optional(ChoiceKind(INTEGRATORS)), default=None, help="Integrator, instead of the model's."
    )
    timestep: Fraction | None = option(
        converter=optional(ExactNumberKind("SECONDS")), default=None, help="Timestep [s], instead of the model's."
    )
    ground: float | None = option(
        converter=optional(RealKind(least=None, metavar="HEIGHT")),
        default=None,
        help="Add a horizontal floor that collides, at this height [m].",
    )
    set: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind(),
        default=(),
        help="Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10, "
        "opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1, vis.quality.shadowsize=1024; "
        "relative to the model's value, scale:geom/*.density=1.2, add:body/box.pos=0,0,.1. Lengths, masses and times "
        "may have units, geom/ball.size=25mm.",
    )


@options
class ServoOptions(ModelOptions):
    """Overrides of a model that no task controls, including servos in place of its motors."""

    section: ClassVar[str] = "Model"

    position_control: str | None = option(
        converter=optional(ServoGainsKind()),
        default=None,
        flag_value=AUTO,
        help="Replace motors on joints by servos, whose controls are joint positions [rad, m], from the initial ones "
        "on; a model without actuators gets a servo on each joint. Gains that are left out follow from inertias, "
        "weights and force limits.",
    )
    assets: tuple[str, ...] = option(
        converter=OneOrMoreKind(PathKind("DIR")),
        default=(),
        help="Folder with the meshes and textures that the model of a demonstration names by paths of another machine, "
        "which are looked up by their ends: DIR/robots/panda/link0.stl, or DIR/panda/link0.stl.",
    )


@options
class InfoOptions(Options):
    """Contents of the report about a model."""

    section: ClassVar[str] = "Info"
    places: ClassVar[FrontEnd] = FrontEnd.COMMAND

    columns: bool = option(
        converter=FlagKind(),
        default=False,
        help="List every column that a trace of the model can have and exit.",
    )
    xml: bool = option(
        converter=FlagKind(),
        default=False,
        help="Print the MJCF within a demonstration, with the paths of its meshes and textures here, and exit.",
    )
