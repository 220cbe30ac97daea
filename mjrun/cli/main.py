"""The `mjrun` command, its subcommands, and the conversion of errors to text and exit codes."""

import os
import shlex
import signal
import sys
import threading
import time
from _thread import interrupt_main, start_new_thread
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import click

from mjrun.cli.console import Console, HelpContext, document_form, shown_help
from mjrun.errors import (
    ClosedPipeError,
    EndRequestedError,
    FailureReport,
    FileError,
    MjrunError,
    TerminatedError,
    clean,
    quoted,
    suggestion,
    system_limit,
)
from mjrun.platform import system
from mjrun.shared_status import interrupt, note_heard
from mjrun.suffixes import MODELS, is_yaml
from mjrun.version import __version__

if TYPE_CHECKING:
    from mjrun.cli.click_command import DeclaredCommand

BUG = 70  # the exit code
FINALIZER = "finalize.__call__"  # the qualified name of what calls the finalizers of `weakref`
RETRY = 0.005  # [s] from a signal in a finalizer to the next attempt
COMPLETE = "_MJRUN_COMPLETE"  # the environment variable by which a shell asks for completions
_ended_by: int | None = None  # the signal that ends this process

# The order of the commands in the help; others follow by name.
FIRST = (
    *("video", "image", "trace", "view", "run", "plot", "diff", "eval", "sweep", "dataset", "fit"),
    *("bench", "info", "check", "schema", "doctor"),
)
# Everyday names of commands that are too different to be suggested by similarity.
OTHER_COMMANDS = {
    "convert": ("export",),
    "lint": ("check",),
    "play": ("view", "video"),
    "record": ("video",),
    "render": ("video", "image"),
    "sim": ("trace", "video"),
    "simulate": ("trace", "video"),
    "validate": ("check",),
}


FOLDER = Path(__file__).with_name("commands")


def _commands() -> tuple[str, ...]:
    """Returns the names of the modules of `mjrun.cli.commands`."""
    names = {path.stem for path in FOLDER.iterdir() if path.suffix == ".py"} - {"__init__"}
    return tuple(sorted(names, key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name)))


COMMANDS = _commands()


def command_summary(name: str) -> str:
    """Returns the first line of the docstring of a command's module, without importing it."""
    with (FOLDER / f"{name}.py").open(encoding="utf-8") as file:
        return file.readline().strip().strip('"')


def load_command(name: str) -> "DeclaredCommand":
    """Imports and returns a command."""
    return getattr(import_module(f"mjrun.cli.commands.{name}"), name)


class _LazyGroup(click.Group):
    """A group that lists its commands without importing them."""

    context_class = HelpContext

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args[:1] == ["help"]:
            args = [*args[1:2], "--help"]
        return super().parse_args(ctx, args)

    def get_help(self, ctx: click.Context) -> str:
        return shown_help(super().get_help(ctx))

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return load_command(cmd_name) if cmd_name in COMMANDS else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name in COMMANDS or name.startswith("-"):
            return super().resolve_command(ctx, args)
        if name.endswith(MODELS) or ":" in name:
            message = f"{quoted(name)} is a model, not a command; to make a video of it: mjrun video {clean(name)}"
        elif is_yaml(name):
            message = f"{quoted(name)} is a document, not a command; to run it: mjrun run {clean(name)}"
        else:
            message = f"No such command {quoted(name)}{suggestion(name, COMMANDS, *OTHER_COMMANDS.get(name, ()))}."
        raise click.UsageError(message, ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, command_summary(name)) for name in COMMANDS])


