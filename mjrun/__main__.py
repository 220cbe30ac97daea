"""`python -m mjrun` and the `mjrun` command."""

import os
import signal
import sys

from mjrun.platform import system


def main() -> None:
    """Runs the command line and exits with its code."""
    # A locale in which Python cannot pass on the names of most files; -X utf8=0 may hold it to that.
    if sys.getfilesystemencoding() == "ascii" and os.environ.get("PYTHONUTF8") != "1":
        os.environ["PYTHONUTF8"] = "1"  # for its own processes, too
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])
    # What comes before there is anybody to heed it waits.
    system.hold_signals()
    from mjrun.cli.standard_streams import open_standard_streams

    open_standard_streams()
    if system.CAN_FORK:
        from mjrun.cli.crash_monitor import fork_watched

        fork_watched()
    from mjrun.cli.main import run

    code = run(sys.argv[1:])
    for number in system.SIGNALS:  # it is over; only the interpreter is still to end
        signal.signal(number, signal.SIG_IGN)
    sys.exit(code)


if __name__ == "__main__":
    main()
