"""The inputs of measures that are plain data: a YAML file for each module that uses some.

Texts that are long by repetition are spelled `!repeat [text, count]`, `!numbered [text with {}, count]` and
`!join [text, …]`; bytes are spelled `!bytes "text"`, with a character for each.
"""

from functools import cache
from pathlib import Path
from typing import Any, cast

import yaml


class _Loader(yaml.CSafeLoader):
    """Reads YAML with the tags above."""


def _repeated(loader: _Loader, node: yaml.SequenceNode) -> str:
    text, count = loader.construct_sequence(node, deep=True)
    return text * count


def _numbered(loader: _Loader, node: yaml.SequenceNode) -> str:
    text, count = loader.construct_sequence(node, deep=True)
    return "".join(text.replace("{}", str(number)) for number in range(count))


def _joined(loader: _Loader, node: yaml.SequenceNode) -> str:
    return "".join(loader.construct_sequence(node, deep=True))


def _encoded(loader: _Loader, node: yaml.ScalarNode) -> bytes:
    return loader.construct_scalar(node).encode("latin-1")


_Loader.add_constructor("!repeat", _repeated)
_Loader.add_constructor("!numbered", _numbered)
_Loader.add_constructor("!join", _joined)
_Loader.add_constructor("!bytes", _encoded)


@cache
def inputs_of(module: str) -> dict[str, Any]:
    """Returns the data of a module by name; sequences are tuples."""
    text = Path(__file__).with_name(f"{module.rpartition('.')[2]}.yaml").read_text("utf-8")
    return cast("dict[str, Any]", _frozen(yaml.load(text, _Loader)))


def _frozen(value: object) -> object:
    match value:
        case dict():
            return {key: _frozen(each) for key, each in cast("dict[str, object]", value).items()}
        case list():
            return tuple(map(_frozen, cast("list[object]", value)))
        case _:
            return value
