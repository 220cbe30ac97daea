"""Options of the command `view`."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import ExactNumber, File, Flag, Integer, Optional
from mjrun.options.option import FrontEnd, Options, option, options

LIVE = FrontEnd.COMMAND | FrontEnd.PYTHON


@options
class ViewerOptions(Options):
    """Where a simulation is looked at live, and how it starts there."""

    section: ClassVar[str] = "Viewer"

    speed: Fraction = option(
        converter=ExactNumber("FACTOR"),
        default=1,
        places=LIVE,
        help="Simulated seconds per second of wall time; 0.25 is slow motion.",
    )
    paused: bool = option(converter=Flag(), default=False, places=LIVE, help="Start paused, at time 0.")
    browser: bool | None = option(
        converter=Optional(Flag(negatable=True)),
        default=None,
        usual="a window where there is a display",
        places=LIVE,
        help="Show it in a browser on this machine instead of in a window.",
    )
    port: int | None = option(
        converter=Optional(Integer(1, 65535, "PORT")),
        default=None,
        usual="the first free one from 8080",
        places=LIVE,
        help="Port of the browser's page, which is served on 127.0.0.1 only; implies a browser.",
    )
    recording: str | None = option(
        converter=Optional(File(written=True)),
        default=None,
        places=LIVE,
        help="Keep the state of every step since the last reset (.npz), to replay; written when the view ends, "
        "however it ends.",
    )
