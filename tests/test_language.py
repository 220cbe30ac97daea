"""Plain English in docstrings, comments, help and errors, as far as a test can hold it.

Texts of a room are all its docstrings, its comments and its strings of three words or more.
"""

import ast
import inspect
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pytest

import mjrun
import mjrun.options
from mjrun.cli.main import COMMANDS, load_command
from mjrun.options.option import Options, options_of
from tests.syntax_trees import nodes_of

ROOT = Path(mjrun.__file__).parent
ROOMS = sorted({path.relative_to(ROOT).parts[0] for path in ROOT.glob("*/*.py")} | {"."})
LONGEST_SENTENCE = 40  # words of a sentence in help

HEADLESS = re.compile(r"(What|Whether|How|Where|Which|Who|Whose|Whoever|Why)\b")
VERB = re.compile(r"(\w+s|Does|Has|Goes)\b")
# A description of an argument or attribute that lacks its noun: `names: of the columns`.
FRAGMENT = re.compile(
    r"^\s+\w+(?:, \w+)*: (?:of|in|for|from|to|by|at|on|with|whose|which|until|after|before|beyond) .*", re.MULTILINE
)
COMMENT = re.compile(r"(^\s*|  )# .*")
DIALECT = re.compile(
    r"\b(?<!--)("
    r"told|films?|filmed|so many|as it is|as they are|besides|beyond that|of (its|their|our) own|whoever|somebody"
    r"|at all|anew|(is|are) (?-i:none)|stands? (in|for|where|at|beside|under|there)|worked off|looked at|tells? apart"
    r"|cannot be (meant|had)|goes on|nobody|(is|are) had|mend(s|ed)?|come to the same numbers"
    r")\b",
    re.IGNORECASE,
)


def _modules(room: str) -> list[Path]:
    return sorted((ROOT / room).glob("*.py") if room == "." else (ROOT / room).rglob("*.py"))


def _is_property_or_command(node: ast.AST) -> bool:
    """Tells whether a docstring is a noun, as of properties, or the help of a command, which is an imperative."""
    names = [ast.unparse(each).partition("(")[0] for each in getattr(node, "decorator_list", [])]
    return any(name.split(".")[-1] in ("property", "cached_property", "setter", "command", "group") for name in names)


@cache
def _docstrings(path: Path) -> list[tuple[ast.AST, int, str]]:
    return [
        (node, node.body[0].lineno, text)
        for node in nodes_of(path)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if (text := ast.get_docstring(node))
    ]


def _place(path: Path, line: int, text: str) -> str:
    return f"{path.relative_to(ROOT.parent)}:{line}: {text.splitlines()[0]}"


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    """The strings of three words or more, and the comments, each with its line."""
    for node in nodes_of(path):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value.split()) >= 3:
            yield node.lineno, node.value
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if comment := COMMENT.search(line):
            yield number, comment[0]


def headless_openings(room: str) -> list[str]:
    """Docstrings that begin with a question word instead of a verb or a noun."""
    return [
        _place(path, line, text)
        for path in _modules(room)
        for _, line, text in _docstrings(path)
        if HEADLESS.match(text)
    ]


def openings_without_verb(room: str) -> list[str]:
    """Functions' docstrings that begin with neither a verb in the third person nor a question word."""
    return [
        _place(path, line, text)
        for path in _modules(room)
        for node, line, text in _docstrings(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and not _is_property_or_command(node)
        and not VERB.match(text)
        and not HEADLESS.match(text)
    ]


def first_words(kind: type[ast.AST]) -> Counter[str]:
    """The words with which docstrings of classes or functions begin."""
    return Counter(
        text.split()[0]
        for room in ROOMS
        for path in _modules(room)
        for node, _, text in _docstrings(path)
        if isinstance(node, kind) and not _is_property_or_command(node)
    )


def fragments(room: str) -> list[str]:
    """Descriptions of arguments and attributes without a noun."""
    return [
        _place(path, line, match[0])
        for path in _modules(room)
        for _, line, text in _docstrings(path)
        for match in FRAGMENT.finditer(text)
    ]


def dialect(room: str) -> list[str]:
    """Words of the glossary's left column."""
    return [
        f"{path.relative_to(ROOT.parent)}:{line}: … {match[0]} …"
        for path in _modules(room)
        for line, text in _texts(path)
        for match in DIALECT.finditer(text)
    ]


def test_docstrings_of_classes_begin_with_a_noun() -> None:
    """Those of functions begin with verbs, some of which are nouns, too."""
    verbs = {word for word in first_words(ast.FunctionDef) if VERB.fullmatch(word)}
    assert first_words(ast.ClassDef).keys() & verbs <= {"Copies", "Formats", "Groups", "Guesses"}


@pytest.mark.parametrize("room", ROOMS)
def test_arguments_and_attributes_are_described_by_nouns(room: str) -> None:
    assert fragments(room) == []


@pytest.mark.parametrize("room", ROOMS)
def test_texts_are_plain_english(room: str) -> None:
    faults = [*headless_openings(room), *openings_without_verb(room), *dialect(room)]
    assert not faults, "\n".join(faults)


def test_faults_are_recognized() -> None:
    assert HEADLESS.match("Whether it is set.")
    assert not VERB.match("The value of a key.")
    assert VERB.match("Returns the value of a key.")
    assert DIALECT.search("What is told of a model.")
    assert not DIALECT.search("Reports how a model differs.")


def _helps() -> Iterator[tuple[str, str]]:
    for module in iter_modules(mjrun.options.__path__):
        for name, value in vars(import_module(f"mjrun.options.{module.name}")).items():
            if isinstance(value, type) and issubclass(value, Options) and value is not Options:
                for each in options_of(value):
                    yield f"{name}.{each.name}", each.help
    for name in COMMANDS:
        paragraphs = inspect.cleandoc(load_command(name).help or "").split("\n\n")
        yield from ((name, text) for text in paragraphs if not text.startswith("\b"))


def test_sentences_of_help_are_short() -> None:
    long = {
        f"{name}: {sentence}"
        for name, text in _helps()
        for sentence in re.split(r"(?<=[.;:])\s+", text)
        if len(sentence.split()) > LONGEST_SENTENCE
    }
    assert not long, "\n".join(sorted(long))


def test_help_begins_with_a_capital_and_ends_with_a_full_stop() -> None:
    whole = re.compile(r"([A-Z`'{0-9]|[a-z]+:).*[.:)…]", re.DOTALL)
    wrong = {f"{name}: {text}" for name, text in _helps() if not whole.fullmatch(text)}
    assert not wrong, "\n".join(sorted(wrong))