@click.group(
    cls=_LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    invoke_without_command=True,
)
@click.version_option(__version__, "-V", "--version", prog_name="mjrun", message="%(prog)s %(version)s")
@click.pass_context
def group(ctx: click.Context) -> None:
    """Turn MuJoCo models into videos, images, tables and timing reports.

    \b
    mjrun video scene.xml                 a video, scene.mp4
    mjrun video scene.xml -o - | mpv -    the same into a player
    mjrun image scene.xml --view depth    an image, scene.png
    mjrun trace scene.xml --csv | head    a table of numbers
    mjrun COMMAND --help                  what a command can do
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


def run(arguments: Sequence[str]) -> int:
    """Runs one command line and returns its exit code."""
    if COMPLETE in os.environ:
        from mjrun.cli.commands.completion import complete

        return complete(group, os.environ[COMPLETE])
    # As NumPy in `import_mujoco`: OpenBLAS interrupts a process in which it can start no thread.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for number in system.SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as of nohup
            signal.signal(number, _end)
    console = Console(shlex.join(["mjrun", *arguments]), document_form=document_form(arguments))
    code = _guarded(console, lambda: _invoke(console, arguments))
    # A reader that is gone shows up, at the latest, when the last text is flushed.
    finishing_code = _guarded(console, lambda: _finish(console))
    code = code or finishing_code
    console.release_stdout()
    return code


def _invoke(console: Console, arguments: Sequence[str]) -> int:
    system.release_signals()
    # Not `group.main`, which would turn Ctrl-C and a closed pipe into exit code 1.
    with group.make_context("mjrun", list(arguments), obj=console) as ctx:
        group.invoke(ctx)  # imports the command, and calls DeclaredCommand.invoke, which calls its function
    return console.code


def _finish(console: Console) -> int:
    console.finish()
    sys.stdout.flush()
    return 0


def _guarded(console: Console, action: Callable[[], int]) -> int:
    """Returns the exit code of `action`, also if it raises."""
    try:
        try:
            return action()
        except Exception as error:
            if _ended_by is None:
                raise
            ending = _ending(_ended_by)
            for note in getattr(error, "__notes__", ()):
                ending.add_note(note)
            raise ending from error  # what an import makes of a signal, for example
    except click.exceptions.Exit as end:
        return end.exit_code
    except ClosedPipeError as end:  # quietly
        return end.exit_code
    except BaseException as error:
        failure = _failure(error)
        console.error(failure.message)
        console.report_failure(failure)
        return failure.exit_code
    finally:
        console.close()


def _failure(error: BaseException) -> FailureReport:
    """Returns the failure that an exception represents."""
    match error:
        case click.UsageError():
            path = error.ctx.command_path if error.ctx else "mjrun"
            text = f"{error.format_message()}\n`{path} --help` shows what it takes"
            return FailureReport("UsageError", text, error.exit_code)
        case click.ClickException():
            return FailureReport(type(error).__name__, error.format_message(), error.exit_code)
        case MjrunError():
            return FailureReport.of(error)
        case KeyboardInterrupt() | click.Abort():
            return FailureReport("KeyboardInterrupt", _with_notes("interrupted", error), 128 + signal.SIGINT)
        case EndRequestedError():
            return FailureReport("TerminatedError", _with_notes(f"ended by {error}", error), error.exit_code)
        case Exception():
            if (limit := system_limit(error)) is not None:
                return FailureReport.of(limit)
            from mjrun.packages import cause_of

            if (cause := cause_of(error)) is not None:
                return FailureReport.of(cause)
            if isinstance(error, FileNotFoundError) and not _has_working_folder():
                removed = FileError(os.curdir, "the working folder has been removed", "cd to another folder first")
                return FailureReport.of(removed)
            return FailureReport("InternalError", _bug_message(error), BUG)
        case _:
            raise error


def _with_notes(text: str, error: BaseException) -> str:
    return "\n".join([text, *getattr(error, "__notes__", ())])


def _has_working_folder() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True


def _bug_message(error: Exception) -> str:
    import traceback

    where = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(where.filename).name}:{where.lineno}"
    return f"a bug in mjrun: {type(error).__name__}: {error} ({place})\n--debug shows the traceback; please report it"


def _end(number: int, frame: FrameType | None) -> None:
    """Ends the work once; further signals during the cleanup, such as a second Ctrl-C, have no effect."""
    global _ended_by
    if _is_in_finalizer(frame):  # what is raised there is lost, and it would not be completed
        note_heard()
        start_new_thread(_interrupt_later, (number,))
        return

    for each in system.SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    _ended_by = number
    note_heard()
    sys.unraisablehook = threading.excepthook = _say_nothing  # of destructors and threads that it interrupts
    interrupt(_ending(number))


def _is_in_finalizer(frame: FrameType | None) -> bool:
    while frame:
        if frame.f_code.co_qualname == FINALIZER:
            return True
        frame = frame.f_back
    return False


def _interrupt_later(number: int) -> None:
    time.sleep(RETRY)
    if hasattr(signal, "pthread_kill"):  # which also ends a wait
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        interrupt_main(signal.Signals(number))


def _ending(number: int) -> BaseException:
    return KeyboardInterrupt() if number == signal.SIGINT else TerminatedError(number)


def _say_nothing(_: object, /) -> None:
    pass
