"""Manifests as sections of a page."""

from collections.abc import Iterator, Mapping, Sequence
from typing import cast

from mjrun.dataclass import dataclass
from mjrun.plotting.markup import Markup, element, table_element

_VERSIONS = ("mjrun", "mujoco", "numpy", "python")
_IN_SECONDS = ("timestep", "simulated", "duration", "wall", "simulation_wall", "draw_wall")
DEEPEST = 8  # maximum depth of nested mappings
# Facts of a result that other parts of the page show.
_ELSEWHERE = ("path", "paths", "assertions")


@dataclass(frozen=True)
class FileManifest:
    """The manifest of a file, whose content is not validated."""

    path: str
    content: Mapping[str, object]

    def is_part_of(self, other: "FileManifest") -> bool:
        """Returns whether `other` contains all of it, as a manifest beside a table contains the embedded one."""
        return all(key in other.content and other.content[key] == value for key, value in self.content.items())


def manifest_articles(manifests: Sequence[FileManifest]) -> Iterator[Markup]:
    """Yields the content of manifests; facts that all share come first, and only once."""
    every = [_facts(manifest) for manifest in manifests]
    common = {key: value for key, value in every[0].items() if all(f.get(key) == value for f in every)} if every else {}
    if len(manifests) > 1 and common:
        yield element("article", element("h3", "All of it"), _terms(common))
    else:
        common = {}
    for manifest, facts in zip(manifests, every, strict=True):
        terms = _terms({key: value for key, value in facts.items() if key not in common})
        options = _options(_mapping(manifest.content.get("options")))
        read = _hashes("Files that were read", manifest.content.get("inputs"))
        made = _hashes("Files that were made", manifest.content.get("outputs"))
        yield element("article", element("h3", manifest.path), terms, *options, *read, *made)


def _facts(manifest: FileManifest) -> dict[str, object]:
    """Returns the most important facts first, then all others but options and hashes; empty ones are omitted."""
    content = {key: value for key, value in manifest.content.items() if key not in ("options", "inputs", "outputs")}
    result, model = _mapping(content.pop("result", None)), _mapping(content.pop("model", None))
    versions = [f"{name} {content.pop(name)}" for name in _VERSIONS if isinstance(content.get(name), str)]
    facts = {
        "Command": content.pop("command", None),
        "Model": model.get("path"),
        "SHA-256 of the compiled model": model.get("sha256"),
        "Versions": ", ".join(versions),
    }
    others = {key: value for key, value in (flat(content) | flat(result)).items() if key not in _ELSEWHERE}
    facts |= {_named(key): value for key, value in others.items()}
    return {key: value for key, value in facts.items() if value not in (None, "")}


def _terms(facts: Mapping[str, object]) -> Markup:
    parts = [element("div", element("dt", key), element("dd", _value(key, value))) for key, value in facts.items()]
    return element("dl", *parts)


def _options(options: Mapping[str, object]) -> Iterator[Markup]:
    rows: list[Markup] = []
    for key, value in flat(options).items():
        head = element("th", element("code", key), scope="row")
        rows.append(element("tr", head, element("td", element("code", _text(value)))))
    if rows:
        table = table_element("Options", ["Option", "Value"], rows)
        yield element("details", element("summary", f"Options ({len(rows)})"), table)


def _hashes(title: str, entries: object) -> Iterator[Markup]:
    files = [_mapping(file) for file in cast(list[object], entries)] if isinstance(entries, list) else []
    rows: list[Markup] = []
    for file in files:
        head = element("th", element("code", _text(file.get("path", ""))), scope="row")
        size = element("td", _text(file.get("bytes", "")), class_="number")
        rows.append(element("tr", head, size, element("td", element("code", _text(file.get("sha256", ""))))))
    if rows:
        table = table_element(title, ["File", "Bytes", "SHA-256"], rows, [1])
        yield element("details", element("summary", f"{title} ({len(rows)})"), table)


def flat(values: Mapping[str, object], above: str = "") -> dict[str, object]:
    """Flattens values by path, `simulation.duration`; null and empty ones are omitted."""
    flattened: dict[str, object] = {}
    for key, value in values.items():
        path = f"{above}{key.removesuffix('_')}"
        if isinstance(value, Mapping) and path.count(".") < DEEPEST:
            flattened |= flat(cast(Mapping[str, object], value), f"{path}.")
        elif value not in (None, "", [], ()):
            flattened[path] = value
    return flattened


def _named(key: str) -> str:
    """Returns a fact's name for readers: `Wall [s]`."""
    return key.replace("_", " ").capitalize() + (" [s]" if key in _IN_SECONDS else "")


def _value(key: str, value: object) -> Markup:
    match value:
        case [int() | float() as width, int() | float() as height] if key == "Size":
            text = f"{width}x{height}"
        case _:
            text = _text(value)
    return element("code", text, class_="command" if key == "Command" else None)


def _text(value: object) -> str:
    """Formats a value in one line: lists with commas, numbers in their shortest form."""
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, cast(Sequence[object], value)))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _mapping(value: object) -> dict[str, object]:
    return dict(cast(Mapping[str, object], value)) if isinstance(value, Mapping) else {}
