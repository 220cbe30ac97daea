"""Options of the command `fit`: parameters of a model from measurements."""

from typing import ClassVar

from mjrun.options.kinds import Camera, Choice, File, Flag, Integer, Optional, Real, Settings, Several, Size
from mjrun.options.option import FrontEnd, Options, option, options
from mjrun.options.output import VIDEOS

EXTRAS = {"fit": (("scipy",), "mjrun fit")}  # the libraries that the extra installs, and what needs them
LOSSES = ("linear", "soft_l1", "huber", "cauchy")


@options
class FitOptions(Options):
    """A fit."""

    section: ClassVar[str] = "Fit"

    data: tuple[str, ...] = option(
        converter=Several(File()),
        default=(),
        places=FrontEnd.DOCUMENT | FrontEnd.PYTHON,
        help="Tables of what was measured, with columns such as time, qpos/knee and ctrl/motor.",
    )
    free: tuple[tuple[str, str], ...] = option(
        converter=Settings("PATH=LOW..HIGH", "joint/hinge.damping=0.001..1"),
        default=(),
        help="A number to find, and its bounds: joint/hinge.damping=0.001..1, log:1e-4..1 where it may lie orders of "
        "magnitude apart. Any path of --set, tied by a wildcard or scale:; actuator/NAME.kp and .kv of position "
        "servos; delay:ctrl/* or delay:qpos/knee [s]; inertia:BODY.mass [kg], .center of mass [m] and .shape, "
        "factors of how far mass is spread. ~normal(MEAN, STD) behind the bounds is a prior.",
    )
    output: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        short="-o",
        help="The model with what was found: its own text, with nothing but these attributes changed (.xml).",
    )
    comparison: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="A table of what was measured, and of what the model says before (/nominal) and after (/fitted); mjrun "
        "plot draws it.",
    )
    ranges: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="What is known of the parameters as distributions, for `vary:` in documents of mjrun sweep (.yaml).",
    )
    html: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="One page about the fit (.html), complete in itself: parameters with intervals, errors, correlations, and "
        "plots of what was measured beside the model before and after.",
    )
    video: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help=f"A film of the fitted model, with what was measured as a ghost: {VIDEOS}.",
    )
    camera: tuple[object, ...] = option(
        converter=Several(Camera()), default="free", help="What the film shows: a camera of the model, or a rig."
    )
    size: tuple[int, int] = option(converter=Size(), default=(640, 360), help="Width and height of the film [pixels].")
    noise: tuple[tuple[str, str], ...] = option(
        converter=Settings("COLUMN=STD", "qpos/knee=0.001"),
        default=(),
        help="Standard deviation of the noise of a signal, in its unit; wildcards allowed. By default the high "
        "frequencies of the log tell it.",
    )
    holdout: float = option(
        converter=Real(0, most=0.9, metavar="SHARE"),
        default=0.2,
        help="The last part of each log's time, which is not fitted but predicted to see whether the fit is better.",
    )
    holdout_data: tuple[str, ...] = option(
        converter=Several(File()),
        default=(),
        help="Tables that are held out as a whole, instead of the last part of each.",
    )
    starts: int = option(
        converter=Integer(1),
        default=3,
        help="How many starts: the model's own values, then others spread evenly, which are tried where "
        "the fit does not come down to the noise.",
    )
    confidence: float = option(
        converter=Real(0.5, most=0.999),
        default=0.95,
        help="Of the intervals: a share of repeated fits that contain the truth.",
    )
    loss: str = option(
        converter=Choice(LOSSES),
        default="linear",
        help="How residuals count; all but linear are robust: outliers weigh less, and noise and errors are told by "
        "medians.",
    )
    allow_unidentifiable: bool = option(
        converter=Flag(),
        default=False,
        help="Go on although the measurements say nothing of a parameter, or cannot tell several apart.",
    )
    keep_partial: bool = option(
        converter=Flag(),
        default=False,
        help="Write the model with the best parameters so far if the fit is interrupted, and tell them; otherwise "
        "nothing is left.",
    )
    excite: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        help="Nothing is measured yet: write a table of controls that make the parameters show, chirps of 0.1 to 10 Hz "
        "within the ranges of controls, joints and forces. --ctrl-from plays it; --duration says how long it is.",
    )
    excite_noise: float = option(
        converter=Real(1e-12, metavar="STD"),
        default=1e-3,
        help="Standard deviation of the positions that will be measured [rad, m], for the intervals that --excite "
        "tells beforehand.",
    )
    velocity_limit: float | None = option(
        converter=Optional(Real(1e-9, metavar="SPEED")),
        default=None,
        help="How fast joints may move under --excite [rad/s, m/s].",
    )
