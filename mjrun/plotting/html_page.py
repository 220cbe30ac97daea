"""An HTML page about a result, without other files, scripts or network access.

Text is always escaped: a page consists of `Markup`, which functions make from texts.
"""

import base64
import html
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast
from urllib.parse import quote

from mjrun.dataclass import dataclass
from mjrun.errors import BadValueError, clean, concerning, file_errors, option
from mjrun.formats.input_file import parse_manifest
from mjrun.formats.manifest import fingerprint
from mjrun.formats.output_writer import OutputWriter, StagedFile
from mjrun.plotting.table_statistics import ColumnStatistics
from mjrun.plotting.theme import theme_style
from mjrun.probe.verdict import Verdict
from mjrun.suffixes import HTML
from mjrun.version import __version__

_VOID = frozenset({"img", "link", "meta", "col", "br", "source"})
_VERSIONS = ("mjrun", "mujoco", "numpy", "python")
_IN_SECONDS = ("timestep", "simulated", "duration", "wall", "simulation_wall", "draw_wall")
DEEPEST = 8  # maximum depth of nested mappings
# Facts of a result that other parts of the page show.
_ELSEWHERE = ("path", "paths", "assertions")
_STYLE = Path(__file__).with_name("html_page.css")
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data: file: 'self'; media-src data: file: 'self'"
MEGABYTE = 1_000_000
_NARROW = "max-width: 100%"  # in notebooks, which have no style sheet of ours
SMALLEST = 320  # width of a compared picture [pixels]
NOTEBOOK = 32  # [MB] that an output of a notebook may have
# Media types of suffixes that browsers display.
IMAGES = {
    ".png": "image/png",
    ".apng": "image/apng",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".gif": "image/gif",
    ".webp": "image/webp",
    ".svg": "image/svg+xml",
}
VIDEOS = {".mp4": "video/mp4", ".m4v": "video/mp4", ".webm": "video/webm", ".mov": "video/mp4"}
MAKER = f"mjrun {__version__}"


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


def table_element(
    caption: str, heads: Sequence[str], rows: Sequence[Markup], numeric: Sequence[int] = (), above: str = ""
) -> Markup:
    """Returns a table that scrolls separately if it is too wide.

    Args:
      above: the heading above it; a caption that repeats it is not visible.
    """
    cells = [
        element("th", head, scope="col", class_="number" if i in numeric else None) for i, head in enumerate(heads)
    ]
    head = element("thead", element("tr", *cells))
    class_ = "repeated" if caption.lower() == above.lower() else None
    table = element("table", element("caption", caption, class_=class_), head, element("tbody", *rows))
    return element("div", table, class_="scroll", tabindex="0")


def _attribute(key: str, value: str | bool | None) -> str:
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{html.escape(clean(str(value)))}"'


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
    rows = [(key, element("code", _text(value))) for key, value in flat(options).items()]
    return _folded(PageFactTable("Options", "Options", ["Option", "Value"], rows))


def _hashes(title: str, entries: object) -> Iterator[Markup]:
    files = [_mapping(file) for file in cast(list[object], entries)] if isinstance(entries, list) else []
    texts = [[_text(file.get(key, "")) for key in ("path", "bytes", "sha256")] for file in files]
    rows = [(path, size, element("code", digest)) for path, size, digest in texts]
    return _folded(PageFactTable(title, title, ["File", "Bytes", "SHA-256"], rows, [1]))


def _folded(facts: "PageFactTable") -> Iterator[Markup]:
    """Yields a table that a click unfolds; nothing if it has no rows."""
    if facts.rows:
        summary = element("summary", f"{facts.title} ({len(facts.rows)})")
        yield element("details", summary, facts_table(facts))


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
    if key == "Command":  # a line ends between words, not after the hyphens of an option
        parts = re.split(r"(\s+)", text)
        return element("code", *(element("span", part) if part.strip() else part for part in parts), class_="command")
    return element("code", text)


def _text(value: object) -> str:
    """Formats a value in one line: lists with commas, numbers in their shortest form."""
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, cast(Sequence[object], value)))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _mapping(value: object) -> dict[str, object]:
    return dict(cast(Mapping[str, object], value)) if isinstance(value, Mapping) else {}


