"""Mutations by seed: of MJCF as a tree, of documents as a tree and as a text, of tables as bytes, and of expressions.

The same seed always gives the same case.
"""

import random
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from tests.scoreboard.data import inputs_of

Tree = dict[object, object] | list[object] | str | float | bool | None

INPUTS = inputs_of(__name__)
NUMBERS, WORDS, TOKENS = INPUTS["NUMBERS"], INPUTS["WORDS"], INPUTS["TOKENS"]


def mjcf(seed: int, sources: Sequence[str]) -> str:
    """Returns a model with one to four changes.

    Args:
      sources: models to choose from.
    """
    draw = random.Random(f"mjcf {seed}")
    root = ET.fromstring(draw.choice(sources))
    for _ in range(draw.randint(1, 4)):
        draw.choice(_MJCF_MUTATIONS)(draw, root)
    return ET.tostring(root, encoding="unicode")


def document(seed: int, sources: Sequence[str]) -> str:
    """Returns a YAML document with one to three changes."""
    draw = random.Random(f"document {seed}")
    tree: Tree = yaml.safe_load(draw.choice(sources))
    for _ in range(draw.randint(1, 3)):
        tree = _changed(draw, tree)
    text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
    return _text_changed(draw, text) if draw.random() < 0.25 else text


def data(seed: int, sources: Sequence[bytes]) -> bytes:
    """Returns a file with some of its bytes changed, removed, inserted or doubled."""
    draw = random.Random(f"data {seed}")
    content = bytearray(draw.choice(sources))
    for _ in range(draw.randint(1, 6)):
        at = draw.randrange(len(content) + 1)
        length = draw.choice((1, 1, 2, 4, 8, 50))
        match draw.randrange(6):
            case 0:
                content[at : at + length] = draw.randbytes(length)
            case 1:
                del content[at : at + length]
            case 2:
                content[at:at] = content[at : at + length]
            case 3:
                content[at : at + 4] = draw.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f"))
            case 4:
                content[at:at] = draw.choice(
                    (b",", b"\n", b'"', b"nan", b"-", b"1e999", b"\0", b"\xe9", b"{", b"[", b"]")
                )
            case _:
                if at < len(content):
                    content[at] ^= 1 << draw.randrange(8)
    return bytes(content[: draw.randrange(len(content) + 1)]) if draw.random() < 0.1 else bytes(content)


def expression(seed: int) -> str:
    """Returns an expression that is usually almost right."""
    draw = random.Random(f"expression {seed}")
    text = _term(draw, draw.randint(1, 5))
    for _ in range(draw.choice((0, 0, 1, 2, 4))):
        at = draw.randrange(len(text) + 1)
        match draw.randrange(4):
            case 0:
                text = text[:at] + draw.choice(TOKENS) + text[at:]
            case 1:
                text = text[:at] + text[at + draw.randint(1, 3) :]
            case 2:
                text = text[:at] + draw.choice((*NUMBERS, *WORDS)) + text[at:]
            case _:
                text = text[:at] + text[at:][::-1] if draw.random() < 0.3 else text + text[at:]
    return text


def _term(draw: random.Random, depth: int) -> str:
    """Returns a random expression of at most this depth."""
    if depth <= 0:
        return draw.choice((*INPUTS["COLUMNS"], *NUMBERS[:8]))
    match draw.randrange(6):
        case 0:
            return f"{_term(draw, depth - 1)} {draw.choice(TOKENS[:14])} {_term(draw, depth - 2)}"
        case 1 | 2:
            arguments = ", ".join(_term(draw, depth - 1 - i) for i in range(draw.choice((1, 1, 1, 2, 3, 0))))
            return f"{draw.choice(INPUTS['FUNCTIONS'])}({arguments})"
        case 3:
            return f"({_term(draw, depth - 1)})"
        case 4:
            return f"{draw.choice(('-', 'not ', '+'))}{_term(draw, depth - 1)}"
        case _:
            return f"{_term(draw, depth - 1)} < {_term(draw, depth - 2)}"


# --- MJCF --------------------------------------------------------------------------------------------


def _elements(root: ET.Element) -> list[tuple[ET.Element, ET.Element]]:
    """Returns all elements except the root, each with its parent."""
    return [(parent, child) for parent in root.iter() for child in parent]


def _any(draw: random.Random, root: ET.Element) -> tuple[ET.Element, ET.Element]:
    return draw.choice(_elements(root) or [(root, ET.SubElement(root, "worldbody"))])


def _delete(draw: random.Random, root: ET.Element) -> None:
    parent, child = _any(draw, root)
    parent.remove(child)


def _duplicate(draw: random.Random, root: ET.Element) -> None:
    parent, child = _any(draw, root)
    parent.insert(draw.randrange(len(parent) + 1), child)


def _move(draw: random.Random, root: ET.Element) -> None:
    parent, child = _any(draw, root)
    inside = set(child.iter())
    targets = [element for element in root.iter() if element not in inside]
    if targets:
        parent.remove(child)
        draw.choice(targets).append(child)


def _rename_tag(draw: random.Random, root: ET.Element) -> None:
    _, child = _any(draw, root)
    child.tag = draw.choice([element.tag for element in root.iter()])


def _wrap(draw: random.Random, root: ET.Element) -> None:
    parent, child = _any(draw, root)
    parent.remove(child)
    wrapper = ET.SubElement(parent, draw.choice(("body", "frame", "replicate", "default", "worldbody", "include")))
    if wrapper.tag == "replicate":
        wrapper.attrib |= {"count": draw.choice(("0", "2", "5", "-1", "nan")), "offset": ".1 0 0"}
    wrapper.append(child)


