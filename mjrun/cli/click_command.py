"""Commands made from declared options: click parameters, help by section, and typed values.

click calls `DeclaredCommand.invoke`, which calls the function that `command` has decorated.
"""

import faulthandler
import gc
import re
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from mjrun.cli.console import Console, HelpContext, flag, shown_help
from mjrun.dataclass import dataclass
from mjrun.errors import UsageError, clean, listing, near, quoted, suggestion
from mjrun.errors import option as mention
from mjrun.options.every_command import DOCUMENT_FORMS, ConfinementOptions, ConsoleOptions, OpenWhenDoneOptions
from mjrun.options.kinds import AnyKind, ChoiceKind, FlagKind, OneOrMoreKind
from mjrun.options.option import OTHER_NAMES, FrontEnd, Option, OptionRequirement, Options, given_values, options_of
from mjrun.options.schema_validation import InvalidValueError
from mjrun.options.setting_kinds import ColumnDefinitionsKind, NamedNumbersKind, SettingsKind

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

C = TypeVar("C", bound=Options)
Body = Callable[[Console, "ParsedCommandLine"], None]


ON_FILES = (OpenWhenDoneOptions, ConfinementOptions)  # of commands that may read untrusted files, and make others
# Sections that several commands share; they follow the sections of a single command.
SHARED_SECTIONS = ("View", "Renderer", "Simulation", "Policy", "Model", "Output", "Trust", "Messages")
TERM_WIDTH = 26  # columns of help for an option's spelling, with the gap before its text
SHORT_DEFAULT = 24  # characters that are kept on one line
MODULE_OBJECTS = 100_000  # more than any command imports: they are not garbage
WORDS = f"{__name__}.words"  # the key in a context of the words on the command line
REPLACED = f"{__name__}.replaced"  # and of warnings about values that a later one replaces


class ParsedCommandLine:
    """A parsed command line: its options and arguments by name, from which typed values are made."""

    def __init__(self, params: Mapping[str, object]) -> None:
        self._params = {name: value for name, value in params.items() if value is not None}

    def make(self, cls: type[C], **values: object) -> C:
        """Makes a `cls` with the options of this command line; `values` take precedence.

        Raises:
          UsageError: options exclude each other.
        """
        options = {each.attribute: self._params[each.name] for each in options_of(cls) if each.name in self._params}
        return cls(**{**options, **values})

    def require(self, requirement: OptionRequirement, made: Options) -> None:
        """Checks that an option of the command itself has its partner among the options of the product.

        Raises:
          UsageError: it has none.
        """
        if self._params.get(requirement.name) and not requirement.is_met(given_values(made)):
            raise UsageError(requirement.message(), (requirement.name,))

    def value(self, name: str) -> object:
        """Returns the value of an option, or None if it is left out."""
        return self._params.get(name)

    def explicit(self, *classes: type[Options]) -> dict[str, object]:
        """Returns the explicit options of classes, by attribute."""
        known = {each.name: each.attribute for cls in classes for each in options_of(cls)}
        return {known[name]: value for name, value in self._params.items() if name in known}

    def with_defaults(self, **defaults: object) -> "ParsedCommandLine":
        """Returns a copy with `defaults` for options that are left out."""
        return ParsedCommandLine({**defaults, **self._params})

    def with_converted(self, name: str, convert: Callable[[str], object]) -> "ParsedCommandLine":
        """Returns a copy with the text of an option converted, or each of its texts."""
        value = self._params.get(name)
        if value is None:
            return self
        if isinstance(value, tuple):
            texts = cast("tuple[object, ...]", value)
            return ParsedCommandLine({**self._params, name: tuple(convert(str(text)) for text in texts)})
        return ParsedCommandLine({**self._params, name: convert(str(value))})

    @property
    def document_form(self) -> str:
        """The option that requests a document instead of prose; empty for prose."""
        return next((name for name in DOCUMENT_FORMS if self._params.get(name)), "")

    def form(self, *names: str) -> str:
        """Returns the option of `names` that requests a form of the report other than prose and documents, or an
        empty text.

        Raises:
          UsageError: several forms are requested.
        """
        asked = [name for name in (*DOCUMENT_FORMS, *names) if self._params.get(name)]
        if len(asked) > 1:
            options = f"{', '.join(map(mention, asked[:-1]))} and {mention(asked[-1])}"
            raise UsageError(
                f"{options} exclude each other: {'both' if len(asked) == 2 else 'all'} print to standard output"
            )
        return next((name for name in asked if name not in DOCUMENT_FORMS), "")

    def argument(self, name: str) -> str:
        """Returns the value of an argument."""
        return str(self._params[name])

    def arguments(self, name: str) -> tuple[str, ...]:
        """Returns the values of a repeatable argument."""
        return cast("tuple[str, ...]", self._params.get(name, ()))


