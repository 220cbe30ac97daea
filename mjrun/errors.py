"""Errors that users can cause or meet: one class per cause, each with its exit code and its message.

A class takes facts and writes the message; the command line prints it in one place. The first line of a message states
the problem and its place; further lines list valid choices and what to do next.
"""

import errno
import math
import re
import signal
import unicodedata
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, cast

from mjrun.dataclass import dataclass
from mjrun.platform import system
from mjrun.platform.installation import install_command, pip

LISTED = 24  # names shown before a list is cut
LOGGED = 8  # lines of an encoder's log that are shown
NEAR = 0.6  # least similarity of a suggested name
FAULTS = 50  # problems of a document that are shown
QUOTED = 200  # characters of a name that are shown
SHOWN = 80  # characters of a text from a file that are shown
LINE = 4096  # characters of a line of a message


# Marks around the name of an option in a message. `clean` removes them from untrusted text.
_OPTION = re.compile("\x02([a-z_]*)\x03")
_POINTER = re.compile(r"\n  .*\n +\^(?=\n|$)")  # a line of an expression, and a caret below it

NO_MEMORY = "Could not allocate memory"  # MuJoCo's message when it creates an MjData
NO_THREAD = ("can't start new thread", "thread constructor failed")  # messages of Python and of C++
ARENA = "narena ="  # part of MuJoCo's message when the memory reserved by the model is too small
Spelling = Callable[[str], str]
OptionPath = tuple[str | int, ...]


def option(name: str) -> str:
    """Marks the option `name` in a message; each front end spells it in its way, `--trail-span` or `trail_span`."""
    return f"\x02{name}\x03"


MORE_MEMORY = f"the memory that the model reserves is too small; increase it by {option('set')} size.memory=100M"


def flag(name: str) -> str:
    """Returns the option `name` as the command line spells it: `--trail-span`."""
    return f"--{name.replace('_', '-')}"


def spelled(text: str, spelling: Spelling = str) -> str:
    """Returns `text` with the names of its options spelled by `spelling`; by default, as in Python."""
    return _OPTION.sub(lambda found: spelling(found[1]), text)


def _message(text: str, spelling: Spelling = str) -> str:
    """Cleans the lines of `text`, spells its options and cuts its longest lines in the middle."""
    half = LINE // 2 - 1
    lines = [spelled(_clean_but_options(line), spelling) for line in text.split("\n")]
    return "\n".join(line if len(line) <= LINE else f"{line[:half]}…{line[-half:]}" for line in lines)