def _attributes(root: ET.Element) -> list[tuple[ET.Element, str]]:
    return [(element, name) for element in root.iter() for name in element.attrib]


def _change(draw: random.Random, root: ET.Element) -> None:
    """Replaces a value by one of the same kind, or of another."""
    for element, name in draw.sample(all_of := _attributes(root), min(1, len(all_of))):
        parts = element.attrib[name].split()
        if parts and all(_is_number(part) for part in parts):
            match draw.randrange(4):
                case 0:
                    parts[draw.randrange(len(parts))] = draw.choice(NUMBERS)
                case 1:
                    parts = parts[: draw.randrange(len(parts) + 1)]
                case 2:
                    parts *= draw.randint(2, 4)
                case _:
                    parts = [draw.choice(NUMBERS) for _ in parts]
            element.attrib[name] = " ".join(parts)
        else:
            others = [e.attrib[n] for e, n in all_of if n == name or n == "name"]
            element.attrib[name] = draw.choice((*WORDS, *NUMBERS, *others))


def _rename_reference(draw: random.Random, root: ET.Element) -> None:
    names = [element.attrib["name"] for element in root.iter() if "name" in element.attrib]
    for element, name in draw.sample(all_of := _attributes(root), min(1, len(all_of))):
        element.attrib[name] = draw.choice((*names, "nobody"))


def _drop_attribute(draw: random.Random, root: ET.Element) -> None:
    for element, name in draw.sample(all_of := _attributes(root), min(1, len(all_of))):
        del element.attrib[name]


def _copy_attribute(draw: random.Random, root: ET.Element) -> None:
    for element, name in draw.sample(all_of := _attributes(root), min(1, len(all_of))):
        draw.choice(list(root.iter())).attrib[name] = element.attrib[name]


def _set_option(draw: random.Random, root: ET.Element) -> None:
    values = (*NUMBERS, "RK4", "implicit", "elliptic", "CG", "PGS", "sparse", "0 0 -9", "discrete")
    ET.SubElement(root, "option", {draw.choice(INPUTS["OPTIONS"]): draw.choice(values)})


def _add_keyframe(draw: random.Random, root: ET.Element) -> None:
    keyframes = ET.SubElement(root, "keyframe")
    values = " ".join(draw.choice(NUMBERS) for _ in range(draw.randint(0, 8)))
    ET.SubElement(keyframes, "key", {draw.choice(("qpos", "qvel", "ctrl", "act", "time", "mpos")): values})


def _is_number(text: str) -> bool:
    return text.replace(".", "").replace("-", "").replace("e", "").isdigit()


_MJCF_MUTATIONS: tuple[Callable[[random.Random, ET.Element], None], ...] = (
    _delete,
    _duplicate,
    _move,
    _rename_tag,
    _wrap,
    _change,
    _change,
    _change,
    _rename_reference,
    _rename_reference,
    _drop_attribute,
    _copy_attribute,
    _set_option,
    _add_keyframe,
)


# --- documents ---------------------------------------------------------------------------------------


def _places(tree: Tree) -> Iterator[tuple[dict[object, object] | list[object], object]]:
    """Yields every place in a tree: its container, and its key or index."""
    if isinstance(tree, dict):
        items: Sequence[tuple[object, object]] = list(tree.items())
    elif isinstance(tree, list):
        items = list(enumerate(tree))
    else:
        return
    for key, value in items:
        yield tree, key
        yield from _places(value)  # type: ignore[arg-type]


def _value(draw: random.Random) -> Tree:
    """Draws a value, in new lists and mappings."""
    return _thawed(draw.choice(INPUTS["VALUES"]))


def _thawed(value: Any) -> Tree:
    if isinstance(value, dict):
        return {key: _thawed(each) for key, each in value.items()}
    return [_thawed(each) for each in value] if isinstance(value, tuple) else value


def _changed(draw: random.Random, tree: Tree) -> Tree:
    """Returns the tree with one change."""
    places = list(_places(tree))
    if not places or draw.random() < 0.02:
        return _value(draw)
    container, key = draw.choice(places)
    other_container, other = draw.choice(places)
    elsewhere = other_container[other]  # type: ignore[index]
    if isinstance(elsewhere, dict | list):
        elsewhere = yaml.safe_load(yaml.safe_dump(elsewhere))  # or a tree might hold itself
    match draw.randrange(8):
        case 0:
            del container[key]  # type: ignore[arg-type]
        case 1 | 2 | 3:
            container[key] = _value(draw)  # type: ignore[index]
        case 4:
            container[key] = elsewhere  # type: ignore[index]
        case 5 if isinstance(container, dict):
            container[draw.choice((*WORDS, 0, None, 1.5, f"{key}s", other))] = container.pop(key)
        case 6:
            container[key] = [container[key]] * draw.randint(1, 3)  # type: ignore[index]
        case _:
            container[key] = {draw.choice(("name", "output", "model", "from", "when", "x")): container[key]}  # type: ignore[index]
    return tree


def _text_changed(draw: random.Random, text: str) -> str:
    """Returns the text with inserted parts that have a meaning in YAML."""
    for _ in range(draw.randint(1, 3)):
        at = draw.randrange(len(text) + 1)
        text = text[:at] + draw.choice(INPUTS["YAML_PARTS"]) + text[at:]
    return text


def texts(paths: Sequence[Path]) -> list[str]:
    """Returns the contents of files."""
    return [path.read_text() for path in paths]