@dataclass(frozen=True)
class ShownFile:
    """A file that a page shows.

    Attributes:
      path: the path as specified.
      kind: media type; None if browsers do not display it.
      address: content as a data URI, or the path relative to the page.
      size: size [bytes]; None for a folder.
    """

    path: str
    kind: str | None
    address: str
    size: int | None

    @property
    def is_embedded(self) -> bool:
        """True if the page contains the file."""
        return self.address.startswith("data:")


@dataclass(frozen=True)
class PageFigure:
    """A figure: its `<svg>` element, a description in words, and notes."""

    svg: str
    description: str
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class TableStatistics:
    """The statistics of a table."""

    path: str
    rows: int
    columns: Sequence[ColumnStatistics]


@dataclass(frozen=True)
class PageFactTable:
    """A table of words and numbers in a separate section.

    Attributes:
      title: title of the section.
      caption: caption of the table.
      heads: heads of its columns.
      rows: cells of each row, the first of which is its name.
      numeric: indices of the numeric columns.
    """

    title: str
    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric: Sequence[int] = ()


@dataclass(frozen=True)
class PageCard:
    """A finding or a fix, with pictures of what it is about.

    Attributes:
      title: its heading.
      level: `error`, `warning`, `note` or `fix`.
      places: where it was found.
      texts: paragraphs, of which the first is the message.
      images: the addresses of pictures.
    """

    title: str
    level: str
    places: Sequence[str]
    texts: Sequence[str]
    images: Sequence[str] = ()


@dataclass(frozen=True)
class ImageSlider:
    """Two pictures of the same size under a slider, and their difference.

    Attributes:
      a, b, difference: their addresses.
      width: width of each [pixels].
      caption: facts about the two.
      scale: facts about the difference.
    """

    a: str
    b: str
    width: int
    caption: str
    difference: str
    scale: str


@dataclass(frozen=True)
class Page:
    """A page about a result.

    Attributes:
      title: title of the page.
      maker: the program, with its version.
      facts: the main findings, shown first.
      cards: findings and fixes with pictures, shown after the facts.
      notes: paragraphs below the title.
      verdicts: verdicts of assertions, each with its file.
      verdict: whether all is well in addition to the assertions, and in words.
      pairs: pictures to compare.
      refresh: time after which a browser loads the page again [s].
    """

    title: str
    maker: str
    figures: Sequence[PageFigure] = ()
    verdicts: Sequence[tuple[str, Verdict]] = ()
    files: Sequence[ShownFile] = ()
    tables: Sequence[TableStatistics] = ()
    manifests: Sequence[FileManifest] = ()
    facts: Sequence[PageFactTable] = ()
    cards: Sequence[PageCard] = ()
    notes: Sequence[str] = ()
    verdict: tuple[bool, str] | None = None
    pairs: Sequence[ImageSlider] = ()
    refresh: int | None = None


