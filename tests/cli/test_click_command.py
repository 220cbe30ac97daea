from dataclasses import field
from fractions import Fraction
from typing import ClassVar

import click
import pytest
from click.testing import CliRunner

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.main import COMMANDS, group, load_command
from mjrun.options.kinds import ChoiceKind, FlagKind, OneOrMoreKind, TextKind, optional
from mjrun.options.model import ServoGainsKind
from mjrun.options.number_kinds import ExactNumberKind, IntegerKind, SizeKind
from mjrun.options.option import OTHER_NAMES, FrontEnd, Options, option, options, required
from mjrun.options.setting_kinds import NamedNumbersKind, SettingsKind
from tests.cases import cases


@options
class Base(Options):
    section: ClassVar[str] = "Base"

    subject: object = field(kw_only=False)
    verbosely: bool = option(converter=FlagKind(), default=False, help="Say more.")


@options
class Cake(Base):
    section: ClassVar[str] = "Cake"

    name: str = required(converter=TextKind(), short="-n", usual="SUBJECT.cake", help="What it is called.")
    heat: Fraction = option(converter=ExactNumberKind("KELVIN"), default=450, help="Of the oven [K].")
    layers: int | None = option(
        converter=optional(IntegerKind(1)), default=None, usual="as many as fit", help="How many."
    )
    shape: str = option(converter=ChoiceKind(("round", "square")), default="round", help="Seen from above.")
    icing: bool = option(converter=FlagKind(negatable=True), default=True, help="Whether there is icing.")
    topping: tuple[str, ...] = option(converter=OneOrMoreKind(TextKind()), default=(), help="On top.")
    candles: tuple[str, ...] = option(converter=OneOrMoreKind(TextKind(), commas=True), default=(), help="By colour.")
    size: tuple[tuple[int, int], ...] = option(converter=OneOrMoreKind(SizeKind()), default=(), help="Of each [cm].")
    weights: object = option(converter=NamedNumbersKind(), default={}, help="By ingredient [kg].")
    set: object = option(converter=SettingsKind(), default=(), help="Anything.")
    secret: bool = option(converter=FlagKind(), default=False, places=FrontEnd.PYTHON, help="Not for the command line.")


def baked(*arguments: str) -> tuple[Cake, Console]:
    """What a command line makes."""
    cakes: list[Cake] = []

    @command(Cake, arguments=[click.Argument(["subject"])])
    def bake(console: Console, command_line: ParsedCommandLine) -> None:
        """Bake SUBJECT."""
        console.release_stdout()
        subject = command_line.argument("subject")
        cakes.append(command_line.with_defaults(name=f"{subject}.cake").make(Cake, subject=subject))

    console = Console("bake")
    result = CliRunner().invoke(bake, arguments, obj=console, standalone_mode=False)
    if result.exception:
        raise result.exception
    return cakes[0], console


def test_what_is_not_given_is_the_default() -> None:
    cake, console = baked("apple")
    assert cake == Cake("apple", name="apple.cake")
    assert (console.verbosity, console.debug) == (0, False)


def test_every_kind_of_option_arrives_as_its_value() -> None:
    cake, _ = baked(
        *("apple", "-n", "pie", "--heat", "1/3", "--layers", "2", "--shape", "SQUARE", "--no-icing", "--verbosely"),
        *("--topping", "a,b", "--topping", "c", "--candles", "red,blue", "--candles", "pink"),
        *("--size", "3x4", "--size", "5x6", "--weights", "flour=.5", "--weights", "eggs=1,2", "--set", "a.b=c"),
    )
    assert cake == Cake(
        "apple",
        name="pie",
        heat="1/3",
        layers=2,
        shape="square",
        icing=False,
        verbosely=True,
        topping=["a,b", "c"],
        candles=["red", "blue", "pink"],
        size=[(3, 4), (5, 6)],
        weights={"flour": 0.5, "eggs": [1, 2]},
        set={"a.b": "c"},
    )


@cases("arguments, message")
def test_a_bad_value_is_reported_as_click_does(arguments: tuple[str, ...], message: str) -> None:
    with pytest.raises(click.UsageError) as error:
        baked("apple", *arguments)
    assert error.value.format_message().startswith(message)


