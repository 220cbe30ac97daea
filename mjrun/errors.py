"""What can go wrong: one class per cause, each with its exit code and its own sentence.

A class takes facts and writes the message; the command line prints it in one place. The first
line of a message says what and where; further lines say what is valid and what to do next.
"""

import difflib
import math
import re
import signal
import traceback
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

LISTED = 24  # names shown before a list is cut
LOGGED = 8  # lines of an encoder's log that are shown
NEAR = 0.6  # of two names, the least share that agrees when one may be meant by the other
FAULTS = 50  # problems of a document that are shown
QUOTED = 200  # characters of a name that are shown
LINE = 4096  # characters of a line of a message, however long what it speaks of


# Around the name of an option in a message. `clean` leaves neither in foreign text, which cannot be taken for one then.
_OPTION = re.compile("\x02([a-z_]*)\x03")

ARENA = "narena ="  # in what MuJoCo says when the memory that the model sets apart is too small
Spelling = Callable[[str], str]
OptionPath = tuple[str | int, ...]


def option(name: str) -> str:
    """The option `name` within a message: each front end spells it in its own way, `--trail-span` or `trail_span`."""
    return f"\x02{name}\x03"


MORE_MEMORY = f"the model's own memory is too small: {option('set')} size.memory=100M gives it more"


def flag(name: str) -> str:
    """The option `name` as the command line spells it: `--trail-span`."""
    return f"--{name.replace('_', '-')}"


def spelled(text: str, spelling: Spelling = str) -> str:
    """`text` with its options as `spelling` writes their names; as Python does if nothing is said."""
    return _OPTION.sub(lambda found: spelling(found[1]), text)


def _message(text: str, spelling: Spelling = str) -> str:
    """`text` with its lines cleaned, its options spelled and its longest lines cut in the middle."""
    half = LINE // 2 - 1
    lines = [spelled(_clean_but_options(line), spelling) for line in text.split("\n")]
    return "\n".join(line if len(line) <= LINE else f"{line[:half]}…{line[-half:]}" for line in lines)


