"""Options of disturbances: noise on the controls, and pushes."""

from mjrun.dataclass import dataclass
from mjrun.options.kinds import Optional
from mjrun.options.number_kinds import Real
from mjrun.options.option import Options, option, options
from mjrun.options.push import PUSHES, Push


@dataclass(frozen=True)
class Disturbances:
    """Disturbances of a simulation.

    Attributes:
      push: forces on bodies.
      ctrl_noise: standard deviation of the noise on the controls; None if it is not specified.
      ctrl_noise_time: correlation time of the noise [s]; None if it is not specified.
    """

    push: tuple[Push, ...] = ()
    ctrl_noise: float | None = None
    ctrl_noise_time: float | None = None


NO_DISTURBANCES = Disturbances()


@options
class DisturbanceOptions(Options):
    """Noise on the controls, and pushes."""

    ctrl_noise: float | None = option(
        converter=Optional(Real(metavar="STD")),
        default=None,
        usual="0, or that of the task",
        help="Standard deviation of Gaussian noise on every control, in the actuators' units.",
    )
    ctrl_noise_time: float | None = option(
        converter=Optional(Real(metavar="SECONDS")),
        default=None,
        usual="0, or that of the task",
        help="Correlation time of the control noise [s]; 0 makes it independent at every step.",
    )
    push: tuple[Push, ...] = option(
        converter=PUSHES,
        default=(),
        help="Force in world coordinates [N] on the centre of mass of a body, or on a site, with its start and its "
        "duration [s]: torso=0/100/0@1+0.2, site:hand=5/0/0@0.5+0.1. Overlapping pushes add up; --show pertforce draws "
        "them in videos and images.",
    )

    @property
    def disturbances(self) -> Disturbances:
        """The disturbances alone."""
        return Disturbances(self.push, self.ctrl_noise, self.ctrl_noise_time)