class ModelArgument(click.Argument):
    """An argument that may name a model, a document or a folder of them.

    Attributes:
      written: the command also writes to a folder given as this argument.
      tables: it may also name a table or a folder of them, and `-` is a table.
    """

    def __init__(self, name: str, *, written: bool = False, tables: bool = False, **settings: Any) -> None:
        super().__init__([name], **settings)
        self.written, self.tables = written, tables

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem[str]]":
        from mjrun.cli.commands.completion import model_values

        return model_values(incomplete)


@dataclass(frozen=True)
class CommandDeclaration:
    """The declaration of a command: facts in addition to its options and help, from which lists are derived.

    Attributes:
      options: the classes of its options.
      python: the class of the Python API with these options, or an empty text.
      classes: other classes with options of this command, by their declaration.
      key: the list in run documents whose entries have these options, or an empty text.
      reports: the kinds of JSON documents that it prints, each with its dataclass: `package.module:Class`. A kind that
        differs from the name of the command belongs to the option of this name.
      is_endless: the command runs until the user ends it.
    """

    options: tuple[type[Options], ...] = ()
    python: str = ""
    classes: Mapping[type[Options], str] = field(default_factory=dict[type[Options], str])
    key: str = ""
    reports: Mapping[str, str] = field(default_factory=dict[str, str])
    is_endless: bool = False


class DeclaredCommand(click.Command):
    """A command with declared options, which help shows by section."""

    context_class = HelpContext
    declaration = CommandDeclaration()
    allow_extra_args = True  # `parse_args` refuses them with a hint
    body: Body

    def invoke(self, ctx: click.Context) -> None:
        """Calls the body of the command; standard output is reserved for what it prints."""
        console, command_line = cast("Console", ctx.obj), ParsedCommandLine(ctx.params)
        gc.freeze()
        if not (command_line.value("controller") or command_line.value("policy")):  # whose garbage may be large
            gc.set_threshold(MODULE_OBJECTS)
        gc.enable()
        _set_verbosity(console, command_line)
        for text in ctx.meta.get(REPLACED, ()):
            console.warn(text)
        console.page = cast("str | None", command_line.value("html"))
        with _confined_if_asked(console, command_line):
            console.guard_stdout()
            self.body(console, command_line)
        if command_line.value("open"):
            console.open_file()

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[WORDS] = args
        try:
            extra = super().parse_args(ctx, [*self._with_values(args)])
        except click.NoSuchOption as error:
            typed = error.option_name.removeprefix("--")
            names = [param.name for param in self.params if isinstance(param, click.Option) and param.name]
            name = typed if typed.startswith("-") else typed.replace("-", "_")
            others = OTHER_NAMES.get(name, near(name, names))
            hint = (
                _argument_hint(typed, self.params, ctx)
                or suggestion(typed, (), *(flag(other) for other in others if other in names))
                or _commands_with([error.option_name, *map(flag, others)], ctx)
            )
            raise click.UsageError(f"No such option {quoted(error.option_name)}{hint}.", ctx) from None

        if extra and not ctx.resilient_parsing:
            is_output = "output" in ctx.params and not ctx.params["output"] and Path(extra[0]).suffix
            hint = suggestion(extra[0], (), f"-o {extra[0]}") if is_output else further_value_hint(extra[0], ctx)
            raise click.UsageError(f"Unexpected argument {quoted(extra[0])}{hint}.", ctx)
        return extra

    def _with_values(self, args: Sequence[str]) -> Iterator[str]:
        """Yields the arguments; an option whose value is optional gets one if something else follows it."""
        declared = [param for param in self.params if isinstance(param, DeclaredOption)]
        optional = {name: each for each in declared if each.declared.flag_value is not None for name in each.opts}
        for arg, following in zip_longest(args, args[1:], fillvalue="-"):
            has_value = following.startswith("-") or arg not in optional or optional[arg].takes(following)
            yield arg if has_value else f"{arg}={optional[arg].declared.flag_value}"

    def get_help(self, ctx: click.Context) -> str:
        return shown_help(super().get_help(ctx))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem]":
        for param in self.params:
            if isinstance(param, DeclaredOption) and any(
                name.startswith(incomplete) for name in (*param.opts, *param.secondary_opts)
            ):
                param.write_help()
        return super().shell_complete(ctx, incomplete)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record and isinstance(param, click.Option):
                section = param.declared.section if isinstance(param, DeclaredOption) else ConsoleOptions.section
                sections.setdefault(section, []).append(record)

        for name, records in sections.items():
            with formatter.section(name):
                for spelling, text in records:
                    formatter.write(_help_entry(spelling, text, formatter.current_indent, formatter.width))


