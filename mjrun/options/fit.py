"""Options of the command `fit`: parameters of a model from measurements."""

from typing import ClassVar

from mjrun.options.kinds import CameraKind, ChoiceKind, FlagKind, OneOrMoreKind, PathKind, optional
from mjrun.options.number_kinds import IntegerKind, RealKind, SizeKind
from mjrun.options.option import FrontEnd, OptionExclusion, OptionRequirement, Options, option, options
from mjrun.options.output import VIDEOS
from mjrun.options.setting_kinds import SettingsKind

EXTRAS = {"fit": (("scipy",), "mjrun fit")}  # the libraries that the extra installs, and what needs them
LOSSES = ("linear", "soft_l1", "huber", "cauchy")


@options
class FitOptions(Options):
    """A fit."""

    section: ClassVar[str] = "Fit"
    exclusions: ClassVar[tuple[OptionExclusion, ...]] = (
        OptionExclusion(("holdout", "holdout_data"), "both say what is held out"),
    )
    requirements: ClassVar[tuple[OptionRequirement, ...]] = (
        OptionRequirement("camera", "video", "which it records"),
        OptionRequirement("size", "video", "whose size it sets"),
        OptionRequirement("excite_noise", "excite", "whose confidence intervals it predicts"),
        OptionRequirement("velocity_limit", "excite", "whose motion it limits"),
    )

    data: tuple[str, ...] = option(
        converter=OneOrMoreKind(PathKind()),
        default=(),
        places=FrontEnd.DOCUMENT | FrontEnd.PYTHON,
        help="Tables of measurements, with columns such as time, qpos/knee and ctrl/motor.",
    )
    free: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("PATH=LOW..HIGH", "joint/hinge.damping=0.001..1"),
        default=(),
        help="Parameter to estimate and its bounds: joint/hinge.damping=0.001..1, or log:1e-4..1 if its order of "
        "magnitude is unknown. Accepts any path of --set, with scale: or wildcards to tie several values "
        "together; actuator/NAME.kp and .kv of position servos; delay:ctrl/* or delay:qpos/knee [s]; "
        "inertia:BODY.mass [kg], .center (of mass) [m] and .shape (factors for the spread of mass). Append "
        "~normal(MEAN, STD) to add a prior.",
    )
    output: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        short="-o",
        help="Fitted model (.xml): the original text with only the fitted attributes changed.",
    )
    comparison: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Table of the measurements and of the predictions of the model before (/nominal) and after the fit "
        "(/fitted), for mjrun plot.",
    )
    ranges: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Distributions of the fitted parameters (.yaml), for the key vary in documents of mjrun sweep.",
    )
    html: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Self-contained page (.html) about the fit: parameters with confidence intervals, errors, "
        "correlations, and plots of the measurements with the model before and after the fit.",
    )
    video: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help=f"Video of the fitted model with the measured motion as a ghost: {VIDEOS}.",
    )
    camera: tuple[object, ...] = option(
        converter=OneOrMoreKind(CameraKind()),
        default="auto",
        help="Camera of the video: a camera of the model, or a rig.",
    )
    size: tuple[int, int] = option(
        converter=SizeKind(), default=(640, 360), help="Width and height of the video [pixels]."
    )
    noise: tuple[tuple[str, str], ...] = option(
        converter=SettingsKind("COLUMN=STD", "qpos/knee=0.001"),
        default=(),
        help="Standard deviation of the measurement noise of a signal, in its unit; accepts wildcards. By default, "
        "it is estimated from the high frequencies of the data.",
    )
    holdout: float = option(
        converter=RealKind(0, most=0.9, metavar="SHARE"),
        default=0.2,
        help="Share of each table, at its end, that is not used for the fit, but predicted to test whether the fit"
        " is an improvement.",
    )
    holdout_data: tuple[str, ...] = option(
        converter=OneOrMoreKind(PathKind()),
        default=(),
        help="Table that is not used for the fit but only predicted, instead of the last part of each table.",
    )
    starts: int = option(
        converter=IntegerKind(1),
        default=3,
        help="Number of starting points: first the values of the model, then values spread evenly over the bounds,"
        " which are used if the fit does not reach the noise level.",
    )
    confidence: float = option(
        converter=RealKind(0.5, most=0.999),
        default=0.95,
        help="Confidence level of the intervals: the share of repeated fits whose intervals contain the true value.",
    )
    loss: str = option(
        converter=ChoiceKind(LOSSES),
        default="linear",
        help="Loss function of the residuals. All but linear are robust: they reduce the weight of outliers and "
        "estimate noise and errors by medians.",
    )
    allow_unidentifiable: bool = option(
        converter=FlagKind(),
        default=False,
        help="Continue even if the measurements do not determine some parameters or combinations of them.",
    )
    keep_partial: bool = option(
        converter=FlagKind(),
        default=False,
        help="If the fit is interrupted, write the model with the best parameters so far and report them; by "
        "default nothing is written.",
    )
    excite: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="Instead of fitting, write a table of controls that excite the parameters: chirps of 0.1 to 10 Hz "
        "within the ranges of controls, joints and forces. --ctrl-from applies the table; --duration sets its"
        " length.",
    )
    excite_noise: float = option(
        converter=RealKind(1e-12, metavar="STD"),
        default=1e-3,
        help="Expected standard deviation of the measured positions [rad, m], from which --excite predicts "
        "confidence intervals.",
    )
    velocity_limit: float | None = option(
        converter=optional(RealKind(1e-9, metavar="SPEED")),
        default=None,
        help="Maximum joint velocity under --excite [rad/s, m/s].",
    )