def data_uri(kind: str, content: bytes) -> str:
    """Returns a file of a media type, such as `image/png`, as an address."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def page_file(path: str, page: str, limit: float) -> ShownFile:
    """Describes the file at `path` for the page at `page`.

    Args:
      limit: maximum size of an embedded file [MB].

    Raises:
      FileError: the file does not exist or cannot be read.
    """
    file = Path(path)
    kind = (IMAGES | VIDEOS).get(file.suffix.lower())
    with file_errors(file):
        size = None if file.is_dir() else file.stat().st_size
        if kind and size is not None and size <= limit * MEGABYTE:
            return ShownFile(path, kind, data_uri(kind, file.read_bytes()), size)

    beside = os.path.relpath(os.path.realpath(file), Path(os.path.realpath(page)).parent)
    return ShownFile(path, kind if size is not None else None, f"./{quote(os.fsencode(beside))}", size)


def media_html(paths: Iterable[str | Path]) -> str | None:
    """Returns images and videos as a notebook shows them, complete in itself, or None. Large files are only named.

    Raises:
      FileError: a file does not exist or cannot be read.
    """
    files = [
        page_file(str(path), str(path), NOTEBOOK) for path in paths if Path(path).suffix.lower() in IMAGES | VIDEOS
    ]
    shown = [_medium(file) if file.is_embedded else element("p", f"{file.path} is too large") for file in files]
    return element("div", *shown) if shown else None


def html_page(page: Page) -> str:
    """Returns the whole document; the same page gives the same text."""
    names = [facts.title.lower().replace(" ", "-") for facts in page.facts]
    unique = [name if names.count(name) == 1 else f"{name}-{number}" for number, name in enumerate(names)]
    sections = [
        *((name, facts.title, [facts_table(facts)]) for name, facts in zip(unique, page.facts, strict=True)),
        ("findings", "Findings", [element("div", *map(_card, page.cards), class_="cards")] if page.cards else []),
        ("assertions", "Assertions", list(_verdicts(page.verdicts))),
        ("plots", "Plots", [_figure(figure, index) for index, figure in enumerate(page.figures)]),
        ("comparison", "Side by side", list(map(_pair, page.pairs))),
        ("media", "Images and videos", list(_gallery([file for file in page.files if file.kind]))),
        ("columns", "Columns", [_columns(table) for table in page.tables]),
        ("origin", "How it was made", list(manifest_articles(page.manifests))),
        ("files", "Files", list(_links([file for file in page.files if not file.kind]))),
    ]
    shown = [section for section in sections if section[2]]
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        *([element("meta", http_equiv="refresh", content=str(page.refresh))] if page.refresh else []),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("meta", name="generator", content=page.maker),
        element("title", page.title),
        element("style", Markup(theme_style() + _STYLE.read_text("utf-8"))),
    )
    main = element("main", *(_section(*section) for section in shown))
    footer = element("footer", element("p", f"Made by {page.maker}. {_completeness(page.files)}"))
    body = element("body", _header(page, [section[:2] for section in shown]), main, footer)
    return f"<!doctype html>\n{element('html', head, body, lang='en')}\n"


def _header(page: Page, sections: Sequence[tuple[str, str]]) -> Markup:
    """Returns the title, the overall verdicts, and links to the sections."""
    failed = sum(not verdict.passed for _, verdict in page.verdicts)
    count = len(page.verdicts)
    verdicts = [page.verdict] if page.verdict else []
    if count:
        text = f"{failed} of {count} assertions failed" if failed else f"{_counted(count, 'assertion')} passed"
        verdicts.append((not failed, text))
    badges = [
        element("p", element("span", text, class_=f"badge {'pass' if is_well else 'fail'}"))
        for is_well, text in verdicts
    ]
    links = [element("a", title, href=f"#{name}") for name, title in sections]
    contents = element("nav", *links, aria_label="Contents") if len(links) > 1 else Markup()
    return element("header", element("h1", page.title), *badges, *(element("p", note) for note in page.notes), contents)


def _section(name: str, title: str, parts: Sequence[Markup]) -> Markup:
    return element("section", element("h2", title), *parts, id=name)


def _completeness(files: Sequence[ShownFile]) -> str:
    beside = [file for file in files if not file.is_embedded]
    if not beside:
        return "This page is complete in itself."
    return f"This page links to {_counted(len(beside), 'file')} beside it: keep them together."


def _verdicts(verdicts: Sequence[tuple[str, Verdict]]) -> Iterator[Markup]:
    if not verdicts:
        return
    several = len({path for path, _ in verdicts}) > 1
    rows: list[Markup] = []
    for path, verdict in verdicts:
        word, kind = ("✓ passed", "pass") if verdict.passed else ("✗ failed", "fail")
        finding = verdict.message.removeprefix(f"{verdict.text}: ")
        cells = [
            element("td", element("span", word, class_=f"verdict {kind}")),
            element("td", element("code", verdict.text)),
        ]
        rows.append(element("tr", *cells, element("td", finding), *([element("td", path)] if several else [])))
    heads = ["Verdict", "Assertion", "Found", *(["Table"] if several else [])]
    yield table_element("Assertions and what was found", heads, rows)


def facts_table(facts: PageFactTable) -> Markup:
    """Returns a table of words and numbers."""
    rows: list[Markup] = []
    for name, *others in facts.rows:
        cells = [element("th", element("code", name), scope="row")]
        cells += [
            element("td", text, class_="number" if i in facts.numeric else None) for i, text in enumerate(others, 1)
        ]
        rows.append(element("tr", *cells))
    return table_element(facts.caption, facts.heads, rows, facts.numeric, facts.title)


def _card(card: PageCard) -> Markup:
    level = element("span", card.level, class_=f"verdict {card.level}")
    message, *others = [element("p", text) for text in card.texts]
    words = element(
        "div",
        element("h3", level, f" {card.title}"),
        element("p", *(element("code", place) for place in card.places), class_="places"),
        message,
        *(element("div", *others, class_="note") for _ in others[:1]),
    )
    pictures = [element("img", src=image, alt=f"The objects of {card.title}", loading="lazy") for image in card.images]
    return element("article", words, *(element("div", *pictures) for _ in pictures[:1]))


def _figure(figure: PageFigure, index: int) -> Markup:
    label = f"plot-{index}"
    notes = [element("p", note, class_="note") for note in figure.notes]
    picture = element("div", Markup(inline_svg(figure.svg, label)), class_="scroll plot", tabindex="0")
    return element("figure", picture, element("figcaption", element("p", figure.description, id=label), *notes))


def inline_svg(svg: str, label: str) -> str:
    """Prepares an `<svg>` element for a page: full width, described by the element `label`, without metadata.

    Identifiers that the element refers to are prefixed with `label`, so that figures do not clash; others are removed.
    """
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", svg).replace("xlink:href=", "href=")
    used = set(re.findall(r'(?:href="|url\()#([^")]+)', svg))
    svg = re.sub(r'\sid="([^"]*)"', lambda match: f' id="{label}-{match[1]}"' if match[1] in used else "", svg)
    svg = re.sub(r'(href="|url\()#', rf"\1#{label}-", svg)
    opening, rest = svg.split(">", 1)
    drawn = re.search(r'\swidth="([\d.]+(?:pt|px)?)"', opening)
    style = f' style="--drawn: {drawn[1]}"' if drawn else ""  # the width at which letters have their nominal size
    opening = re.sub(r'\s(width|height|version|role)="[^"]*"', "", opening)
    return f'{opening}{style} role="img" aria-labelledby="{label}">{rest}'


def _pair(pair: ImageSlider) -> Markup:
    """Returns two pictures, of which a corner uncovers the second, and their difference below."""
    under = element("img", src=pair.b, alt="Picture B")
    over = element("div", element("img", src=pair.a, alt="Picture A"), class_="over", tabindex="0")
    both = element("div", under, over, class_="pair", style=f"--width: {max(pair.width, SMALLEST)}px")
    words = "A on the left, B on the right; drag the corner at the bottom of the line"
    caption = element("figcaption", f"{words} · {pair.caption}")
    difference = element("img", src=pair.difference, alt="Difference of the pictures", class_="wide")
    style = f"--width: {max(pair.width, SMALLEST)}px"
    shown = element("figure", element("div", difference, style=style), element("figcaption", pair.scale))
    return element("div", element("figure", both, caption), shown)


def _gallery(files: Sequence[ShownFile]) -> Iterator[Markup]:
    if files:
        yield element("div", *map(_medium, files), class_="gallery")


def _medium(file: ShownFile) -> Markup:
    assert file.kind
    if file.kind.startswith("video/"):
        link = file.path if file.is_embedded else element("a", file.path, href=file.address)
        picture = element(
            "video",
            link,
            src=file.address,
            controls=True,
            loop=True,
            muted=True,
            playsinline=True,
            aria_label=file.path,
            style=_NARROW,
        )
    else:
        picture = element("img", src=file.address, alt=f"Image {file.path}", loading="lazy", style=_NARROW)
    assert file.size is not None
    place = "" if file.is_embedded else ", beside this page"
    caption = element("figcaption", element("code", file.path), f" · {_bytes(file.size)}{place}")
    return element("figure", picture, caption)


def _links(files: Sequence[ShownFile]) -> Iterator[Markup]:
    items: list[Markup] = []
    for file in files:
        size = "folder" if file.size is None else _bytes(file.size)
        about = "replay in 3D, " if Path(file.path).suffix.lower() in HTML else ""
        items.append(element("li", element("a", file.path, href=file.address), f" · {about}{size}"))
    if items:
        yield element("ul", *items)


def _columns(table: TableStatistics) -> Markup:
    """Returns the columns of a table, folded if they are many."""
    gaps = any(column.missing for column in table.columns)
    rows: list[Sequence[str]] = []
    for column in table.columns:
        numbers = (number(each, 6) or "–" for each in (column.least, column.largest, column.mean, column.last))
        rows.append([column.name, column.unit, *numbers, *([str(column.missing or "")] if gaps else [])])
    title = f"{table.path}: {_counted(table.rows, 'row')}, {_counted(len(table.columns), 'column')}"
    heads = ["Column", "Unit", "Min", "Max", "Mean", "Last", *(["NaN"] if gaps else [])]
    facts = PageFactTable(title, title, heads, rows, range(2, len(heads)))
    return element("details", element("summary", title), facts_table(facts), open=len(table.columns) <= 40)


def number(value: float | None, digits: int = 5) -> str:
    """Formats a number with significant digits and a minus sign; empty for None and NaN."""
    return "" if value is None or math.isnan(value) else f"{value:.{digits}g}".replace("-", "−")


def _bytes(size: int) -> str:
    return f"{size / MEGABYTE:.1f} MB" if size >= MEGABYTE / 10 else f"{size / 1000:.1f} kB"


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


class PageWriter(OutputWriter):
    """A writer of one page. Opening it proves that the output can be written.

    Raises:
      BadValueError: the output does not end with .html.
      FileError: the output cannot be written.
    """

    def __init__(self, output: str) -> None:
        check_page_name(output)
        super().__init__(StagedFile(Path(output)))

    def write(self, page: Page) -> None:
        """Writes the page; the same page gives the same bytes.

        Raises:
          FileError: the page cannot be written.
        """
        self.write_file(html_page(page).encode())


def write_page(output: str, page: Page) -> None:
    """Writes and publishes a page.

    Raises:
      BadValueError: the output does not end with .html.
      FileError: it cannot be written.
    """
    with PageWriter(output) as writer:
        writer.write(page)
        writer.publish()


def check_page_name(output: str) -> None:
    """Raises BadValueError if `output` is not the name of a page."""
    if Path(output).suffix.lower() not in HTML:
        with concerning("html"):
            raise BadValueError(option("html"), output, "a file that ends with .html")


def included(paths: Iterable[str], page: str, limit: float) -> tuple[list[ShownFile], list[FileManifest]]:
    """Returns the files that a page at `page` shows, and the manifests among them.

    Args:
      limit: maximum size of an embedded file [MB].

    Raises:
      FileError: a file does not exist or cannot be read.
    """
    files: list[ShownFile] = []
    manifests: list[FileManifest] = []
    for path in paths:
        manifest = _manifest(path) if path.lower().endswith(".json") else None
        if manifest is None:
            files.append(page_file(path, page, limit))
        else:
            manifests.append(FileManifest(path, manifest))
    return files, manifests


def origin(title: str, command: str, inputs: Iterable[str], versions: Mapping[str, str]) -> FileManifest:
    """Returns how something was made: the command, the versions, and the hashes of the files that were read.

    Args:
      inputs: paths of the files; those that are not files, such as standard input, are omitted.
      versions: versions of libraries in addition to mjrun, by name.
    """
    files = [{**fingerprint(Path(path)), "path": clean(path)} for path in dict.fromkeys(inputs) if Path(path).is_file()]
    return FileManifest(title, {"command": command, "mjrun": __version__, **versions, "inputs": files})


def recorded_verdicts(manifests: Iterable[FileManifest]) -> list[tuple[str, Verdict]]:
    """Returns the verdicts of assertions in manifests, each with its file."""
    verdicts: list[tuple[str, Verdict]] = []
    for manifest in manifests:
        result = manifest.content.get("result")
        if not isinstance(result, Mapping):
            continue
        facts = cast(Mapping[str, object], result)
        entries = facts.get("assertions")
        for entry in cast(Sequence[object], entries) if isinstance(entries, list) else ():
            match entry:
                case {"text": str(text), "passed": bool(passed), "message": str(message)}:
                    verdicts.append((str(facts.get("path", manifest.path)), Verdict(text, passed, message)))
                case _:
                    pass
    return verdicts


def _manifest(path: str) -> dict[str, object] | None:
    """Returns the content of a JSON document if it is an mjrun manifest."""
    with file_errors(path):
        content = parse_manifest(Path(path).read_bytes())
    return content if content and "mjrun" in content else None
