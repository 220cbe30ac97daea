"""Print a shell script that completes mjrun's commands, options and values."""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class, shell_complete, split_arg_string

from mjrun.cli.click_command import ParsedCommandLine, command
from mjrun.cli.console import Console
from mjrun.cli.main import COMPLETE
from mjrun.cli.simulation_command import import_mujoco
from mjrun.errors import MjrunError, UnknownNameError
from mjrun.options.rendering import RIG_EXAMPLES
from mjrun.suffixes import is_hdf5, is_yaml, split_episode

if TYPE_CHECKING:
    import mujoco

SHELLS = ("bash", "zsh", "fish")

SPECIAL = re.compile(r"[^\w@%+=:,./-]")  # characters that Bash may not read as themselves
QUOTED = set(" \t\n\"'><;|&()")  # characters that are in a word only if they are escaped or quoted
ENDING = {"'": set("'\\"), '"': set('"$`!\\')}  # characters that may end a quoted text, or be expanded in it
# Metavariables of options whose values are files or folders.
FILES = ("FILE", "[FILE]", "FILE.xml[:NAME]", "FILE|none", "POLICY", "CODE", "MODEL")
FOLDERS = ("DIR",)


class _BashCompletion(BashComplete):
    """Completion for Bash that also works within words that Bash splits: `scene:dom`, `--ctrl=mot`, `geom/a,b`."""

    source_template = r"""
%(complete_func)s() {
    local kind value current=$2 response
    COMPREPLY=()
    [[ $current == [=:] ]] && current=
    response=$(COMP_LINE="${COMP_LINE:0:COMP_POINT}" COMP_BREAKS="$COMP_WORDBREAKS" %(complete_var)s=bash_complete "$1")
    while IFS=, read -r kind value; do
        case $kind in
            plain) COMPREPLY+=("$value"); [[ $value == *[=:/.[,] ]] && compopt -o nospace ;;
            file) compopt -o filenames; mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -f -- "$current") ;;
            dir) compopt -o filenames; mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -d -- "$current") ;;
        esac
    done <<< "$response"
}
complete -o nosort -F %(complete_func)s %(prog_name)s
"""

    def get_completion_args(self) -> tuple[list[str], str]:
        line = os.environ["COMP_LINE"]
        words = split_arg_string(line)[1:]
        if not words or (line[-1:].isspace() and split_arg_string(f"{line}x")[-1] == "x"):
            words.append("")
        return words[:-1], words[-1]

    def format_completion(self, item: CompletionItem[str]) -> str:
        # Bash replaces only what follows the last character at which it breaks words.
        _, incomplete = self.get_completion_args()
        breaks = re.escape("".join(set(os.environ.get("COMP_BREAKS", "")) - QUOTED))
        finished = re.match(f".*[{breaks}]", incomplete, re.DOTALL) if breaks else None
        start = finished.end() if finished and item.value.startswith(finished[0]) else 0
        is_escaped = item.type == "plain" and not _open_quote(os.environ["COMP_LINE"])
        value = item.value[start:]
        return f"{item.type},{SPECIAL.sub(_with_backslash, value) if is_escaped else value}"

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Returns the completions, which Bash inserts unchanged, except those that no escape makes safe in quotes."""
        ending = ENDING.get(_open_quote(os.environ["COMP_LINE"]), set[str]())
        return [item for item in super().get_completions(args, incomplete) if ending.isdisjoint(item.value)]


add_completion_class(_BashCompletion, "bash")


def _with_backslash(special: re.Match[str]) -> str:
    return f"\\{special[0]}"


def _open_quote(line: str) -> str:
    """Returns the quotation mark that is open at the end of a line; empty if none is."""
    quote, is_escaped = "", False
    for character in line:
        if is_escaped:
            is_escaped = False
        elif character == "\\" and quote != "'":
            is_escaped = True
        elif quote:
            quote = "" if character == quote else quote
        elif character in ENDING:
            quote = character
    return quote


def complete(group: click.Group, instruction: str) -> int:
    """Prints what a shell asks for and returns the exit code; a command line that is wrong completes to nothing."""
    try:
        return shell_complete(group, {}, "mjrun", COMPLETE, instruction)
    except Exception:
        return 1


def model_values(incomplete: str) -> list[CompletionItem[str]]:
    """Returns the completions of a model: files, or names after a prefix, `scene:`, or after a file, `demo.hdf5:`."""
    import_mujoco()
    from mjrun.model.sources import model_collections
    from mjrun.model.sources.demonstration import open_demonstrations

    prefix, colon, _ = incomplete.partition(":")
    collections = model_collections()
    if colon and prefix in collections:
        return _items((f"{prefix}:{name}" for name in collections[prefix].descriptions()), incomplete)
    if colon and is_hdf5(file := split_episode(incomplete)[0]):
        with suppress(MjrunError), open_demonstrations(Path(file)) as opened:
            return _items((f"{file}:{name}" for name in opened.names), incomplete)
    prefixes = _items((f"{name}:" for name in collections), incomplete) if incomplete else []
    return [*prefixes, CompletionItem(incomplete, type="file")]


def option_values(name: str, metavar: str, model: object, incomplete: str) -> list[CompletionItem[str]]:
    """Returns the completions of an option's value.

    Args:
      name: the option's name in its declaration.
      metavar: the placeholder of its value in help texts.
      model: the value of the model argument; None if the command line has none yet.
      incomplete: what is typed of the value.
    """
    items = _items(_NAMES[name](model, incomplete), incomplete) if name in _NAMES else []
    if name == "model":
        items += model_values(incomplete)
    elif metavar in FILES:
        items.append(CompletionItem(incomplete, type="file"))
    elif metavar in FOLDERS:
        items.append(CompletionItem(incomplete, type="dir"))
    return items


def _items(values: Iterable[str], incomplete: str) -> list[CompletionItem[str]]:
    # Names of models are untrusted: a line break would begin another completion, and an escape changes a terminal.
    fitting = (value for value in dict.fromkeys(values) if value.startswith(incomplete) and value.isprintable())
    return [CompletionItem(value) for value in fitting]


def _compiled(model: object) -> "tuple[mujoco.MjSpec | None, mujoco.MjModel] | None":
    """Compiles the model on the command line; None if it has none that compiles without its document or input."""
    if not isinstance(model, str) or model == "-" or is_yaml(model):
        return None
    import_mujoco()
    from mjrun.model.sources import parse_source

    try:
        return parse_source(model).compile()
    except MjrunError:
        return None


def _names_of(kind: str, suffix: str = "") -> Callable[[object, str], Iterator[str]]:
    """Returns a function that yields the names of all objects of a kind, each with a suffix."""

    def names(model: object, incomplete: str) -> Iterator[str]:
        if compiled := _compiled(model):
            from mjrun.model.names import names as names_in_model

            yield from (f"{name}{suffix}" for name in names_in_model(compiled[1], kind))

    return names


def _cameras(model: object, incomplete: str) -> Iterator[str]:
    yield from _names_of("camera")(model, incomplete)
    yield from (f"{kind}:" for kind in RIG_EXAMPLES)


def _probes(model: object, incomplete: str) -> Iterator[str]:
    """Yields the groups of columns, or the objects of a group: `xpos[`, `xpos[box]`; after those already typed."""
    compiled = _compiled(model)
    if compiled is None:
        return
    from mjrun.probe.select import available_columns, object_of

    columns = [column.name for column in available_columns(compiled[1])]
    typed = re.match(r"(?:[^,\[]*(?:\[[^\]]*\])?,)*", incomplete)
    before = typed[0] if typed else ""
    group, bracket, inside = incomplete[len(before) :].partition("[")
    if bracket:
        chosen = inside.rpartition(",")[0]
        chosen += "," * bool(chosen)
        objects = dict.fromkeys(object_of(name) for name in columns if name.startswith(f"{group}/"))
        yield from (f"{before}{group}[{chosen}{name}]" for name in objects)
        return
    for name in columns:
        first, slash, _ = name.partition("/")
        yield f"{before}{first}"
        if slash and first == group:
            yield f"{before}{first}["


def _paths(model: object, incomplete: str) -> Iterator[str]:
    """Yields paths of values in a model, part by part: `geom/`, `geom/box.`, `geom/box.friction=`."""
    compiled = _compiled(model)
    if compiled is None or compiled[0] is None:
        return
    from mjrun.model.override import ELEMENTS, ROOTS, fields_of

    spec = compiled[0]
    kind, slash, rest = incomplete.partition("/")
    if not slash:
        root, dot, _ = incomplete.partition(".")
        if dot and root in ROOTS:
            yield from _fields(root, ROOTS[root](spec), incomplete, fields_of)
            return
        yield from (f"{name}." for name in ROOTS)
        yield from (f"{name}/" for name, plural in ELEMENTS.items() if len(getattr(spec, plural)))
        return
    if kind not in ELEMENTS:
        return
    elements = {each.name or f"{kind}:{i}": each for i, each in enumerate(getattr(spec, ELEMENTS[kind]))}
    owner = next((name for name in sorted(elements, key=len, reverse=True) if rest.startswith(f"{name}.")), None)
    if owner is None:
        yield from (f"{kind}/{name}." for name in elements)
    else:
        yield from _fields(f"{kind}/{owner}", elements[owner], incomplete, fields_of)


def _fields(path: str, owner: object, incomplete: str, fields_of: Callable[[object], list[str]]) -> Iterator[str]:
    for name in fields_of(owner):
        value = getattr(owner, name)
        if not type(value).__module__.startswith("mujoco") or not fields_of(value):
            yield f"{path}.{name}="
        elif incomplete.startswith(f"{path}.{name}."):
            yield from _fields(f"{path}.{name}", value, incomplete, fields_of)
        else:
            yield f"{path}.{name}."


def _flags(_: object, incomplete: str) -> Iterator[str]:
    import_mujoco()
    from mjrun.rendering.visual import flags

    before = incomplete[: incomplete.rfind(",") + 1]
    yield from (f"{before}{name}" for name in flags())


# How the names that complete an option's value follow from the model and from what is typed.
_NAMES: dict[str, Callable[[object, str], Iterator[str]]] = {
    "camera": _cameras,
    "ctrl": _names_of("actuator", "="),
    "hide": _flags,
    "key": _names_of("keyframe"),
    "plot": _probes,
    "probe": _probes,
    "push": _names_of("body", "="),
    "qpos": _names_of("joint", "="),
    "qvel": _names_of("joint", "="),
    "scan": _paths,
    "set": _paths,
    "show": _flags,
    "trail": _names_of("body"),
    "vary": _paths,
}


@command(arguments=[click.Argument(["shell"], metavar="bash|zsh|fish")])
def completion(console: Console, command_line: ParsedCommandLine) -> None:
    """Print a script that completes mjrun's commands, options and values in a shell.

    Values include the models of a collection, and the cameras, keyframes, actuators, joints, columns and paths of the
    model on the command line. Add one of these lines to the shell's start-up file:

    \b
    eval "$(mjrun completion bash)"               # ~/.bashrc
    eval "$(mjrun completion zsh)"                # ~/.zshrc, after compinit
    mjrun completion fish | source                # ~/.config/fish/config.fish
    """
    from click.shell_completion import get_completion_class

    from mjrun.cli.main import COMPLETE, group

    shell = command_line.argument("shell")
    if shell not in SHELLS:
        raise UnknownNameError("shell", shell, SHELLS)
    kind = get_completion_class(shell)
    assert kind is not None
    console.result((kind.source_template % kind(group, {}, "mjrun", COMPLETE).source_vars()).strip())
