"""What is wrong with a text that is not YAML, in our words: PyYAML's own speak of tokens and streams."""

import re

import yaml

from mjrun.document.tree import shortened
from mjrun.errors import clean, quoted

NO_DIRECTIVES = "a line that begins with % is a directive, and documents have none"
NO_TAGS = "tags (!) are not taken; a value's form says what it is"
NO_ANCHORS = "anchors (&) and aliases (*) are not taken; text that begins so goes in quotes"
NO_MERGE = "merge keys (<<) are not taken"
NO_COMMAS = 'within {…} a comma ends a value: one that has commas goes in quotes, as in "uniform(0, 1)"'
BARE_VARIABLE = "within [ ] and { } text with ${ goes in quotes"
UNCLOSED = "this quote is not closed"
HOLES = "text that holds ': ' goes in quotes"

# Contexts in which PyYAML's problem does not matter, with where to point: at the beginning of the context, or not.
CONTEXTS = {
    "while scanning a directive": (NO_DIRECTIVES, True),
    "while parsing a directive": (NO_DIRECTIVES, True),
    "while scanning an anchor": (NO_ANCHORS, True),
    "while scanning an alias": (NO_ANCHORS, True),
    "while scanning a tag": (NO_TAGS, True),
    "while parsing a tag": (NO_TAGS, True),
    "while parsing a node": (NO_TAGS, False),
    "while scanning a quoted scalar": (UNCLOSED, True),
    "while scanning a simple key": (f"expected 'key: value'; is a colon missing, or an indentation? {HOLES}", True),
    "while scanning a block scalar": ("after | or > may stand +, - and an indentation from 1 to 9, no more", False),
    "while parsing a block mapping": ("this line is indented like no other of its mapping", False),
    "while parsing a block collection": ("this line is indented like no other of its list", False),
}
# PyYAML's problems elsewhere; {} is what the pattern found.
PROBLEMS = {
    r"found character '\\t' that.*": "a tab; YAML is indented and spaced by spaces",
    r"found character (.+) that.*": "text that begins with {} goes in quotes",
    r"sequence entries are not allowed here": "a list cannot begin here; write '- …' on lines of its own",
    r"mapping keys are not allowed here": "a key cannot stand here",
    r"mapping values are not allowed here": f"a key cannot stand here; is it indented as its neighbours? {HOLES}",
    r"found unknown escape character ['\"](.+)['\"]": "no escape \\{} in double quotes; in single quotes \\ is itself",
    r"expected escape sequence of (\d+) .*": "this escape needs {} hexadecimal digits",
    r"expected '<document start>'.*": "the document ends before this",
    r"expected the node content.*": "a value is missing before this",
    r"found (incompatible|duplicate) YAML d.*": NO_DIRECTIVES,
    r"duplicate tag handle .*": NO_DIRECTIVES,
}


def explain(error: yaml.MarkedYAMLError, opened: yaml.Mark | None) -> tuple[str, int]:
    """What `error` says, and the index of the character that it is about; `opened` is where the innermost list or
    mapping begins, if there is one."""
    mark = error.problem_mark or error.context_mark
    context = error.context_mark or mark
    place = mark.index if mark else 0
    if error.context in CONTEXTS:
        message, at_context = CONTEXTS[error.context]
        return message, context.index if context and at_context else place
    problem = error.problem or ""
    if opened and "flow" in (error.context or ""):
        if problem.endswith("'<stream end>'"):
            return "this bracket is not closed", opened.index
        if closing := re.match(r"expected ',' or '(.)'", problem):
            return f"expected ',' or '{closing[1]}'; the bracket opens in line {opened.line + 1}", place
    for pattern, sentence in PROBLEMS.items():
        if found := re.fullmatch(pattern, problem, re.DOTALL):
            return sentence.format(*found.groups()), place
    return f"not YAML: {clean(shortened(problem, 80))}", place


def forbidden(character: str) -> str:
    """Says that `character` cannot stand in a document."""
    return f"{quoted(character)} (U+{ord(character):04X}) cannot stand in a document, but as an escape in double quotes"
