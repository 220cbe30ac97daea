"""Options of keyframes that are saved."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import ExactNumber, File, Integer, Optional, Text
from mjrun.options.option import Exclusion, option, options, required
from mjrun.options.output import OutputOptions

LAST_INSTANT = "end"  # what the key is called where nothing is said


@options
class KeyframeOptions(OutputOptions):
    """The model's XML with an instant of the simulation as a keyframe, controls included."""

    section: ClassVar[str] = "Keyframe"
    exclusions: ClassVar[tuple[Exclusion, ...]] = (Exclusion(("time", "step"), "both say when"),)

    output: str = required(
        converter=File(written=True),
        kw_only=False,
        help="An .xml file; it may be that of the model. But for the key, it is the model's own, to the byte.",
    )
    name: str = option(
        converter=Text(metavar="NAME"),
        default=LAST_INSTANT,
        help="What the keyframe is called; one of that name is replaced.",
    )
    time: Fraction | None = option(
        converter=Optional(ExactNumber("SECONDS", zero=True)),
        default=None,
        usual="the last instant",
        help="The instant that it holds [s].",
    )
    step: int | None = option(converter=Optional(Integer()), default=None, help="The instant, by step.")
