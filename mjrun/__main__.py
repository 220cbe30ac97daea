"""`python -m mjrun` and the `mjrun` command."""

import atexit
import gc
import os
import signal
import sys

_code: int | None = None  # with which the command has ended


def main() -> None:
    """Runs the command line and exits with its code."""
    global _code
    if _is_in_ipython():
        _exit_with_new_process()
    _avoid_truncated_bytecode()
    # Before any import: a signal waits until it can be handled.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    # A locale in which Python cannot pass on the names of most files; -X utf8=0 may hold it to that.
    if sys.getfilesystemencoding() == "ascii" and os.environ.get("PYTHONUTF8") != "1":
        os.environ["PYTHONUTF8"] = "1"  # for its own processes, too
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # the others keep freed memory to themselves
    from mjrun.cli.standard_streams import open_standard_streams
    from mjrun.platform import system

    open_standard_streams()
    if system.CAN_FORK:
        from mjrun.cli.crash_monitor import continue_in_monitored_child

        continue_in_monitored_child()
    gc.disable()  # until the command begins: modules are not garbage
    atexit.register(_leave)  # the first to be registered is the last to be called
    from mjrun.cli.main import run

    _code = run(sys.argv[1:])
    for number in system.SIGNALS:  # it is over; only the interpreter is still to end
        signal.signal(number, signal.SIG_IGN)
    sys.exit(_code)


def _is_in_ipython() -> bool:
    """Returns whether IPython runs the command in its own process, as in `%run -m mjrun`."""
    library = sys.modules.get("IPython")
    return library is not None and library.get_ipython() is not None


def _exit_with_new_process() -> None:
    """Runs the command line in a new process, and exits with its code.

    A command forks, changes how signals are handled and ends its process: a notebook would not survive that.
    """
    import subprocess

    process = subprocess.Popen([sys.executable, "-m", "mjrun", *sys.argv[1:]])
    while process.returncode is None:
        try:
            process.wait()
        except KeyboardInterrupt:
            process.send_signal(signal.SIGINT)
    sys.exit(process.returncode)


def _avoid_truncated_bytecode() -> None:
    """Lets Python write no bytecode if the size of files is limited.

    Python 3.11 stores bytecode that exceeds the limit truncated, and can never import that module again.
    """
    try:
        import resource
    except ImportError:  # no such limits exist on this system
        return
    if resource.getrlimit(resource.RLIMIT_FSIZE)[0] != resource.RLIM_INFINITY:
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"  # for its own processes, too


def _leave() -> None:
    """Ends this process without destroying its modules and objects, which takes longer than some commands."""
    if _code is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_code)


if __name__ == "__main__":
    main()