def _argument_hint(typed: str, params: Sequence[click.Parameter], ctx: click.Context) -> str:
    """Returns a remark on the argument that a word after `--` names, or an empty text."""
    arguments = [param.make_metavar(ctx) for param in params if isinstance(param, click.Argument)]
    word = typed.upper()
    is_argument = any(word in re.split(r"[^A-Z]+", metavar) for metavar in arguments)
    return f" ({word} is an argument: write it without {flag(typed)})" if is_argument else ""


def _commands_with(spellings: Sequence[str], ctx: click.Context) -> str:
    """Returns a remark on the other commands that have an option, of the first of `spellings` that any of them has, or
    an empty text.
    """
    group = ctx.parent.command if ctx.parent else None
    if not isinstance(group, click.Group):
        return ""
    commands = [command for name in group.list_commands(ctx) if (command := group.get_command(ctx, name))]
    for spelling in spellings:
        having = [f"mjrun {each.name}" for each in commands if any(spelling in param.opts for param in each.params)]
        if having and spelling == spellings[0]:
            return f" (an option of {listing(having)})"
        if having:
            return f" (did you mean {quoted(spelling)}, an option of {listing(having)}?)"
    return ""


def _help_entry(spelling: str, text: str, indent: int, width: int) -> str:
    """Formats an option with its text beside it, or below a long spelling; examples are not broken."""
    import textwrap  # which compiles patterns that only help needs

    column = " " * (indent + TERM_WIDTH)
    lines = textwrap.wrap(text, width - len(column), break_on_hyphens=False, break_long_words=False)
    first = f"{'':{indent}}{spelling}"
    if len(spelling) > TERM_WIDTH - 2:
        lines = [first, *(column + line for line in lines)]
    else:
        lines = [first.ljust(len(column)) + lines[0], *(column + line for line in lines[1:])]
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ") + "\n"


class DeclaredOption(click.Option):
    """An option of the command line, made from its declaration."""

    def __init__(self, declared: Option) -> None:
        self.declared = declared
        kind, names = declared.kind, [*declared.short, "/".join(flags(declared)), declared.name]
        if isinstance(kind, FlagKind):
            super().__init__(names, is_flag=True, default=None)
            return
        each = kind.repeated if isinstance(kind, OneOrMoreKind) else kind
        chosen = _Choice(each.names, case_sensitive=False) if isinstance(each, ChoiceKind) else _KindType(each)
        metavar = None if isinstance(each, ChoiceKind) else kind.metavar
        optional: dict[str, Any] = {}
        if declared.flag_value is not None:
            optional |= {"is_flag": False, "flag_value": declared.flag_value}
        super().__init__(names, type=chosen, multiple=True, metavar=metavar, default=None, **optional)

    def takes(self, text: str) -> bool:
        """Returns whether a text is a value of this option, perhaps a wrong one."""
        try:
            self.declared.kind.parse(text)
        except InvalidValueError:
            return "=" in text
        return True

    def write_help(self) -> None:
        """Sets the help text, which is made only on request because it lists formats."""
        self.help = _help(self.declared)

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        self.write_help()
        return super().get_help_record(ctx)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem[str]]":
        from mjrun.cli.commands.completion import option_values

        # Without the value that is being completed, click parses options only: arguments remain.
        model = ctx.params.get("model") or next(iter(ctx.args), None)
        values = option_values(self.declared.name, self.declared.kind.metavar, model, incomplete)
        return values or super().shell_complete(ctx, incomplete)

    def type_cast_value(self, ctx: click.Context, value: object) -> object:
        made, kind = super().type_cast_value(ctx, value), self.declared.kind
        if not (self.multiple and made):
            return None if self.multiple else made
        if is_repeatable(self.declared) and not isinstance(kind, NamedNumbersKind):
            return _gathered(kind, made)
        last = dict[str, str]()  # the text of the last value, by its name
        for text, each in zip(cast("Sequence[str]", value), made, strict=True):
            name = each[0] if isinstance(kind, NamedNumbersKind) else ""
            before, last[name] = last.get(name, text), text
            if before != text:
                replaced: list[str] = ctx.meta.setdefault(REPLACED, [])
                replaced.append(f"{self.opts[-1]} {clean(before)} has no effect, because {clean(text)} follows")
        return dict(made) if isinstance(kind, NamedNumbersKind) else made[-1]


