"""Commands from declared options: click's parameters, help by section, and typed values for the body."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import click

from mjrun.cli.console import Console, flag
from mjrun.options.kinds import Choice, ExpectedError, Flag, Kind, Optional, Settings, Several, Values
from mjrun.options.messages import MessageOptions
from mjrun.options.option import Option, Options, Place, options_of

C = TypeVar("C", bound=Options)
Body = Callable[[Console, "Given"], None]


class Given:
    """What a command line says, to be made into typed values."""

    def __init__(self, params: Mapping[str, Any]) -> None:
        self._params = {name: value for name, value in params.items() if value is not None and value != ()}

    def make(self, cls: type[C], **values: object) -> C:
        """A `cls` of what was given, with `values` in place of some of it.

        Raises:
          UsageError: options that cannot be together.
        """
        given = {each.attribute: self._params[each.name] for each in options_of(cls) if each.name in self._params}
        return cls(**{**given, **values})

    def value(self, name: str) -> object:
        """What was said of an option; None for nothing."""
        return self._params.get(name)

    def otherwise(self, **defaults: object) -> "Given":
        """The same, with `defaults` where nothing was said."""
        return Given({**defaults, **self._params})

    def converted(self, name: str, convert: Callable[[Any], object]) -> "Given":
        """The same, with the value of an option converted, if there is one."""
        return Given({**self._params, name: convert(self._params[name])}) if name in self._params else self

    def text(self, argument: str) -> str:
        """An argument."""
        return str(self._params[argument])

    def texts(self, argument: str) -> tuple[str, ...]:
        """An argument that is repeated."""
        return tuple(self._params.get(argument, ()))


class SectionedCommand(click.Command):
    """A command whose help shows its options by section."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record and isinstance(param, click.Option):
                section = param.section if isinstance(param, DeclaredOption) else "Options"
                sections.setdefault(section, []).append(record)
        for name, records in sections.items():
            with formatter.section(name):
                formatter.write_dl(records)


class DeclaredOption(click.Option):
    """An option of the command line, as it is declared."""

    def __init__(self, declared: Option, **settings: Any) -> None:
        self.section, self._kind = declared.section, declared.kind
        super().__init__(_spellings(declared), help=_help(declared), **settings)

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        made = super().type_cast_value(ctx, value)
        return _gathered(self._kind, made) if self.multiple and made else made


class KindType(click.ParamType):
    """A kind of values, as click knows types."""

    def __init__(self, kind: Kind[Any, Any]) -> None:
        self._kind, self.name = kind, kind.metavar

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return self._kind.parse(value)
        except ExpectedError as error:
            self.fail(f"{value!r} is not {error.expected}", param, ctx)


def command(
    name: str, *classes: type[Options], arguments: Sequence[click.Argument] = (), without: Sequence[str] = ()
) -> Callable[[Body], click.Command]:
    """Makes a function of the console and what is given the command `name`, with the options of `classes`.

    Args:
      without: names of options that this command has no use for.
    """

    def decorate(body: Body) -> click.Command:
        @click.pass_obj
        def callback(console: Console, /, **params: Any) -> None:
            given = Given(params)
            _listen(console, given.make(MessageOptions))
            body(console, given)

        declared = {each.name: each for cls in (*classes, MessageOptions) for each in options_of(cls)}
        known = [each for each in declared.values() if Place.COMMAND in each.places and each.name not in without]
        params = [*arguments, *map(click_option, known)]
        return SectionedCommand(name, callback=callback, params=params, help=body.__doc__)

    return decorate


def click_option(declared: Option) -> click.Option:
    """The option of the command line that is `declared`."""
    kind = declared.kind.each if isinstance(declared.kind, Optional) else declared.kind
    if isinstance(kind, Flag):
        return DeclaredOption(declared, is_flag=True, default=None)
    several = isinstance(kind, Several | Settings | Values)
    each = kind.each if isinstance(kind, Several) and not kind.commas else kind
    chosen = click.Choice(each.names, case_sensitive=False) if isinstance(each, Choice) else KindType(each)
    metavar = None if isinstance(each, Choice) else kind.metavar
    optional = {} if declared.flag_value is None else {"is_flag": False, "flag_value": declared.flag_value}
    return DeclaredOption(declared, type=chosen, multiple=several, metavar=metavar, default=None, **optional)


def _listen(console: Console, messages: MessageOptions) -> None:
    console.verbosity = -1 if messages.quiet else 1 if messages.verbose else 0
    console.debug = messages.debug


def _spellings(declared: Option) -> list[str]:
    long = flag(declared.name)
    negatable = isinstance(declared.kind, Flag) and declared.kind.negatable
    return [*declared.short, f"{long}/--no-{long[2:]}" if negatable else long, declared.name]


def _help(declared: Option) -> str:
    kind = declared.kind.each if isinstance(declared.kind, Optional) else declared.kind
    notes = ["Repeatable."] if isinstance(kind, Several | Settings | Values) else []
    default = declared.usual or _shown_default(declared)
    return "  ".join([" ".join([declared.help, *notes]), *([f"[default: {default}]"] if default else [])])


def _shown_default(declared: Option) -> str:
    if declared.is_required or declared.default in (None, False, (), {}):
        return ""
    shown = declared.kind.plain(declared.default)
    if shown is True:
        return flag(declared.name)
    return ",".join(map(str, shown)) if isinstance(shown, list) else str(shown)


def _gathered(kind: Kind[Any, Any], values: Sequence[Any]) -> Any:
    """The values of all repetitions as one."""
    whole = kind.each if isinstance(kind, Optional) else kind
    if isinstance(whole, Values):
        return dict(values)
    if isinstance(whole, Several) and whole.commas:
        return tuple(part for one in values for part in one)
    return tuple(values)


MODEL = click.Argument(["model"], type=click.Path())
