"""Options of the command `view`."""

from fractions import Fraction
from typing import ClassVar

from mjrun.options.kinds import FlagKind, PathKind, optional
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind
from mjrun.options.option import FrontEnd, Options, option, options

LIVE = FrontEnd.COMMAND | FrontEnd.PYTHON


@options
class ViewerOptions(Options):
    """The place where a live view opens, and its initial playback."""

    section: ClassVar[str] = "Viewer"
    places: ClassVar[FrontEnd] = LIVE

    speed: Fraction = option(
        converter=ExactNumberKind("FACTOR"),
        default=1,
        help="Simulated seconds per second of wall time; 0.25 is slow motion.",
    )
    paused: bool = option(converter=FlagKind(), default=False, help="Start paused at time 0.")
    browser: bool | None = option(
        converter=optional(FlagKind(negatable=True)),
        default=None,
        usual="a window if a display exists",
        help="Open the view in a browser on this machine instead of a window.",
    )
    port: int | None = option(
        converter=optional(IntegerKind(1, 65535, "PORT")),
        default=None,
        usual="the first free one from 8080",
        help="Port of the browser view, served on 127.0.0.1 only; implies --browser.",
    )
    recording: str | None = option(
        converter=optional(PathKind(written=True)),
        default=None,
        help="File for the state of every step since the last reset (.npz), for replay; written however the view ends.",
    )
