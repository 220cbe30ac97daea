"""The reference of all options and table formats in Markdown.

Options are spelled as on the command line, in run documents and in Python.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import NamedTuple

from mjrun.cli.click_command import DeclaredOption, flags, is_repeatable, shown_default
from mjrun.cli.main import COMMANDS, load_command
from mjrun.dataclass import dataclass
from mjrun.document.run import OUTPUTS
from mjrun.formats import tables
from mjrun.options.kinds import FlagKind
from mjrun.options.option import FrontEnd, Option, options_of
from mjrun.options.report import PageOptions
from mjrun.options.simulation import SimulationOptions
from mjrun.options.task import PARTS, TaskOptions
from mjrun.outputs.format_lists import with_formats
from mjrun.probe.expression import MEANINGS

SIMULATION_SECTIONS = ("Simulation", "Policy", "Model")  # the rest of a command that simulates is about its output
TOP_LEVEL = "."
RUN, TASK = "Run documents", "Task documents"
INTRODUCTION = """\
# Options of mjrun

Every option, by section, as `mjrun schema options` prints them. A name means the same everywhere: `--trail-span` on the
command line is `trail_span` in documents and in Python, unless its row says otherwise. Units are in brackets. An option
that is repeatable on the command line is a list in documents and in Python, where a single value is also accepted."""


@dataclass(frozen=True)
class _OptionOwner:
    """A command, an output or a part of a document that accepts the options of a section.

    Attributes:
      command: such as `video`; empty if no command makes the output.
      key: the list in documents whose entries accept them, or `TOP_LEVEL`; empty if documents do not accept them.
      python: the Python class; empty if no class accepts them.
      documents: the kind of documents that has this key.
    """

    command: str
    key: str = ""
    python: str = ""
    documents: str = RUN

    @property
    def document(self) -> str:
        """The place of the options in a document."""
        return "the top level" if self.key == TOP_LEVEL else f"`{self.key}{'[]' if self.documents == RUN else ''}`"

    def __str__(self) -> str:
        return f"`mjrun {self.command}`" if self.command else f"`{self.key}`"


class _OwnedSection(NamedTuple):
    """A section of one owner, with the Python classes of its options that have another one than the owner."""

    title: str
    owner: _OptionOwner
    options: Sequence[Option]
    classes: Mapping[str, str]


@dataclass
class OptionSection:
    """A section of options, with the owners of each option."""

    title: str
    options: dict[str, Option] = field(default_factory=dict[str, Option])
    owners: dict[str, list[_OptionOwner]] = field(default_factory=dict[str, list[_OptionOwner]])

    def add(self, owner: _OptionOwner, options: Sequence[Option], classes: Mapping[str, str]) -> None:
        """Adds options of an owner; `classes` are the Python classes of options that have another one, and no key."""
        for each in options:
            self.options.setdefault(each.name, each)
            own = replace(owner, python=classes[each.name], key="") if each.name in classes else owner
            self.owners.setdefault(each.name, []).append(own)

    def fits(self, options: Sequence[Option]) -> bool:
        """Returns whether `options` equal those of this section, or are a subset or a superset of them."""
        names = {each.name for each in options}
        agree = all(self.options.get(each.name, each) == each for each in options)
        return agree and (names <= set(self.options) or names >= set(self.options))

    def all_owners(self) -> list[_OptionOwner]:
        return list(dict.fromkeys(owner for owners in self.owners.values() for owner in owners))


def options_reference() -> str:
    """Returns the reference: a section for each group of options, with a table of them."""
    sections = ["\n".join(_section_lines(section)) for section in reference_sections()]
    appendices = ["\n".join(_table_format_lines()), "\n".join(_expression_lines())]
    return "\n\n".join([INTRODUCTION, *sections, *appendices])


def _table_format_lines() -> Iterator[str]:
    yield "## Table formats\n"
    yield "The suffix of a table selects its format. All of them store floating-point numbers and integers exactly."
    yield "\n| format | suffixes | units and manifest | standard output | needs |\n|---|---|---|---|---|"
    for known in tables.FORMATS.values():
        suffixes = " ".join(f"`{suffix}`" for suffix in known.suffixes)
        metadata = "units, if asked" if known.commented else "no" if known.is_text else "yes"
        needs = f"`pip install 'mjrun[{known.extra}]'`" if known.extra else ""
        yield f"| {known.name} | {suffixes} | {metadata} | {'yes' if known.is_text else 'no'} | {needs} |"


def _expression_lines() -> Iterator[str]:
    yield "## Functions in expressions\n"
    yield "For assertions, metrics, derived columns, events, and the rewards, terminations and observations of tasks.\n"
    yield from (f"- `{function}`: {meaning}." for function, meaning in MEANINGS.items())


def reference_sections() -> list[OptionSection]:
    """Returns the options of all commands and outputs; sections that several of them share occur once."""
    sections: list[OptionSection] = []
    for title, owner, options, classes in _sections():
        named = [section for section in sections if section.title == title]
        fitting = next((section for section in named if section.fits(options)), None)
        if fitting is None:
            fitting = OptionSection(f"{title} of {owner}" if named else title)
            sections.append(fitting)
        fitting.add(owner, options, classes)
    return sections


def _sections() -> "Iterator[_OwnedSection]":
    """Yields every section of every command and output."""
    for name in COMMANDS:
        command = load_command(name)
        declared = [param.declared for param in command.params if isinstance(param, DeclaredOption)]
        facts = command.declaration
        simulation = _OptionOwner(name, TOP_LEVEL if facts.key else "", "Simulation")
        own = {each.name for cls in facts.options if cls not in facts.classes for each in options_of(cls)}
        classes = {each.name: name for cls, name in facts.classes.items() for each in options_of(cls)}
        others = {name: cls for name, cls in classes.items() if name not in own}
        for title, owner, options, _ in _by_section(_OptionOwner(name, facts.key, facts.python), declared):
            simulates = SimulationOptions in facts.options and title in SIMULATION_SECTIONS
            yield _OwnedSection(title, simulation if simulates else owner, options, {} if simulates else others)
    of_commands = {load_command(name).declaration.key for name in COMMANDS}
    for key, output in OUTPUTS.items():
        if key not in of_commands:
            yield from _by_section(_OptionOwner("", key, output.__name__.removesuffix("Options")), options_of(output))
    yield from _by_section(_OptionOwner("", TOP_LEVEL), options_of(PageOptions))
    yield from _by_section(_OptionOwner("", TOP_LEVEL, "", TASK), options_of(TaskOptions))
    for key, (entry, declared) in PARTS.items():
        yield from _by_section(_OptionOwner("", key + entry, declared.section, TASK), options_of(declared))


def _by_section(owner: _OptionOwner, options: Sequence[Option]) -> "Iterator[_OwnedSection]":
    for title in dict.fromkeys(each.section for each in options):
        yield _OwnedSection(title, owner, [each for each in options if each.section == title], {})


def _section_lines(section: OptionSection) -> Iterator[str]:
    owners = section.all_owners()
    available = {each.name: _front_ends(each, section.owners[each.name]) for each in section.options.values()}
    places = FrontEnd(0)
    for front_ends in available.values():
        places |= front_ends
    homes = {
        "Command line": [f"`mjrun {owner.command}`" for owner in owners if owner.command],
        **{
            kind: [each.document for each in owners if each.documents == kind and each.key]
            for kind in (RUN, TASK)
            if FrontEnd.DOCUMENT in places
        },
        "Python": [f"`mjrun.{owner.python}`" for owner in owners if owner.python and FrontEnd.PYTHON in places],
    }
    yield f"## {section.title}\n"
    yield ". ".join(f"{name}: {', '.join(dict.fromkeys(home))}" for name, home in homes.items() if home) + "."
    yield "\n| option | value | meaning |\n|---|---|---|"
    for each in section.options.values():
        sentences = [
            with_formats(each.help),
            _default(each),
            *_spellings(each, available[each.name]),
            _unavailable(places & ~available[each.name]),
            _restriction(section.owners[each.name], owners),
        ]
        cells = [_name(each, available[each.name]), _value(each), " ".join(filter(None, sentences))]
        yield f"| {' | '.join(map(_cell, cells))} |"


def _front_ends(each: Option, owners: Sequence[_OptionOwner]) -> FrontEnd:
    """Returns the front ends that accept an option of `owners`."""
    homes = FrontEnd(0)
    for owner in owners:
        homes |= FrontEnd.COMMAND if owner.command else FrontEnd(0)
        homes |= FrontEnd.DOCUMENT if owner.key else FrontEnd(0)
        homes |= FrontEnd.PYTHON if owner.python else FrontEnd(0)
    return homes & each.places


def _name(each: Option, available: FrontEnd) -> str:
    """Returns the spellings of an option on the command line, or its key where no command accepts it."""
    spellings = (*each.short, *flags(each)) if FrontEnd.COMMAND in available else (each.key,)
    return ", ".join(f"`{spelling}`" for spelling in spellings)


def _value(each: Option) -> str:
    """Returns the placeholder for the value, which may wrap between alternatives."""
    if isinstance(each.kind, FlagKind):
        return "true or false"
    metavar = each.kind.metavar
    return " | ".join(f"`{part}`" for part in ([metavar] if "[" in metavar else metavar.split("|")))


def _default(each: Option) -> str:
    if each.default is False:
        return ""  # as of every switch
    default = "true" if each.default is True else shown_default(each)
    return f"Default: {default}." if default else ""


def _spellings(each: Option, available: FrontEnd) -> Iterator[str]:
    """Yields a sentence for each front end that spells the option in another way, and for a repeatable one."""
    if FrontEnd.COMMAND in available and is_repeatable(each):
        yield "Repeatable."
    if FrontEnd.DOCUMENT in available and each.key != each.name:
        yield f"`{each.key}` in documents."
    if FrontEnd.PYTHON in available and each.attribute != each.name:
        yield f"`{each.attribute}` in Python."


def _unavailable(missing: FrontEnd) -> str:
    """Returns the sentence for an option that some front ends of its section do not accept."""
    if missing == FrontEnd.DOCUMENT | FrontEnd.PYTHON:
        return "Only on the command line."
    names = {FrontEnd.COMMAND: "on the command line", FrontEnd.DOCUMENT: "in documents", FrontEnd.PYTHON: "in Python"}
    return f"Not {names[missing]}." if missing else ""


def _restriction(owners: Sequence[_OptionOwner], all_owners: Sequence[_OptionOwner]) -> str:
    """Returns the sentence for an option that only some owners of the section accept."""
    named = {str(owner) for owner in owners}
    others = [owner for owner in all_owners if str(owner) not in named]
    if not others:
        return ""
    only, without = ", ".join(map(str, owners)), ", ".join(map(str, others))
    return f" Not for {without}." if len(others) < len(owners) else f" Only for {only}."


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
