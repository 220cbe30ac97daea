"""Options of the model: what is overridden before it is compiled."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import Choice, ExactNumber, Optional, Settings
from mjrun.options.option import Options, option, options

INTEGRATORS = ("euler", "rk4", "implicit", "implicitfast", "discrete")


@options
class ModelOptions(Options):
    """What is overridden in a model."""

    section: ClassVar[str] = "Model"

    integrator: str | None = option(
        converter=Optional(Choice(INTEGRATORS)), default=None, help="The integrator, instead of the model's."
    )
    timestep: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS")), default=None, help="The timestep [s], instead of the model's."
    )
    set: tuple[tuple[str, str], ...] = option(
        converter=Settings(),
        default=(),
        help="Override anything before compilation, by MuJoCo's own names: opt.gravity=0,0,10, opt.cone=elliptic, "
        "opt.flag.contact=disable, geom/floor.friction[0]=.1, vis.quality.shadowsize=1024; relative to the model's "
        "own value, scale:geom/*.density=1.2, add:body/box.pos=0,0,.1.",
    )