class _Choice(click.Choice[str]):
    """One of several words; a wrong one is answered with those that are similar."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            message = f"{error.message.removesuffix('.')}{suggestion(value, self.choices)}."
            raise click.BadParameter(message, ctx, param) from None


class _KindType(click.ParamType[object]):
    """A kind of option values as a click type."""

    def __init__(self, kind: AnyKind) -> None:
        self._kind, self.name = kind, kind.metavar

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> object:
        if not isinstance(value, str):
            return value
        try:
            return self._kind.parse(value)
        except InvalidValueError as error:
            self.fail(f"{(value if error.part is None else error.part)!r} is not {error.expected}", param, ctx)


def further_value_hint(word: str, ctx: click.Context) -> str:
    """Returns ` (did you mean '--vary WORD'?)` for a word after the value of a repeatable option, or an empty text."""
    args = cast("Sequence[str]", ctx.meta[WORDS])
    declared = [param for param in ctx.command.params if isinstance(param, DeclaredOption)]
    repeatable = {name for param in declared if is_repeatable(param.declared) for name in param.opts}
    before = [name for name, _, other in zip(args, args[1:], args[2:], strict=False) if other == word]
    return suggestion(word, (), f"{before[0]} {word}" if before and before[0] in repeatable else "")


def command(
    *classes: type[Options],
    name: str = "",
    arguments: Sequence[click.Argument] = (),
    without: Sequence[str] = (),
    cls: type[DeclaredCommand] = DeclaredCommand,
    **facts: Any,
) -> Callable[[Body], DeclaredCommand]:
    """Turns a function of a console and a command line into a command with the options of `classes`.

    Args:
      name: the name of the command; by default, that of the function.
      without: names of options that this command does not accept.
      cls: the class of the command.
      facts: further attributes of its `CommandDeclaration`.
    """

    def decorate(body: Body) -> DeclaredCommand:
        declared = {each.name: each for cls in (*classes, ConsoleOptions) for each in options_of(cls)}
        known = [each for each in declared.values() if FrontEnd.COMMAND in each.places and each.name not in without]
        params: list[click.Parameter] = [*arguments, *map(DeclaredOption, sorted(known, key=_section_rank))]
        made = cls(name or body.__name__, params=params, help=body.__doc__)
        made.declaration, made.body = CommandDeclaration(classes, **facts), body
        return made

    return decorate


@contextmanager
def _confined_if_asked(console: Console, command_line: ParsedCommandLine) -> Generator[None, None, None]:
    """Confines this process to the files on the command line if it has the option --untrusted."""
    options = command_line.make(ConfinementOptions)
    if options.untrusted and command_line.value("open"):
        raise UsageError(f"{mention('open')} starts another program, which {mention('untrusted')} prevents")
    if not options.untrusted:
        for name in ("root", "limit"):
            if command_line.value(name) is not None:
                raise UsageError(f"{mention(name)} requires {mention('untrusted')}")
        yield
        return
    from mjrun.cli.command_confinement import confined, description

    with confined(click.get_current_context(), options) as limits:
        console.note(description(limits))
        yield


def _section_rank(declared: Option) -> int:
    return SHARED_SECTIONS.index(declared.section) + 1 if declared.section in SHARED_SECTIONS else 0


def _set_verbosity(console: Console, command_line: ParsedCommandLine) -> None:
    messages = command_line.make(ConsoleOptions)
    console.verbosity = -1 if messages.quiet else 1 if messages.verbose else 0
    console.debug, console.document_form = messages.debug, command_line.document_form
    if messages.debug and sys.__stderr__:
        faulthandler.enable(sys.__stderr__)  # shows the traceback of a crash


def flags(declared: Option) -> list[str]:
    """Returns the long spellings of an option: `--legend`, `--no-legend`."""
    long = flag(declared.name)
    kind = declared.kind
    negatable = isinstance(kind, FlagKind) and kind.negatable
    return [long, f"--no-{long[2:]}"] if negatable else [long]


def _help(declared: Option) -> str:
    text = declared.help
    if "{" in text:
        from mjrun.outputs.format_lists import with_formats

        text = with_formats(text)
    default = shown_default(declared)
    note = f"[default: {default}]" if default else ""
    if len(default) <= SHORT_DEFAULT:
        note = note.replace(" ", "\N{NO-BREAK SPACE}")
    repeatable = " Repeatable." if is_repeatable(declared) else ""
    return f"{text}{repeatable}  {note}".rstrip(" ")


def is_repeatable(declared: Option) -> bool:
    """Returns whether the command line accepts the option more than once."""
    return isinstance(declared.kind, OneOrMoreKind | SettingsKind | NamedNumbersKind | ColumnDefinitionsKind)


def shown_default(declared: Option) -> str:
    """Formats the default of an option as the command line would, or returns an empty text."""
    if declared.usual or declared.is_required or declared.default is False or declared.default in (None, (), {}):
        return declared.usual
    shown = declared.kind.plain(declared.default)
    if shown is True:
        return flag(declared.name)
    return ",".join(map(str, cast("list[object]", shown))) if isinstance(shown, list) else str(shown)


def _gathered(kind: AnyKind, values: Sequence[object]) -> object:
    """Combines the values of all repetitions."""
    if isinstance(kind, OneOrMoreKind) and kind.commas:
        return tuple(part for words in cast("Sequence[tuple[object, ...]]", values) for part in words)
    return tuple(values)


MODEL = ModelArgument("model", type=click.Path(readable=False))
