"""Options of work on files nobody vouches for."""

from collections.abc import Mapping
from typing import ClassVar

from mjrun.options.kinds import File, Flag, Optional, Values
from mjrun.options.option import FrontEnd, Options, option, options

TIME, MEMORY, FILE = LIMITS = ("time", "memory", "file")


@options
class ConfinementOptions(Options):
    """What keeps a model, and the documents and tables beside it, from doing harm; no document says so."""

    section: ClassVar[str] = "Trust"

    untrusted: bool = option(
        converter=Flag(),
        default=False,
        places=FrontEnd.COMMAND,
        help="Trust no file: read those beside the model and those that you name, write in the folders of the outputs, "
        "use no network, run no code, load no .mjb, within limits of time, memory and file size.",
    )
    root: str | None = option(
        converter=Optional(File("DIR")),
        default=None,
        usual="the model's folder",
        places=FrontEnd.COMMAND,
        help="With --untrusted, the folder that files are read from.",
    )
    limit: Mapping[str, tuple[float, ...]] = option(
        converter=Values("NAME=N"),
        default=dict[str, tuple[float, ...]](),
        usual="time=3600, memory=8192, file=16384",
        places=FrontEnd.COMMAND,
        help="With --untrusted, a limit: time [s], memory of each process [MiB], file, the size of one [MiB].",
    )