def clean(text: str) -> str:
    """`text` with control and formatting characters made visible, fit for a terminal or a table.

    Names in models and file names are foreign: they may hold escape sequences or newlines.
    """
    if text.isprintable():  # nothing to change, which is quickly known, even of megabytes
        return text
    return "".join(ascii(c)[1:-1] if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") else c for c in text)


def _clean_but_options(text: str) -> str:
    """`text`, cleaned around the options that it names."""
    return "".join(option(part) if i % 2 else clean(part) for i, part in enumerate(_OPTION.split(text)))


def quoted(name: str) -> str:
    """`name` in quotes, cleaned, and cut if it is long."""
    return f"'{clean(name if len(name) <= QUOTED else name[: QUOTED - 1] + '…')}'"


def near(name: str, valid: Iterable[str]) -> list[str]:
    """The names in `valid` most like `name`, best first, at most three; case is ignored.

    An ending that both have, as files of one format do, makes nothing alike.
    """
    if len(name) > QUOTED:  # to compare it would take long
        return []
    by_fold: dict[str, list[str]] = {}
    for spelling in valid:
        by_fold.setdefault(spelling.casefold(), []).append(spelling)
    alike = [fold for fold in by_fold if _alike(*_beginnings(name.casefold(), fold))]
    close = difflib.get_close_matches(name.casefold(), alike, n=3, cutoff=NEAR)
    return [spelling for fold in close for spelling in by_fold[fold]][:3]


def _alike(one: str, other: str) -> bool:
    return bool(difflib.get_close_matches(one, [other], cutoff=NEAR))


def _beginnings(one: str, other: str) -> tuple[str, str]:
    """Both names without the ending after the last dot, if it is the same."""
    (first, _, ending), (second, _, other_ending) = one.rpartition("."), other.rpartition(".")
    return (first, second) if first and second and ending == other_ending else (one, other)


def listing(names: Sequence[str]) -> str:
    """`names` as a comma-separated list, cut after `LISTED`."""
    shown = ", ".join(clean(n) or "''" for n in names[:LISTED])
    return shown + (f", … ({len(names)} in all)" if len(names) > LISTED else "")


def counted(count: int, noun: str) -> str:
    """`1 row`, `2 rows`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def suggestion(name: str, valid: Iterable[str]) -> str:
    """` (did you mean 'x'?)`, or nothing when no valid name is near; for `qpso/*` groups are valid too."""
    valid = list(valid)
    if name.endswith("/*"):
        valid = list(dict.fromkeys(f"{each.rpartition('/')[0]}/*" for each in valid if "/" in each))
    close = near(name, [each for each in valid if each != name])
    return f" (did you mean {' or '.join(map(quoted, close))}?)" if close else ""


@dataclass(frozen=True)
class Failure:
    """What ended a command; `error` in its JSON document, which may have further keys that depend on the kind.

    Attributes:
      kind: a name for the cause, such as UnknownNameError.
      message: what went wrong and where, then what is valid and what to do next.
      exit_code: of the command.
      facts: the further keys.
    """

    kind: str
    message: str
    exit_code: int
    facts: Mapping[str, object] = field(default_factory=dict[str, object])

    @classmethod
    def of(cls, error: "MjrunError") -> "Failure":
        """The failure that `error` reports, with its public attributes as facts."""
        hidden = ("results", "path")
        facts = {name: plain(v) for name, v in vars(error).items() if name not in hidden and not name.startswith("_")}
        return cls(type(error).__name__, error.spelled(flag), error.exit_code, facts)

    def document(self) -> dict[str, object]:
        """The JSON object."""
        return {**self.facts, "kind": self.kind, "message": self.message, "exit_code": self.exit_code}


def plain(value: object) -> object:
    """`value` as JSON has it; what JSON does not have becomes text."""
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else str(value)
        case Problem():
            return value._asdict()
        case Mapping():
            return {str(key): plain(each) for key, each in cast("Mapping[object, object]", value).items()}
        case list() | tuple():
            return [plain(each) for each in cast("Sequence[object]", value)]
        case _:
            return str(value)


class MjrunWarning(UserWarning):
    """Something that may make a result other than expected, told through Python's warnings."""


class MjrunError(Exception):
    """Base of every error that a user can cause or meet. Whatever its message quotes is fit for a terminal.

    Attributes:
      results: of what was made and published in spite of it.
    """

    exit_code = 70
    results: Sequence[Any] = ()

    def __str__(self) -> str:
        return _message(super().__str__())

    def spelled(self, spelling: Spelling) -> str:
        """The message and its notes, with options as `spelling` writes their names."""
        return _message("\n".join([super().__str__(), *getattr(self, "__notes__", ())]), spelling)


# --- 1: the answer is no ----------------------------------------------------------------------------


class FailedAssertionError(MjrunError):
    """What was asserted of a simulation does not hold; `messages` say what, where, and what it is instead."""

    exit_code = 1

    def __init__(self, messages: Sequence[str]) -> None:
        self.messages = tuple(messages)
        super().__init__("\n".join(f"{'assertion failed: ' if not i else ''}{m}" for i, m in enumerate(messages)))


class GoldenDifferenceError(MjrunError):
    """A simulation differs from its golden table; `messages` say from which, where, and by how much."""

    exit_code = 1

    def __init__(self, messages: Sequence[str]) -> None:
        self.messages = tuple(messages)
        super().__init__("\n".join([*messages, f"{option('update')} makes what is now the golden table"]))


class UnidentifiableError(MjrunError):
    """Measurements do not tell what is looked for; `messages` say of which parameters, `hints` why that may be."""

    exit_code = 1

    def __init__(self, messages: Sequence[str], hints: Sequence[str] = ()) -> None:
        self.messages = tuple(messages)
        advice = "leave them out, give a prior, or measure other signals or motions"
        goes_on = f"{advice}; {option('allow_unidentifiable')} goes on all the same"
        super().__init__("\n".join([*messages, *hints, goes_on]))


class UnimprovedFitError(MjrunError):
    """A fitted model predicts what it has not seen no better than the model before; `message` says by how much."""

    exit_code = 1


# --- 2: wrong usage --------------------------------------------------------------------------------


class UsageError(MjrunError):
    """Options or values that cannot be meant.

    Attributes:
      path: the option that is at fault, and the place in its value: `("camera", 0, "lookat")`; empty if unknown.
    """

    exit_code = 2

    def __init__(self, message: str, path: OptionPath = ()) -> None:
        super().__init__(message)
        first = _OPTION.search(message)
        self.path: OptionPath = path or ((first[1],) if first else ())

    def one_line(self, path: OptionPath = ()) -> str:
        """The message in one line, without the option that it begins with, if that is the last name in `path`."""
        message = "; ".join(part for part in self.spelled(str).splitlines() if part)
        names = [part for part in path if isinstance(part, str)]
        message = message.removeprefix(f"{names[-1]}: ") if names else message
        return message.removeprefix(f"{names[-2]} {names[-1]}: ") if len(names) > 1 else message


@contextmanager
def concerning(*path: str | int) -> Iterator[None]:
    """Says of a UsageError raised within which option, and which part of its value, is at fault."""
    try:
        yield
    except UsageError as error:
        if error.path == path[: len(error.path)]:
            error.path = path
        elif error.path[: len(path)] != path:
            error.path = (*path, *error.path)
        raise


class UnknownNameError(UsageError):
    """A name that is not among the valid ones."""

    def __init__(self, kind: str, name: str, valid: Sequence[str], where: str = "", plural: str = "") -> None:
        plural = plural or f"{kind}s"
        self.name, self.valid = name, tuple(valid)
        choices = f"{plural}: {listing(valid)}" if valid else f"there are no {plural}"
        place = f" in {_clean_but_options(where)}" if where else ""
        super().__init__(f"no {kind} {quoted(name)}{place}{suggestion(name, valid)}\n{choices}")


class BadValueError(UsageError):
    """A value of the wrong type, size or range; `what` is the name of it, `option("fps")` as a rule."""

    def __init__(self, what: str, value: object, expected: str) -> None:
        self.value = str(value)
        super().__init__(f"{what}: {quoted(self.value)} is not {expected}")


class Problem(NamedTuple):
    """One thing wrong in a document: at `place`, `shots.yaml:12:5`, and at `path` in it, `shots[1].orbit`."""

    place: str
    path: str
    message: str

    def __str__(self) -> str:
        return ": ".join(clean(part) for part in self if part)


class DocumentError(UsageError):
    """A document says what cannot be meant: every problem in it, one on a line."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        hidden = len(problems) - FAULTS
        more = [f"… and {hidden} more problem{'s' if hidden > 1 else ''}"] if hidden > 0 else []
        super().__init__("\n".join([*map(str, problems[:FAULTS]), *more]))


class InvalidJobsError(UsageError):
    """What is wrong with jobs that are done together: `faults`, each with a job's index, None for the simulation."""

    def __init__(self, faults: Sequence[tuple[int | None, UsageError]]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(dict.fromkeys(error.spelled(option) for _, error in faults)))


# Packages that share a folder with another one, so that what replaces that one by an older version removes their files.
SHARING = {"mujoco": "mujoco-core mujoco-studio"}


def installation(package: str, specifier: str) -> str:
    """The command that installs a version of a package over whichever is installed."""
    removal = f"pip uninstall -y {package} {SHARING[package]} && " if package in SHARING else ""
    return f"{removal}pip install '{package}{specifier}'"


class MissingExtraError(UsageError):
    """What was asked needs a library that only an extra of mjrun installs; or, without an extra, the user alone."""

    def __init__(self, what: str, library: str, extra: str = "") -> None:
        self.library = library
        install = f"'mjrun[{extra}]'" if extra else library
        super().__init__(f"{what} needs {library}, which is not installed\npip install {install}")


class DamagedPackageError(UsageError):
    """A package that mjrun needs is installed, and cannot be imported."""

    def __init__(self, package: str, version: str, reason: str) -> None:
        sentence = clean(reason.strip().partition("\n")[0].partition(". ")[0])
        super().__init__(f"{package} {clean(version)} is damaged: {sentence}\n{installation(package, f'=={version}')}")


class WrongVersionError(UsageError):
    """A package that mjrun needs is installed in another version.

    Args:
      specifier: the versions that mjrun needs: `>=4`.
      requiring: what asks for another version, by the installed packages that brought it:
        `{"robosuite": "mink 0.0.5 (numpy<2.0.0), which robosuite 1.5.2 needs"}`.

    Attributes:
      package, version: what is installed.
      needed: what mjrun needs: `mujoco>=4`.
      remedy: what to do about it, a line for each possibility.
    """

    def __init__(self, package: str, specifier: str, version: str, requiring: Mapping[str, str]) -> None:
        self.package, self.version, self.needed = package, version, f"{package}{specifier}"
        self.remedy = installation(package, specifier)
        reason = ""
        if requiring:
            names = " and ".join(map(clean, requiring))
            reason = f", as required by {', '.join(map(clean, requiring.values()))}"
            self.remedy = (
                "to use both, install mjrun elsewhere: python -m venv mjrun-env && mjrun-env/bin/pip install mjrun\n"
                f"to use only the models of {names}: {self.remedy}, although pip warns"
            )
        installed = f"{package} {clean(version)} is installed{reason}"
        super().__init__(f"mjrun needs {self.needed}, but {installed}\n{self.remedy}")


class ControllerError(UsageError):
    """A controller cannot be had, failed, or gave what cannot be taken."""

    @classmethod
    def of(cls, what: str, error: BaseException) -> "ControllerError":
        """Tells that `what` raised `error`, with the traceback from where foreign code begins."""
        kind = type(error).__name__
        trace = error.__traceback__
        while trace and trace.tb_frame.f_globals.get("__name__", "").partition(".")[0] in ("mjrun", "importlib"):
            trace = trace.tb_next
        lines = "".join(traceback.format_exception(type(error), error, trace)).splitlines()
        return cls("\n".join([f"{what} raised {kind}: {clean(str(error))}", *map(clean, lines)]))


class CompiledOverrideError(UsageError):
    """Overrides of a model that is already compiled, each as the option that asks for it and its value."""

    def __init__(self, path: Path | str, overrides: Sequence[tuple[str, str]]) -> None:
        spelled_overrides = ", ".join(f"{option(name)} {clean(value)}" for name, value in overrides)
        super().__init__(
            f"{clean(str(path))} is compiled: {spelled_overrides} cannot be overridden in it\n"
            "overrides are applied to the source before compilation; give the .xml, .urdf or .mjz instead"
        )


# --- 3: the model ----------------------------------------------------------------------------------


class ModelError(MjrunError):
    """The model cannot be found, read or compiled."""

    exit_code = 3


class OutOfMemoryError(ModelError):
    """The simulation of the model needs more memory than there is; `reason` is what the system or MuJoCo says."""

    def __init__(self, reason: str) -> None:
        advice = "look for a large <size memory>, count or resolution in the model, or lift the limit of this process"
        super().__init__(f"memory ran out{f': {clean(reason)}' if reason else ''}\n{advice}")


class ModelNotFoundError(ModelError):
    """There is no such model; `valid` are those there are, under the heading `place`, to compare `name` with."""

    def __init__(
        self, path: Path | str, reason: str, valid: Sequence[str] = (), place: str = "models", name: str | None = None
    ) -> None:
        hint = suggestion(Path(path).name if name is None else name, valid)
        choices = f"\n{clean(place)}: {listing(valid)}" if valid else ""
        super().__init__(f"{clean(str(path))}: {reason}{hint}{choices}")


class BrokenModelError(ModelError):
    """The model is refused; `line` is where, if that is known, and `hint` says what to do."""

    def __init__(self, path: Path, message: str, line: int | None = None, hint: str = "") -> None:
        self.path, self.line, self.hint = path, line, hint
        place = clean(str(path)) + (f":{line}" if line else "")
        lines = [clean(part) for part in message.splitlines() if part.strip()]
        first = f"{place}: {lines[0] if lines else 'cannot be read'}"
        super().__init__("\n".join([first, *lines[1:], *([hint] if hint else [])]))


# --- 4: the simulation -----------------------------------------------------------------------------


class SimulationError(MjrunError):
    """The simulation cannot go on: `step` is the first step that could not be taken, `time` [s] its start."""

    exit_code = 4

    def __init__(self, step: int, time: float, message: str) -> None:
        self.step, self.time = step, time
        super().__init__(message)


class FailedStepError(SimulationError):
    """MuJoCo gave up in the middle of a step, for want of memory as a rule."""

    def __init__(self, step: int, time: float, reason: str) -> None:
        first, *rest = (clean(line) for line in (reason or "it gave no reason").splitlines())
        failure = f"MuJoCo failed at step {step}, time {time:.9g} s: {first}"
        advice = [MORE_MEMORY] if ARENA in reason else []
        super().__init__(step, time, "\n".join([failure, *map(str.strip, rest), *advice]))


class UnstableError(SimulationError):
    """The simulation diverged."""

    def __init__(self, step: int, time: float, quantity: str, joint: str, timestep: float) -> None:
        self.joint = joint
        super().__init__(
            step,
            time,
            f"the simulation became unstable at step {step}, time {time:.9g} s: "
            f"{quantity} of {clean(joint)} is not finite or too large\n"
            f"a smaller {option('timestep')} than {timestep:g} s may cure it, or another {option('integrator')}: "
            "implicitfast where damping or contacts are stiff, rk4 for fast free motion",
        )


class InvalidActionError(SimulationError):
    """A policy answered with numbers that are not finite.

    Args:
      policy: its name.
      values: the actions that are not finite, by name.
    """

    def __init__(self, step: int, time: float, policy: str, values: Mapping[str, float]) -> None:
        shown = listing([f"{name} = {value:g}" for name, value in values.items()])
        super().__init__(
            step,
            time,
            f"the policy {clean(policy)} answered at step {step}, time {time:.9g} s, what is not finite: {shown}",
        )


# --- 5: rendering ----------------------------------------------------------------------------------


class RendererError(MjrunError):
    """There is no way to draw here."""

    exit_code = 5


class NoRendererError(RendererError):
    """Nothing can draw; `tried` maps each backend to its reason."""

    def __init__(self, tried: Mapping[str, str], remedy: str) -> None:
        self.tried = dict(tried)
        reasons = [f"  {name}: {clean(reason)}" for name, reason in tried.items()]
        super().__init__("\n".join(["no working renderer was found", *reasons, remedy]))


class SoftwareRendererError(RendererError):
    """A GPU was required and only software is there."""

    def __init__(self, renderer: str) -> None:
        super().__init__(
            f"{option('require_gpu')}: the only working renderer is software ({clean(renderer)})\n"
            "`mjrun doctor` shows every backend and what to do about it"
        )


class NoWindowError(RendererError):
    """A live view cannot be shown; `tried` maps `window` and `browser` to their reasons."""

    def __init__(self, tried: Mapping[str, str]) -> None:
        self.tried = dict(tried)
        reasons = [f"  {name}: {clean(reason)}" for name, reason in tried.items()]
        remedy = "`mjrun doctor` shows what works here; without a display, leave out the option that forbids a browser"
        super().__init__("\n".join(["there is nothing here to show a simulation in", *reasons, remedy]))


class DrawError(RendererError):
    """The renderer works, and could not draw this."""


# --- 6: encoding -----------------------------------------------------------------------------------


class EncoderError(MjrunError):
    """The encoder failed, or made something other than was promised."""

    exit_code = 6

    def __init__(self, what: str, log: str = "") -> None:
        lines = [f"  {clean(line)}" for line in log.splitlines() if line.strip()]
        if len(lines) > LOGGED:  # the cause comes first, its consequences after
            lines = [*lines[: LOGGED - 2], "  …", lines[-1]]
        super().__init__("\n".join([what, *lines]))


# --- 7: files --------------------------------------------------------------------------------------


class FileError(MjrunError):
    """An output cannot be written, or an input other than the model cannot be read."""

    exit_code = 7

    def __init__(self, path: Path | str, reason: str, hint: str = "") -> None:
        super().__init__(f"{clean(str(path))}: {reason}" + (f"\n{hint}" if hint else ""))


class CellError(FileError):
    """A cell of a table is not a number, which only matters in a column that is read."""


# --- 8: partly done --------------------------------------------------------------------------------


class PartlyDoneError(MjrunError):
    """Some outputs were made and some were not.

    Args:
      made: paths of what was made.
      errors: of what was not, each with the path of its output.

    Attributes:
      made: as the argument.
      failures: the errors as plain values: `output`, `kind`, `message`, `exit_code`.
    """

    exit_code = 8

    def __init__(self, made: Sequence[str], errors: Sequence[tuple[str, MjrunError]]) -> None:
        self.made = list(made)
        self.failures = [
            {"output": path, "kind": type(error).__name__, "message": str(error), "exit_code": error.exit_code}
            for path, error in errors
        ]
        lines = [f"{clean(path)} could not be made: {error.spelled(option)}" for path, error in errors]
        super().__init__("\n".join([*lines, f"made all the same: {listing(made)}"]))


class FailedPointsError(MjrunError):
    """Some points of a study could not be simulated.

    Args:
      statuses: how many points ended in which way, `ok` among them.
    """

    exit_code = 8

    def __init__(self, statuses: Mapping[str, int]) -> None:
        counts = ", ".join(f"{count} {status}" for status, count in statuses.items() if status != "ok")
        super().__init__(f"{counts}, of {sum(statuses.values())} points; the others are in the table")


class LostFilesError(MjrunError):
    """Some files of the points of a study could not be made.

    Args:
      failures: why, of each point by its number.
    """

    exit_code = 8

    def __init__(self, failures: Mapping[int, str]) -> None:
        reasons: dict[str, list[int]] = {}
        for point, message in failures.items():
            reasons.setdefault(message.partition("\n")[0], []).append(point)
        lines = [f"files of point{'s' * (len(p) > 1)} {listing([str(i) for i in p])}: {m}" for m, p in reasons.items()]
        super().__init__("\n".join([*lines, "the results of all points are in the table"]))


class LostEpisodesError(MjrunError):
    """A process that played episodes ended in the middle of them.

    Args:
      seeds: of the episodes that it was to play.
      ending: how it ended, as the end of a sentence.
    """

    exit_code = 8

    def __init__(self, seeds: Sequence[int], ending: str) -> None:
        episodes = f"episodes of seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"episode of seed {seeds[0]}"
        super().__init__(f"the process that played the {episodes} {clean(ending)}")


# --- ended from outside ----------------------------------------------------------------------------


class EndedFromOutsideError(BaseException):
    """The process was told to end. A BaseException, as KeyboardInterrupt is, so that nothing swallows it."""

    exit_code = 130


class TerminatedError(EndedFromOutsideError):
    """SIGTERM or SIGHUP arrived."""

    def __init__(self, number: int) -> None:
        self.exit_code = 128 + number
        super().__init__(signal.Signals(number).name)


class ClosedPipeError(EndedFromOutsideError):
    """Whoever read our standard output is gone."""

    exit_code = 141
