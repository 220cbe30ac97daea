"""Options of models: overrides before compilation, and what `info` prints."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import Choice, Flag, Optional
from mjrun.options.number_kinds import ExactNumber, Real
from mjrun.options.option import FrontEnd, Options, option, options
from mjrun.options.setting_kinds import Settings

INTEGRATORS = ("euler", "rk4", "implicit", "implicitfast", "discrete")


@options
class ModelOptions(Options):
    """Overrides of a model."""

    section: ClassVar[str] = "Model"

    integrator: str | None = option(
        converter=Optional(Choice(INTEGRATORS)), default=None, help="Integrator, instead of the model's."
    )
    timestep: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")), default=None, help="Timestep [s], instead of the model's."
    )
    ground: float | None = option(
        converter=Optional(Real(least=None, metavar="HEIGHT")),
        default=None,
        help="Add a horizontal floor that collides, at this height [m].",
    )
    set: tuple[tuple[str, str], ...] = option(
        converter=Settings(),
        default=(),
        help="Override any attribute before compilation, under its MuJoCo name: opt.gravity=0,0,10, "
        "opt.cone=elliptic, opt.flag.contact=disable, geom/floor.friction[0]=.1, vis.quality.shadowsize=1024; "
        "relative to the model's value, scale:geom/*.density=1.2, add:body/box.pos=0,0,.1.",
    )


@options
class InfoOptions(Options):
    """Contents of the report about a model."""

    section: ClassVar[str] = "Info"

    columns: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="List every column that a trace of the model can have and exit.",
    )
