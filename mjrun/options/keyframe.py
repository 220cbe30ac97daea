"""Options of keyframes that are saved."""

from typing import ClassVar

from mjrun.options.kinds import File, Text
from mjrun.options.option import option, options, required
from mjrun.options.output import OutputOptions

LAST_INSTANT = "end"  # what the key is called where nothing is said


@options
class KeyframeOptions(OutputOptions):
    """The model's XML with the last instant of the simulation as a keyframe, controls included."""

    section: ClassVar[str] = "Keyframe"

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
