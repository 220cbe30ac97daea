"""HTML elements, in which text is always escaped."""

import html
from collections.abc import Sequence

from mjrun.errors import clean

_VOID = frozenset({"img", "link", "meta", "col", "br", "source"})


class Markup(str):
    """Text that is already HTML."""

    __slots__ = ()


def element(name: str, /, *content: str, **attributes: str | bool | None) -> Markup:
    """Returns an element with its content; content that is not markup is cleaned and escaped.

    Attributes are keywords, with a trailing `_` for reserved words and `_` for `-`; None and False are omitted.
    """
    written = "".join(_attribute(key, value) for key, value in attributes.items() if value not in (None, False))
    if name in _VOID:
        return Markup(f"<{name}{written}>")
    return Markup(f"<{name}{written}>{joined(*content)}</{name}>")


def joined(*content: str) -> Markup:
    """Joins pieces of HTML and texts, which are escaped."""
    return Markup(
        "".join(part if isinstance(part, Markup) else html.escape(clean(part), quote=False) for part in content)
    )


def table_element(caption: str, heads: Sequence[str], rows: Sequence[Markup], numeric: Sequence[int] = ()) -> Markup:
    """Returns a table that scrolls separately if it is too wide."""
    cells = [
        element("th", head, scope="col", class_="number" if i in numeric else None) for i, head in enumerate(heads)
    ]
    head = element("thead", element("tr", *cells))
    table = element("table", element("caption", caption), head, element("tbody", *rows))
    return element("div", table, class_="scroll", tabindex="0")


def _attribute(key: str, value: str | bool | None) -> str:
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{html.escape(clean(str(value)))}"'