@cases("arguments, message")
def test_a_value_that_a_later_one_replaces_is_reported(
    arguments: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    warnings = list[str]()
    monkeypatch.setattr(Console, "warn", lambda _, text: warnings.append(text))
    baked("apple", *arguments)
    assert warnings == ([message] if message else [])


def test_help_shows_sections_defaults_and_what_stands_for_values() -> None:
    @command(Cake)
    def bake(console: Console, command_line: ParsedCommandLine) -> None:
        """Bake."""

    text = CliRunner(env={"COLUMNS": "200"}).invoke(bake, ["--help"], obj=Console("bake")).output
    lines = " ".join(text.split())
    assert text.index("Cake:") < text.index("Base:") < text.index("Messages:")
    assert "-n, --name TEXT What it is called. [default: SUBJECT.cake]" in lines
    assert "--heat KELVIN Of the oven [K]. [default: 450]" in lines
    assert "--layers N How many. [default: as many as fit]" in lines
    assert "--shape [round|square] Seen from above. [default: round]" in lines
    assert "--icing / --no-icing Whether there is icing. [default: --icing]" in lines
    assert "--topping TEXT On top. Repeatable. " in lines
    assert "--candles TEXT,… By colour. Repeatable. " in lines
    assert "--weights NAME=VALUE By ingredient [kg]. Repeatable. " in lines
    assert "secret" not in text


@pytest.mark.parametrize(
    ("flags", "verbosity", "debug"), [(["-q"], -1, False), (["-v"], 1, False), (["--debug"], 0, True), ([], 0, False)]
)
def test_the_console_is_reported_how_much_to_say(flags: list[str], verbosity: int, debug: bool) -> None:
    _, console = baked("apple", *flags)
    assert (console.verbosity, console.debug) == (verbosity, debug)


def test_a_command_can_do_without_an_option() -> None:
    @command(Cake, without=("heat",))
    def bake(console: Console, command_line: ParsedCommandLine) -> None:
        """Bake."""

    assert "--heat" not in CliRunner().invoke(bake, ["--help"], obj=Console("bake")).output


def test_what_is_given_can_be_converted_before_it_is_made() -> None:
    command_line = ParsedCommandLine({"name": "a", "topping": ("x",)})
    doubled = command_line.with_converted("topping", lambda text: text * 2)
    converted = doubled.with_converted("heat", float)
    assert converted.make(Cake, subject="s").topping == ("xx",)
    assert command_line.value("name") == "a"
    assert command_line.value("heat") is None


@pytest.mark.parametrize(
    ("name", "suggested"), [("--resolution", "'--size'"), ("-s", "'--size'"), ("--candels", "'--candles'")]
)
def test_what_an_option_is_called_elsewhere_suggests_it(name: str, suggested: str) -> None:
    with pytest.raises(click.UsageError) as error:
        baked("apple", name, "3x4")
    assert error.value.format_message() == f"No such option '{name}' (did you mean {suggested}?)."


@pytest.mark.parametrize(
    ("name", "typed", "suggested"),
    [
        ("video", "--slow-motion", "--speed"),
        ("video", "--keyframe", "--key"),
        ("trace", "--fields", "--probe"),
        ("trace", "--compare", "--golden"),
        ("eval", "--randomize", "--vary"),
        ("eval", "--record", "--videos"),
        ("fit", "--param", "--free"),
        ("bench", "--baseline", "--compare"),
        ("bench", "--threshold", "--fail-above"),
        ("check", "--disable", "--ignore"),
    ],
)
def test_the_first_guess_of_an_option_leads_to_it(name: str, typed: str, suggested: str) -> None:
    result = CliRunner().invoke(load_command(name), [typed, "1"], obj=Console(name))
    assert f"No such option '{typed}' (did you mean '{suggested}'" in result.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fit", "--data", "a.csv"], "No such option '--data' (DATA is an argument: write it without --data)."),
        (["video", "--model", "a.xml"], "No such option '--model' (MODEL is an argument: write it without --model)."),
        (
            ["trace", "--slow-motion", "2"],
            "'--slow-motion' (did you mean '--speed', an option of mjrun ",
        ),
        (["trace", "--fps", "2"], "No such option '--fps' (an option of mjrun "),
        (["plot", "a.csv", "--columns", "qpos/x"], "panels side by side; y selects the columns of the table"),
        (["trace", "a.xml", "--tol", "1e-3"], "as in 'qvel/*=1e-6' or '*=1e-6'"),
    ],
)
def test_options_of_other_commands_and_arguments_are_explained(words: list[str], message: str) -> None:
    assert message in CliRunner().invoke(group, words, obj=Console(words[0])).output


def test_every_other_name_of_an_option_leads_to_one() -> None:
    declared = {param.name for name in COMMANDS for param in load_command(name).params}
    assert {name for names in OTHER_NAMES.values() for name in names} <= declared


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cake.txt"], "Unexpected argument 'cake.txt' (did you mean '-o cake.txt'?)."),
        (["cake"], "Unexpected argument 'cake'."),
        (["--topping", "jam", "nuts"], "Unexpected argument 'nuts' (did you mean '--topping nuts'?)."),
        (["-o", "jam", "nuts"], "Unexpected argument 'nuts'."),
        (["-o", "pie.txt", "cake.txt"], "Unexpected argument 'cake.txt'."),
    ],
)
def test_a_further_argument_may_be_meant_as_the_output_or_as_a_value(arguments: list[str], message: str) -> None:
    @options
    class Written(Base):
        output: str | None = option(converter=optional(TextKind()), default=None, short="-o", help="Where to.")
        topping: tuple[str, ...] = option(converter=OneOrMoreKind(TextKind()), default=(), help="On top.")

    @command(Written, arguments=[click.Argument(["subject"])])
    def bake(console: Console, command_line: ParsedCommandLine) -> None:
        """Bake SUBJECT."""

    with pytest.raises(click.UsageError) as error:
        CliRunner().invoke(
            bake, ["apple", *arguments], obj=Console("bake"), standalone_mode=False, catch_exceptions=False
        )
    assert error.value.format_message() == message


def test_what_a_command_does_not_have_by_any_name_is_not_suggested() -> None:
    with pytest.raises(click.UsageError, match=r"^No such option '--at'\.$"):
        baked("apple", "--at", "1")


@options
class _Optional(Options):
    """An option that may do without its value."""

    gains: str | None = option(converter=optional(ServoGainsKind()), default=None, flag_value="auto", help="Gains.")


@cases("line, gains, model")
def test_an_option_that_may_do_without_a_value_takes_no_argument(
    line: list[str], gains: str | None, model: str
) -> None:
    made: list[tuple[object, str]] = []

    @command(_Optional, arguments=[click.Argument(["model"])])
    def measure(console: Console, command_line: ParsedCommandLine) -> None:
        """Measure."""
        console.release_stdout()
        made.append((command_line.make(_Optional).gains, command_line.argument("model")))

    assert CliRunner().invoke(measure, line, obj=Console()).exit_code == 0
    assert made == [(gains, model)]
    done = CliRunner().invoke(measure, ["--gains", "kp=x", "a.xml"], obj=Console())
    assert done.exit_code == 2
    assert "'kp=x' is not auto, or gains as in kp=50,kd=2" in done.output
