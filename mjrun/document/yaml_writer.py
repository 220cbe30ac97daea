"""Conversion of plain values to YAML text that reads as the same values, with few quotes."""

# PyYAML says little of its types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

import re
from collections.abc import Mapping
from typing import cast

import yaml

from mjrun.document.scalars import meaning
from mjrun.document.tree import Plain
from mjrun.document.yaml_parser import FORBIDDEN
from mjrun.errors import UsageError, quoted

WIDTH = 110  # of a line, if it can be broken

_TAGS = {str: "str", int: "int", float: "float", bool: "bool", type(None): "null"}
_ESCAPED = re.compile("[\n\r\t]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
_SURROGATE = re.compile("[\ud800-\udfff]")


def yaml_text(value: Plain) -> str:
    """Formats `value`, made of mappings, lists, texts, numbers, booleans and None, as a document.

    Raises:
      UsageError: a document cannot contain one of its texts.
    """
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=WIDTH)


class _Dumper(yaml.SafeDumper):
    """A dumper that resolves plain scalars as the reader of documents does."""

    def resolve(self, kind: type[yaml.Node], value: str, implicit: tuple[bool, bool]) -> str:
        if kind is yaml.ScalarNode and implicit[0]:
            found = "merge" if value == "<<" else _TAGS[type(meaning(value))]
            return f"tag:yaml.org,2002:{found}"
        return super().resolve(kind, value, (False, False))

    def ignore_aliases(self, data: object) -> bool:
        return True

    def represent(self, data: object) -> None:
        """Writes the top level in block style, however short it is."""
        node = self.represent_data(data)
        if isinstance(node, yaml.CollectionNode):
            node.flow_style = False
        self.serialize(node)

    def represent_mapping(self, tag: str, mapping: object, flow_style: bool | None = None) -> yaml.MappingNode:
        entries = cast("Mapping[str, object]", mapping)
        for key in entries:
            if _CONTROL.search(key):
                raise UsageError(f"{quoted(key)}: a key in a document cannot contain control characters")
        return super().represent_mapping(tag, entries, flow_style)


def _represent_text(dumper: _Dumper, text: str) -> yaml.ScalarNode:
    if _SURROGATE.search(text):
        raise UsageError(f"{quoted(text)} is not valid UTF-8, which a document requires")
    style = '"' if _ESCAPED.search(text) or FORBIDDEN.search(text) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


def _represent_float(dumper: _Dumper, value: float) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:float", repr(value))


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(float, _represent_float)