def clean(text: str) -> str:
    """Makes control and formatting characters in `text` visible, for a terminal or a table.

    Names in models and file names are untrusted: they may contain escape sequences or newlines.
    """
    if text.isprintable():  # a fast test, even for megabytes
        return text
    return "".join(ascii(c)[1:-1] if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") else c for c in text)


def _clean_but_options(text: str) -> str:
    """Cleans `text` but keeps the marks of its options."""
    return "".join(option(part) if i % 2 else clean(part) for i, part in enumerate(_OPTION.split(text)))


def quoted(name: str) -> str:
    """Quotes and cleans `name`, and cuts it if it is long."""
    return f"'{clean(shortened(name, QUOTED))}'"


def shortened(text: str, most: int = SHOWN) -> str:
    """Returns a text from a file, cut if it is long."""
    return text if len(text) <= most else text[: most - 1] + "…"


def near(name: str, valid: Iterable[str]) -> list[str]:
    """Returns up to three names in `valid` that are most similar to `name`, best first; case is ignored.

    A common suffix, as of files of one format, and the unit of a column do not count as similarity.
    """
    if len(name) > QUOTED:  # comparing it would be slow
        return []
    from difflib import get_close_matches

    by_fold: dict[str, list[str]] = {}
    for spelling in valid:
        by_fold.setdefault(_without_unit(spelling.casefold()), []).append(spelling)
    sought = _without_unit(name.casefold())
    pairs = {fold: _beginnings(sought, fold) for fold in by_fold}
    alike = [fold for fold, (one, other) in pairs.items() if get_close_matches(one, [other], cutoff=NEAR)]
    close = get_close_matches(sought, alike, n=3, cutoff=NEAR)
    return [spelling for fold in close for spelling in by_fold[fold]][:3]


def _without_unit(name: str) -> str:
    """Removes the unit after the name of a column: `vel [m/s]`."""
    return name[: name.rindex(" [")] if name.endswith("]") and " [" in name[1:] else name


def _beginnings(one: str, other: str) -> tuple[str, str]:
    """Removes the suffix after the last dot from both names if it is the same."""
    (first, _, ending), (second, _, other_ending) = one.rpartition("."), other.rpartition(".")
    return (first, second) if first and second and ending == other_ending else (one, other)


def listing(names: Sequence[str]) -> str:
    """Lists `names` separated by commas, cut after `LISTED`."""
    shown = ", ".join(clean(n) or "''" for n in names[:LISTED])
    return shown + (f", … ({len(names):,} in all)" if len(names) > LISTED else "")


def counted(count: int, noun: str) -> str:
    """Formats a number with its noun: `1 row`, `2 rows`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def described_type(value: object) -> str:
    """Returns the type of a value that code has returned, with those of the elements of a tuple: `a str`."""
    kind = type(value).__name__
    elements = cast("tuple[object, ...]", value) if kind == "tuple" else ()
    inner = f" ({listing([type(each).__name__ for each in elements])})" if elements else ""
    return f"a {clean(kind)}{inner}"


def suggestion(name: str, valid: Iterable[str], *meant: str) -> str:
    """Returns ` (did you mean 'x'?)`, or an empty text if no valid name is similar; for `qpso/*`, groups are valid
    too. One of the names suggested for a column is of its group, if any of them is similar.

    Args:
      meant: names that are suggested instead, if any, however they are spelled.
    """
    valid = list(valid)
    if name.endswith("/*"):
        valid = list(dict.fromkeys(f"{each.rpartition('/')[0]}/*" for each in valid if "/" in each))
    close = [*filter(None, meant)]
    if not close:
        others = [each for each in valid if each != name]
        group, slash, _ = name.partition("/")
        fellows = near(name, [each for each in others if slash and each.startswith(f"{group}/")])
        first, *rest = near(name, others) or [""]
        close = [*filter(None, dict.fromkeys([first, *fellows[:1], *rest]))][:3]
    return f" (did you mean {' or '.join(map(quoted, close))}?)" if close else ""


@dataclass(frozen=True)
class FailureReport:
    """The failure of a command: `error` in its JSON document, which may have further keys that depend on the kind.

    Attributes:
      kind: a name for the cause, such as UnknownNameError.
      message: the problem and its place, then valid choices and what to do next.
      exit_code: the exit code of the command.
      facts: the further keys.
    """

    kind: str
    message: str
    exit_code: int
    facts: Mapping[str, object] = field(default_factory=dict[str, object])

    @classmethod
    def of(cls, error: "MjrunError") -> "FailureReport":
        """Returns the failure that `error` represents, with its public attributes as facts."""
        hidden = ("results", "path", "file")
        facts = {name: plain(v) for name, v in vars(error).items() if name not in hidden and not name.startswith("_")}
        return cls(type(error).__name__, error.spelled(flag), error.exit_code, facts)

    def document(self) -> dict[str, object]:
        """Returns the JSON object."""
        return {**self.facts, "kind": self.kind, "message": self.message, "exit_code": self.exit_code}


def plain(value: object) -> object:
    """Converts `value` to JSON types; values without such a type become text."""
    match value:
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else str(value)
        case DocumentProblem():
            return value._asdict()
        case Mapping():
            return {str(key): plain(each) for key, each in cast("Mapping[object, object]", value).items()}
        case list() | tuple():
            return [plain(each) for each in cast("Sequence[object]", value)]
        case _:
            return str(value)


class MjrunWarning(UserWarning):
    """A circumstance that may make a result differ from expectations, reported through Python's warnings."""


class MjrunError(Exception):
    """Base of all errors that a user can cause or meet. Its message is safe to print on a terminal.

    Attributes:
      results: results of outputs that were published in spite of the error.
    """

    exit_code = 70
    results: Sequence[Any] = ()
    _is_located = False
    _marked: Mapping[str, str] = {}  # notes with marks around their options, by what tracebacks print

    def __str__(self) -> str:
        return _message(super().__str__())

    def add_note(self, note: str, /) -> None:
        """Adds a note. Tracebacks print it, and spell its options as in Python."""
        shown = _message(note)
        self._marked = {**self._marked, shown: note}
        super().add_note(shown)

    def locate(self, place: str) -> None:
        """Puts the place in a document that names the subject of the error before its message, unless it has one."""
        if not self._is_located:
            self.args, self._is_located = (f"{place}: {self.args[0]}",), True

    def spelled(self, spelling: Spelling) -> str:
        """Returns the message and its notes, with options as `spelling` writes their names."""
        notes = [self._marked.get(note, note) for note in getattr(self, "__notes__", ())]
        return _message("\n".join([super().__str__(), *notes]), spelling)


# --- 1: a negative result ---------------------------------------------------------------------------


class FailedAssertionError(MjrunError):
    """A failed assertion about a simulation; `messages` give the assertion, the place and the actual value."""

    exit_code = 1

    def __init__(self, messages: Sequence[str]) -> None:
        self.messages = tuple(messages)
        super().__init__("\n".join(f"{'assertion failed: ' if not i else ''}{m}" for i, m in enumerate(messages)))


class GoldenDifferenceError(MjrunError):
    """A difference between a simulation and its golden table; `messages` give the places and the amounts."""

    exit_code = 1

    def __init__(self, messages: Sequence[str]) -> None:
        self.messages = tuple(messages)
        super().__init__("\n".join([*messages, f"{option('update')} replaces the golden table by this result"]))


class EmptyDatasetError(MjrunError):
    """A dataset without images, because all `rejected` ones violate its conditions; `place` has their labels."""

    exit_code = 1

    def __init__(self, rejected: int, place: str) -> None:
        super().__init__(f"{option('accept')} omits all {counted(rejected, 'image')}; {clean(place)} has their labels")


class UnidentifiableError(MjrunError):
    """Measurements that do not determine the parameters of a fit; `messages` name them, `hints` give likely reasons."""

    exit_code = 1

    def __init__(self, messages: Sequence[str], hints: Sequence[str] = ()) -> None:
        self.messages = tuple(messages)
        advice = "leave them out, give a prior, or measure other signals or motions"
        to_continue = f"{advice}; {option('allow_unidentifiable')} continues regardless"
        super().__init__("\n".join([*messages, *hints, to_continue]))


class UnimprovedFitError(MjrunError):
    """A fitted model that predicts held-out data no better than the original; `message` gives the errors."""

    exit_code = 1


# --- 2: wrong usage --------------------------------------------------------------------------------


class UsageError(MjrunError):
    """Invalid options or option values.

    Attributes:
      path: the invalid option and the place in its value: `("camera", 0, "lookat")`; empty if unknown.
    """

    exit_code = 2

    def __init__(self, message: str, path: OptionPath = ()) -> None:
        super().__init__(message)
        first = _OPTION.search(message)
        self.path: OptionPath = path or ((first[1],) if first else ())

    def one_line(self, path: OptionPath = ()) -> str:
        """Returns the message in one line, without a caret, and without the leading option if it ends `path`."""
        message = "; ".join(part for part in _POINTER.sub("", self.spelled(str)).splitlines() if part)
        names = [part for part in path if isinstance(part, str)]
        message = message.removeprefix(f"{names[-1]}: ") if names else message
        return message.removeprefix(f"{names[-2]} {names[-1]}: ") if len(names) > 1 else message


class UnrelatedTableError(UsageError):
    """A golden table of another model; or one that mjrun has not made, and that has no measured column."""


class DeviceMemoryError(UsageError):
    """Simulations that do not fit in the memory of a device together."""


@contextmanager
def concerning(*path: str | int) -> Generator[None]:
    """Adds the option, and the part of its value, to a UsageError that is raised in the `with` block."""
    try:
        yield
    except UsageError as error:
        if error.path == path[: len(error.path)]:
            error.path = path
        elif error.path[: len(path)] != path:
            error.path = (*path, *error.path)
        raise


@contextmanager
def attributing(name: str, determining: str) -> Generator[None]:
    """Attributes a UsageError in the `with` block about the option `name`, or about none, to the one that sets it."""
    try:
        yield
    except UsageError as error:
        if error.path[:1] in ((), (name,)):
            error.path = (determining, *error.path[1:])
        raise


def _choices(name: str, valid: Sequence[str]) -> str:
    """Lists valid names; of many, those of the same group, or else the groups: `qpos/*`."""
    if len(valid) <= LISTED:
        return listing(valid)
    groups = dict[str, list[str]]()
    for each in valid:
        groups.setdefault(each.partition("/")[0], []).append(each)
    group, slash, _ = name.partition("/")
    if slash and group in groups:
        return listing(groups[group])
    words = [names[0] if len(names) == 1 else f"{word}/*" for word, names in groups.items()]
    if len(words) == len(valid):
        return listing(valid)
    more = ", …" if len(words) > LISTED else ""
    return f"{', '.join(map(clean, words[:LISTED]))}{more} ({len(valid):,} in all)"


class UnknownNameError(UsageError):
    """A name that is not one of the valid ones."""

    def __init__(
        self,
        kind: str,
        name: str,
        valid: Sequence[str],
        where: str = "",
        plural: str = "",
        meant: Sequence[str] = (),
    ) -> None:
        plural = plural or f"{kind}s"
        self.name, self.valid, self._meant = name, tuple(valid), tuple(meant)
        choices = f"{plural}: {_choices(name, valid)}" if valid else f"there are no {plural}"
        place = f" in {_clean_but_options(where)}" if where else ""
        super().__init__(f"no {kind} {quoted(name)}{place}{suggestion(name, valid, *meant)}\n{choices}")

    @property
    def meant(self) -> Sequence[str]:
        """The names that are suggested in place of similar ones."""
        return self._meant


class BadValueError(UsageError):
    """A value of the wrong type, size or range; `what` is its name, usually `option("fps")`."""

    def __init__(self, what: str, value: object, expected: str) -> None:
        self.value = str(value)
        super().__init__(f"{what}: {quoted(self.value)} is not {expected}")


class DocumentProblem(NamedTuple):
    """A problem in a document, at `place`, `shots.yaml:12:5`, and at `path` in it, `shots[1].orbit`."""

    place: str
    path: str
    message: str

    def __str__(self) -> str:
        return ": ".join(clean(part) for part in self if part)


class DocumentError(UsageError):
    """An invalid document; lists every problem, one per line."""

    def __init__(self, problems: Sequence[DocumentProblem]) -> None:
        self.problems = tuple(problems)
        hidden = len(problems) - FAULTS
        more = [f"… and {hidden} more problem{'s' if hidden > 1 else ''}"] if hidden > 0 else []
        super().__init__("\n".join([*map(str, problems[:FAULTS]), *more]))


class FaultyRequestsError(UsageError):
    """Problems of requests in one pass: `faults`, each with the index of its request, or None for the simulation."""

    def __init__(self, faults: Sequence[tuple[int | None, UsageError]]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(dict.fromkeys(error.spelled(option) for _, error in faults)))


# Packages that share the folder of another one: replacing that one by an older version removes their files.
SHARING = {"mujoco": "mujoco-core mujoco-studio"}


def installation(package: str, specifier: str) -> str:
    """Returns the command that installs a version of a package over any installed one."""
    removal = f"{pip('uninstall')} -y {package} {SHARING[package]} && " if package in SHARING else ""
    return f"{removal}{pip('install')} '{package}{specifier}'"


class MissingExtraError(UsageError):
    """A feature that needs a library which only an extra of mjrun installs, or, without an extra, only the user."""

    def __init__(self, what: str, library: str, extra: str = "") -> None:
        self.library = library
        command = install_command(f"mjrun[{extra}]" if extra else library)
        super().__init__(f"{what} needs {library}, which is not installed\n{command}")


class DamagedPackageError(UsageError):
    """A required package that is installed but cannot be imported."""

    def __init__(self, package: str, version: str, reason: str) -> None:
        sentence = clean(reason.strip().partition("\n")[0].partition(". ")[0])
        super().__init__(f"{package} {clean(version)} is damaged: {sentence}\n{installation(package, f'=={version}')}")


class WrongVersionError(UsageError):
    """A required package that is installed in another version.

    Args:
      specifier: the versions that mjrun requires: `>=4`.
      requiring: the packages that require another version, by the installed packages that depend on them:
        `{"robosuite": "mink 0.0.5 (numpy<2.0.0), which robosuite 1.5.2 needs"}`.

    Attributes:
      package, version: the installed package.
      needed: the required versions: `mujoco>=4`.
      remedy: instructions, one line per alternative.
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
    """A controller that cannot be loaded, that failed, or that returned invalid controls."""

    @classmethod
    def of(cls, what: str, error: BaseException) -> "ControllerError":
        """Reports that `what` raised `error`, with the traceback from the first line of the user's code."""
        import traceback

        lines = "".join(traceback.format_exception(type(error), error, _traceback_of_user(error))).splitlines()
        return cls("\n".join([f"{what} raised {exception_text(error)}", *map(clean, lines)]))


def exception_text(error: BaseException) -> str:
    """Returns the class, message and place of an exception, on one line: `IndexError: no index (policy.py:3)`.

    The place is the last line in the file in which the user's code begins; for a bug in mjrun, the line that raised.
    """
    import traceback

    users, frames = traceback.extract_tb(_traceback_of_user(error)), traceback.extract_tb(error.__traceback__)
    frames = [frame for frame in users if frame.filename == users[0].filename] or frames
    message = " ".join(str(error).split())
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return clean(f"{type(error).__name__}{message and ': '}{message}{place}")


def _traceback_of_user(error: BaseException) -> TracebackType | None:
    """Returns the traceback of an exception from the first line that is not mjrun's; None without one."""
    trace = error.__traceback__
    while trace and trace.tb_frame.f_globals.get("__name__", "").partition(".")[0] in ("mjrun", "importlib"):
        trace = trace.tb_next
    return trace


class CompiledOverrideError(UsageError):
    """Overrides of a compiled model, each with its option and its value."""

    def __init__(self, path: Path | str, overrides: Sequence[tuple[str, str]]) -> None:
        spelled_overrides = ", ".join(f"{option(name)} {clean(value)}" for name, value in overrides)
        super().__init__(
            f"{clean(str(path))} is compiled: {spelled_overrides} cannot be overridden in it\n"
            "overrides are applied to the source before compilation; give the .xml, .urdf or .mjz instead"
        )


# --- 3: the model ----------------------------------------------------------------------------------


class ModelError(MjrunError):
    """A model that cannot be found, read or compiled."""

    exit_code = 3


LESS_MEMORY = "look for a large <size memory>, count or resolution in the model, or raise the limit of this process"


class OutOfMemoryError(ModelError):
    """A simulation that needs more memory than is available; `reason` is the message of the system or of MuJoCo."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"memory ran out{f': {clean(reason)}' if reason else ''}\n{LESS_MEMORY}")


class ModelNotFoundError(ModelError):
    """A model that does not exist; `valid` lists existing ones, under the heading `place`, to compare `name` with.

    Args:
      meant: names that are suggested instead of similar ones.

    Attributes:
      file: the path, or the name in a collection.
    """

    def __init__(
        self,
        path: Path | str,
        reason: str,
        valid: Sequence[str] = (),
        place: str = "models",
        name: str | None = None,
        meant: Sequence[str] = (),
    ) -> None:
        hint = suggestion(Path(path).name if name is None else name, valid, *meant)
        choices = f"\n{clean(place)}: {listing(valid)}" if valid else ""
        self.file = str(path)
        super().__init__(f"{clean(self.file)}: {reason}{hint}{choices}")


class BrokenModelError(ModelError):
    """A rejected model; `line` is the place, if known, and `hint` the remedy."""

    def __init__(self, path: Path, message: str, line: int | None = None, hint: str = "") -> None:
        self.path, self.line, self.hint = path, line, hint
        place = clean(str(path)) + (f":{line}" if line else "")
        lines = [clean(part) for part in message.splitlines() if part.strip()]
        first = f"{place}: {lines[0] if lines else 'cannot be read'}"
        super().__init__("\n".join([first, *lines[1:], *([hint] if hint else [])]))


# --- 4: the simulation -----------------------------------------------------------------------------


class SimulationError(MjrunError):
    """A simulation that cannot continue: `step` is the first step that failed, `time` [s] its start."""

    exit_code = 4

    def __init__(self, step: int, time: float, message: str) -> None:
        self.step, self.time = step, time
        super().__init__(message)


class FailedStepError(SimulationError):
    """A step that MuJoCo aborted, usually for lack of memory."""

    def __init__(self, step: int, time: float, reason: str) -> None:
        first, *rest = (clean(line) for line in (reason or "no reason reported").splitlines())
        failure = f"MuJoCo failed at step {step}, time {time:.9g} s: {first}"
        advice = [MORE_MEMORY] if ARENA in reason else []
        super().__init__(step, time, "\n".join([failure, *map(str.strip, rest), *advice]))


class ContactMemoryError(SimulationError):
    """A step without some of its contacts or constraints, for which the model reserves too little memory.

    MuJoCo only warns and continues, with results that are wrong.
    """

    def __init__(self, step: int, time: float) -> None:
        what = f"MuJoCo left out contacts or constraints at step {step}, time {time:.9g} s"
        super().__init__(step, time, f"{what}\n{MORE_MEMORY}")


class UnstableError(SimulationError):
    """A simulation that diverged."""

    def __init__(self, step: int, time: float, quantity: str, joint: str, timestep: float) -> None:
        self.joint = joint
        super().__init__(
            step,
            time,
            f"the simulation became unstable at step {step}, time {time:.9g} s: "
            f"{quantity} of {clean(joint)} is not finite or too large\n"
            f"try a {option('timestep')} smaller than {timestep:g} s, or another {option('integrator')}: "
            "implicitfast where damping or contacts are stiff, rk4 for fast free motion",
        )


class UnstableWorldError(SimulationError):
    """A world of MuJoCo Warp that diverged between the rows at two steps."""

    def __init__(self, step: int, row: int, timestep: float) -> None:
        time = step * timestep
        super().__init__(
            step,
            time,
            f"the simulation became unstable after step {step}, time {time:.9g} s, and not later than step {row}\n"
            f"a smaller {option('timestep')} may prevent it; mujoco_warp computes in single precision",
        )


class InvalidActionError(SimulationError):
    """A policy that returned non-finite actions.

    Args:
      policy: the name of the policy.
      values: the non-finite actions, by name.
    """

    def __init__(self, step: int, time: float, policy: str, values: Mapping[str, float]) -> None:
        shown = listing([f"{name} = {value:g}" for name, value in values.items()])
        super().__init__(
            step,
            time,
            f"policy {clean(policy)} returned non-finite actions at step {step}, time {time:.9g} s: {shown}",
        )


# --- 5: rendering ----------------------------------------------------------------------------------


class InvalidEpisodeError(SimulationError):
    """An episode with a number that its dataset may not contain.

    Args:
      what: the kind of the number: `observation`, `action` or `reward`.
      name: the name of the number; empty for none.
      row: the row of the episode.
      reason: what is wrong with it.
    """

    def __init__(self, step: int, time: float, what: str, name: str, row: int, reason: str = "is not finite") -> None:
        shown = f"{what} {clean(name)}" if name else what
        super().__init__(step, time, f"the {shown} {reason} in row {row} of the episode, at {time:.9g} s")


class RendererError(MjrunError):
    """A failure to render on this machine."""

    exit_code = 5


class NoRendererError(RendererError):
    """No backend can render; `tried` maps each backend to its reason."""

    def __init__(self, tried: Mapping[str, str], remedy: str) -> None:
        self.tried = dict(tried)
        reasons = [f"  {name}: {clean(reason)}" for name, reason in tried.items()]
        super().__init__("\n".join(["no working renderer was found", *reasons, remedy]))


class SoftwareRendererError(RendererError):
    """Only software rendering is available although a GPU is required."""

    def __init__(self, renderer: str) -> None:
        super().__init__(
            f"{option('require_gpu')}: the only working renderer is software ({clean(renderer)})\n"
            "`mjrun doctor` shows the state of every backend and how to fix it"
        )


class NoWindowError(RendererError):
    """A live view that cannot open; `tried` maps `window` and `browser` to their reasons."""

    def __init__(self, tried: Mapping[str, str]) -> None:
        self.tried = dict(tried)
        reasons = [f"  {name}: {clean(reason)}" for name, reason in tried.items()]
        remedy = "`mjrun doctor` shows what works here; without a display, allow the browser"
        super().__init__("\n".join(["neither a window nor a browser view can open here", *reasons, remedy]))


class DrawError(RendererError):
    """An image that a working renderer could not render."""


# --- 6: encoding -----------------------------------------------------------------------------------


class EncoderError(MjrunError):
    """An encoder that failed or wrote something other than requested."""

    exit_code = 6

    def __init__(self, what: str, log: str = "") -> None:
        lines = [f"  {clean(line)}" for line in log.splitlines() if line.strip()]
        if len(lines) > LOGGED:  # the cause comes first, its consequences after
            lines = [*lines[: LOGGED - 2], "  …", lines[-1]]
        super().__init__("\n".join([what, *lines]))


# --- 7: files --------------------------------------------------------------------------------------


class FileError(MjrunError):
    """An output that cannot be written, or an input other than the model that cannot be read; `file` is its path."""

    exit_code = 7

    def __init__(self, path: Path | str, reason: str, hint: str = "") -> None:
        self.file = str(path)
        text = re.sub(r"^file:/(?!/)", "file:///", str(path))
        text = re.sub(r"^([a-zA-Z][a-zA-Z0-9+.-]+:)/(?!/)", r"\1//", text)  # of a URL, which a path shortens
        super().__init__(f"{clean(text)}: {reason}" + (f"\n{hint}" if hint else ""))


@contextmanager
def file_errors(path: Path | str, how: str = "read", unless: type[OSError] | tuple[()] = ()) -> Generator[None]:
    """Turns errors of the operating system in the `with` block into a FileError: the file cannot be `how`."""
    try:
        yield
    except unless:
        raise
    except OSError as error:
        advice = _more_files(error.errno)
        raise FileError(path, f"cannot be {how}: {error.strerror or error}", advice) from None


class SystemLimitError(MjrunError):
    """A file, a process or a thread that the system refuses because there are too many."""

    exit_code = 7


def system_limit(error: BaseException) -> MjrunError | None:
    """Returns the error of the limit of the system that an exception reports; None for other exceptions."""
    if isinstance(error, SystemLimitError):
        return error
    number, reason = (error.errno, error.strerror) if isinstance(error, OSError) else (None, str(error))
    if isinstance(error, MemoryError) or number == errno.ENOMEM or NO_MEMORY in str(error):
        return OutOfMemoryError(str(error))
    if advice := _more_files(number):
        return SystemLimitError(f"{reason}\n{advice}")
    # The error of a write that would block has the number of written bytes, that of a process has none.
    no_process = number == errno.EAGAIN and not hasattr(error, "characters_written")
    if no_process or any(text in str(error) for text in NO_THREAD):
        advice = f"`ulimit -u` and the container limit how many a user may have; {option('jobs')} 1 needs fewest"
        return SystemLimitError(f"the system starts no other process or thread: {reason}\n{advice}")
    return None


def _more_files(number: int | None) -> str:
    """Returns how to open more files after an error of this number; empty for other errors."""
    if number == errno.EMFILE:
        most = system.most_open_files()
        return f"this process may have {most:,} open files; `ulimit -n {max(1024, 4 * most)}` allows more"
    return "all processes of this machine together have as many as it allows" if number == errno.ENFILE else ""


class CellError(FileError):
    """A table cell that is not a number; an error only in columns that are read."""


# --- 8: partly done --------------------------------------------------------------------------------


class PartlyDoneError(MjrunError):
    """Outputs that failed beside others that were made.

    Args:
      made: paths of the outputs that were made.
      errors: the errors of the other outputs, each with the path of its output.

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
        super().__init__("\n".join([*lines, f"made: {listing(made)}"]))


class FailedPointsError(MjrunError):
    """Points of a study that could not be simulated.

    Args:
      statuses: the number of points by status, `ok` included.
    """

    exit_code = 8

    def __init__(self, statuses: Mapping[str, int]) -> None:
        counts = ", ".join(f"{count} {status}" for status, count in statuses.items() if status != "ok")
        super().__init__(f"{counts}, of {sum(statuses.values())} points; the table has the others")


class FailedEpisodesError(MjrunError):
    """Episodes that a dataset or an evaluation lacks, because they could not be simulated.

    Args:
      failures: the message of each episode, by its number or the seed that identifies it. Only the first is shown in
        full: its other lines may be a traceback.
      count: the number of requested episodes.
      place: the word for what lacks them.
      missing: the number of episodes that are not simulated yet.
    """

    exit_code = 8

    def __init__(self, failures: Mapping[str, str], count: int, place: str = "dataset", missing: int = 0) -> None:
        reasons: dict[str, list[str]] = {}
        for name, message in failures.items():
            reasons.setdefault(message.partition("\n")[0], []).append(name)
        lines = [f"{listing(names)}: {clean(message)}" for message, names in reasons.items()]
        details = [f"  {clean(line)}" for message in [*failures.values()][:1] for line in message.split("\n")[1:]]
        lines[1:1] = details
        states = [(len(failures), "failed"), (missing, "are not simulated yet")]
        counts = ", ".join(f"{number} of {counted(count, 'episode')} {state}" for number, state in states if number)
        rest = f"the {place} has the others" if len(failures) + missing < count else f"there is no {place}"
        super().__init__("\n".join([f"{counts}; {rest}", *lines[: LOGGED + len(details)]]))


class UnmadeFilesError(MjrunError):
    """Files of points of a study that could not be made.

    Args:
      failures: the reason for each point, by its number.
    """

    exit_code = 8

    def __init__(self, failures: Mapping[int, str]) -> None:
        reasons: dict[str, list[int]] = {}
        for point, message in failures.items():
            reasons.setdefault(message.partition("\n")[0], []).append(point)
        lines = [f"files of point{'s' * (len(p) > 1)} {listing([str(i) for i in p])}: {m}" for m, p in reasons.items()]
        super().__init__("\n".join([*lines, "the results of all points are in the table"]))


# --- ended from outside ----------------------------------------------------------------------------


class EndRequestedError(BaseException):
    """A request to end the process. A BaseException like KeyboardInterrupt, so that no handler of exceptions catches
    it.
    """

    exit_code = 130


class TerminatedError(EndRequestedError):
    """The signal SIGTERM or SIGHUP."""

    def __init__(self, number: int) -> None:
        self.exit_code = 128 + number
        super().__init__(signal.Signals(number).name)


class ClosedPipeError(EndRequestedError):
    """The reader of standard output closed the pipe."""

    exit_code = 141
