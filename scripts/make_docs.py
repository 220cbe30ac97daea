"""Builds the site of the documentation, out/site, and the manual pages, out/man: `make docs`.

The source of the site is a copy of docs/ whose links to other files of the repository lead to pages of the site, and
pages that follow from the code: one per command, kind of document and rule of `mjrun check`, the columns of traces, the
exit codes, and the gallery. Sphinx turns every warning, such as a link that leads nowhere, into an error.
"""

import inspect
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

ROOT = Path(__file__).parents[1]
DOCS, SOURCE, SITE, MANUAL = ROOT / "docs", ROOT / "out/site-source", ROOT / "out/site", ROOT / "out/man"

# Pages outside of docs/, by their place on the site. The empty ones follow from the code.
PAGES = {
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "gallery.md": "scenes/README.md",
    "index.md": "README.md",
    "reference/options.md": "REFERENCE.md",
    "robustness.md": "SCORE.md",
    "security.md": "SECURITY.md",
}
GENERATED = ("index.md", "gallery.md")
# The pages of docs/ in the side bar. A page that is in none of these is an error.
CONTENTS = {
    "Begin": ("start", "installation", "tutorial", "gallery"),
    "By task": (
        *("teaching", "robotics", "vision", "reinforcement-learning"),
        *("continuous-integration", "performance"),
    ),
    "Guides": (
        *("videos", "cameras", "images", "view", "traces", "plots", "controls", "replay", "documents", "studies"),
        *("fitting", "policies", "evaluation", "gymnasium", "model-sources", "checking", "diff", "benchmarks"),
        *("scripting", "python"),
    ),
    "Reference": (
        *("reference/index", "reference/options", "reference/documents/index", "reference/columns"),
        "reference/exit-codes",
    ),
    "Problems": (
        *("problems/egl", "problems/glfw", "problems/libgl", "problems/unstable"),
        "rules/index",
    ),
    "About": ("exactness", "security", "robustness", "contributing", "changelog"),
}


def main() -> None:
    """Writes the source of the site and builds it."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    write_source(SOURCE)
    build(SOURCE, SITE)
    build(SOURCE, MANUAL, "man")
    for path in (SOURCE / "llms.txt", *SOURCE.rglob("*.md")):
        shutil.copy(path, SITE / path.relative_to(SOURCE))
    print(f"The site is {SITE / 'index.html'}, and the manual pages are in {MANUAL}")


def write_source(source: Path) -> None:
    """Writes all pages, and the files that they show or offer, to a folder."""
    for name, text in pages().items():
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, "utf-8")
    copy_files(source)


def build(source: Path, site: Path, builder: str = "html") -> None:
    """Runs Sphinx; a warning is an error.

    Raises:
      subprocess.CalledProcessError: the site has a broken link or another mistake, which Sphinx has printed.
    """
    strict = ("--fail-on-warning", "--keep-going", "--nitpicky", "--quiet")
    subprocess.run([sys.executable, "-m", "sphinx", *strict, "-b", builder, str(source), str(site)], check=True)


def pages() -> dict[str, str]:
    """Returns the text of every page, by its path in the source of the site."""
    files = {str(path.relative_to(DOCS)): path for path in sorted(DOCS.rglob("*.md"))}
    files |= {page: ROOT / name for page, name in PAGES.items() if page not in GENERATED}
    written = {page: with_site_links(path.read_text("utf-8"), path.parent, page) for page, path in files.items()}
    written |= {"gallery.md": gallery(), **command_pages(), **document_pages(), **rule_pages()}
    written |= {"reference/columns.md": columns_page(), "reference/exit-codes.md": exit_codes_page()}
    written["llms.txt"] = llms(written)
    written["index.md"] += "\n" + "\n".join(map(_toctree, CONTENTS, CONTENTS.values()))
    return written


def _toctree(caption: str, names: Sequence[str]) -> str:
    return "\n".join(["```{toctree}", ":hidden:", f":caption: {caption}", "", *names, "```", ""])


def with_site_links(text: str, folder: Path, page: str) -> str:
    """Returns a text of a folder of the repository with its links as they are on a page of the site."""
    places = {name: place for place, name in PAGES.items()}

    def replaced(match: re.Match[str]) -> str:
        file = os.path.relpath(folder / match[1], ROOT)
        if file in places:
            target = places[file]
        elif file.startswith("docs/"):
            target = file.removeprefix("docs/")
        else:
            target = f"files/{file}"
        return f"]({os.path.relpath(target, Path(page).parent)}{match[2] or ''})"

    return re.sub(r"\]\((?!https?:)([^)#]+)(#[^)]*)?\)", replaced, text)


def copy_files(source: Path) -> None:
    """Copies the files that pages show or offer: images, scenes and the videos that `make gallery` has made."""
    shutil.copytree(ROOT / "scenes", source / "files/scenes", ignore=shutil.ignore_patterns("__pycache__", "*.md"))
    for name in ("LICENSE", "constraints.txt"):
        shutil.copy(ROOT / name, source / "files" / name)
    for path in sorted((ROOT / "out").glob("*/*.mp4")):
        target = source / "_static/gallery" / path.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)
    (source / "_static").mkdir(exist_ok=True)
    shutil.copy(DOCS / "site.css", source / "_static/site.css")
    shutil.copy(DOCS / "conf.py", source / "conf.py")


def gallery() -> str:
    """Returns the page of the scenes: each with its video or image, its command, and its document."""
    text = (ROOT / "scenes/README.md").read_text("utf-8")
    introduction, *sections = re.split(r"^## ", text, flags=re.MULTILINE)
    lines = [introduction.replace("# Scenes", "# Gallery", 1).rstrip(), ""]
    for section in sections:
        title, _, body = section.partition("\n")
        lines += [f"## {title}", "", *_card(body.strip()), ""]
    return "\n".join(lines)


def _card(body: str) -> Iterator[str]:
    image = re.search(r"!\[([^]]*)\]\((pictures/([^.)]+)[^)]*)\)", body)
    text = body.replace(image[0], "").strip() if image else body
    video = ROOT / "out" / image[3] / f"{image[3]}.mp4" if image else None
    if image and video and video.is_file():
        settings = f'src="_static/gallery/{video.name}" poster="_images/{image[3]}.jpg"'
        yield f"<video controls loop muted playsinline {settings}></video>\n"
    if image:
        yield f"![{image[1]}](files/scenes/{image[2]})\n"
    yield with_site_links(text, ROOT / "scenes", "gallery.md")
    document = ROOT / "scenes" / f"{image[3]}.yaml" if image else None
    if document and document.is_file():
        content = document.read_text("utf-8").rstrip()
        yield f"\n:::{{dropdown}} {document.name}\n```yaml\n{content}\n```\n:::"


def command_pages() -> dict[str, str]:
    """Returns the page of each command, and the page that lists them."""
    from mjrun.cli.main import COMMANDS, load_command

    written = {f"reference/commands/{name}.md": _command_page(name, load_command(name)) for name in COMMANDS}
    table = "\n".join(
        f"| [`mjrun {name}`](commands/{name}.md) | {text.rstrip('.')} |" for name, text in COMMANDS.items()
    )
    toctree = _toctree("Commands", [f"commands/{name}" for name in COMMANDS])
    heading = "# Commands\n\n| command | purpose |\n|---|---|"
    written["reference/index.md"] = f"{heading}\n{table}\n\n{toctree}\n"
    return written


def _command_page(name: str, command: click.Command) -> str:
    from mjrun.cli.click_command import DeclaredOption, flags, is_repeatable, shown_default
    from mjrun.formats.format_lists import with_formats

    context = click.Context(command, info_name=f"mjrun {name}")
    usage = " ".join(command.collect_usage_pieces(context))
    lines = [f"# mjrun {name}", "", "```text", f"mjrun {name} {usage}", "```", ""]
    for paragraph in re.split(r"\n\s*\n", inspect.cleandoc(command.help or "")):
        if paragraph.startswith("\b"):
            lines += ["```sh", paragraph.removeprefix("\b").strip("\n"), "```", ""]
        else:
            lines += [_prose(paragraph), ""]
    sections: dict[str, list[str]] = {}
    for param in command.get_params(context):
        if not isinstance(param, DeclaredOption):
            continue
        option = param.declared
        value = "" if param.is_flag else f" {param.make_metavar(context)}"
        spelling = ", ".join(f"`{each}{value}`" for each in (*option.short, *flags(option)))
        default = f" Default: {_prose(text)}." if (text := shown_default(option)) else ""
        repeatable = " Repeatable." if is_repeatable(option) else ""
        entry = f"{spelling}\n: {_prose(with_formats(option.help))}{repeatable}{default}\n"
        sections.setdefault(option.section, []).append(entry)
    for title, entries in sections.items():
        lines += [f"## {title}", "", *entries]
    return "\n".join(lines)


def _prose(text: str) -> str:
    """Escapes what Markdown would take for markup in a sentence of a help text."""
    return re.sub(r"([*_<>\[\]{}])", r"\\\1", " ".join(text.split()))


def document_pages() -> dict[str, str]:
    """Returns a page per kind of document: its keys, with the values that each accepts."""
    from mjrun.cli.simulation_command import import_mujoco

    import_mujoco()
    from mjrun.document.json_schema import DOCUMENTS, json_schema

    names = list(DOCUMENTS)
    written = {f"reference/documents/{name}.md": _document_page(name, json_schema(name)) for name in names}
    lines = [
        "# Documents",
        "",
        "The keys of every kind of document. `mjrun schema KIND` prints the same as JSON Schema.",
        "",
    ]
    lines += [f"- [{name}]({name}.md)" for name in names]
    written["reference/documents/index.md"] = "\n".join([*lines, "", _toctree("Documents", names)])
    return written


def _document_page(name: str, schema: Mapping[str, Any]) -> str:
    lines = [f"# {name} document", "", _prose(str(schema.get("description", ""))), ""]
    lines += [f"Editors check it with the schema that `mjrun schema {name}` prints.", ""]
    named = {"": schema, **schema.get("$defs", {})}
    for title, definition in named.items():
        if "properties" not in definition:
            continue
        if title:
            lines += [f"## {title}", "", _prose(str(definition.get("description", ""))), ""]
        required = definition.get("required", ())
        for key, value in definition["properties"].items():
            mark = " (required)" if key in required else ""
            default = f" Default: `{value['default']}`." if value.get("default") not in (None, [], {}, "") else ""
            meaning = _prose(str(value.get("description", ""))) + default
            lines += [f"`{key}`{mark}: {_value(value)}", f": {meaning or title}", ""]
    return "\n".join(lines)


def _value(schema: Mapping[str, Any]) -> str:
    """Returns what a key accepts, in words."""
    return ", ".join(dict.fromkeys(_values(schema)))


def _values(schema: Mapping[str, Any]) -> Iterator[str]:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name != "Variable":  # `${name}` can replace any value
            yield f"[{name}](#{name.lower()})"
    elif "anyOf" in schema:
        for each in schema["anyOf"]:
            yield from _values(each)
    elif "enum" in schema:
        yield from (f"`{each}`" for each in schema["enum"])
    elif schema.get("type") == "array":
        items = ", ".join(dict.fromkeys(_values(schema.get("items", {}))))
        yield f"list of {items}" if items else "list"
    elif schema.get("type") not in (None, "null"):
        words = {"string": "text", "boolean": "true or false", "object": "mapping"}
        yield words.get(str(schema["type"]), str(schema["type"]))


def columns_page() -> str:
    """Returns the page of everything that a trace can measure: the groups of columns of all scenes."""
    from mjrun.model.sources import load
    from mjrun.probe.select import available_columns

    groups: dict[str, dict[str, Any]] = {}
    for path in sorted((ROOT / "scenes").glob("*.xml")):
        for column in available_columns(load(path)):
            group = column.name.partition("/")[0]
            entry = groups.setdefault(group, {"units": {}, "meaning": column.meaning, "of": {}, "example": column.name})
            entry["units"][column.unit or "–"] = None
            entry["of"][column.kind or "–"] = None
    lines = [
        "# Columns",
        "",
        "Everything that `--probe` can measure, by group. A model offers the groups for which it has objects;",
    ]
    lines += ["`mjrun trace MODEL --list` lists its columns, with the unit of each.", ""]
    lines += ["| group | of | unit | example | meaning |", "|---|---|---|---|---|"]
    for group, entry in groups.items():
        units, kinds = ", ".join(entry["units"]), ", ".join(entry["of"])
        lines.append(f"| `{group}` | {kinds} | {units} | `{entry['example']}` | {_prose(entry['meaning'])} |")
    return "\n".join([*lines, ""])


def exit_codes_page() -> str:
    """Returns the page of the exit codes: the errors behind each."""
    from mjrun import errors

    codes: dict[int, list[str]] = {}
    for _, cls in inspect.getmembers(errors, inspect.isclass):
        if issubclass(cls, errors.MjrunError) and "exit_code" in vars(cls) and isinstance(cls.exit_code, int):
            codes.setdefault(cls.exit_code, []).append(inspect.cleandoc(cls.__doc__ or "").split("\n\n")[0])
    lines = [
        "# Exit codes",
        "",
        "0 means that everything was done. `--json` prints an object `error` with the kind of the error.",
        "",
    ]
    lines += ["| code | when |", "|---|---|"]
    lines += [f"| {code} | {_prose(' '.join(texts))} |" for code, texts in sorted(codes.items())]
    return "\n".join([*lines, ""])


def rule_pages() -> dict[str, str]:
    """Returns a page per rule of `mjrun check`, and the page that lists them."""
    from mjrun.cli.simulation_command import import_mujoco

    import_mujoco()
    from mjrun.check.rule_table import RULES, TOPICS, explanation, topic

    rules = list(RULES.values())
    lines = [
        "# Rules of mjrun check",
        "",
        "`mjrun check --select MJ3` applies some of them, `--ignore MJ301` leaves one out,\n"
        "`--explain MJ301` prints its page.",
        "",
    ]
    for name in TOPICS.values():
        lines += [f"## {name}", "", "| rule | severity | finds |", "|---|---|---|"]
        lines += [f"| [{r.code}]({r.code}.md) | {r.severity} | {r.title} |" for r in rules if topic(r.code) == name]
        lines.append("")
    written = {"rules/index.md": "\n".join([*lines, _toctree("Rules", [r.code for r in rules])])}
    for rule in rules:
        head = f"# {rule.code}: {rule.title}\n\nSeverity: {rule.severity}."
        written[f"rules/{rule.code}.md"] = f"{head}\n\n{explanation(rule.code)}"
    return written


def llms(written: Mapping[str, str]) -> str:
    """Returns an index of the pages for language models: title, address and first sentence of each."""
    lines = [
        "# mjrun",
        "",
        "> MuJoCo models to videos, images, tables and timing reports, with one headless command.",
        "",
    ]
    lines += [
        "`mjrun skill` prints instructions for agents. `mjrun COMMAND --help` lists the options of a command.",
        "",
    ]
    for caption, names in CONTENTS.items():
        lines += [f"## {caption}", ""]
        for name in names:
            page = re.sub(r"^```.*?^```", "", written[f"{name}.md"].lstrip(), flags=re.DOTALL | re.MULTILINE)
            title, _, body = page.partition("\n")
            paragraph = next((p for p in body.split("\n\n") if re.match(r"[A-Z`\[]", p.strip())), "")
            plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", " ".join(paragraph.split()))
            sentence = re.split(r"(?<=\.)\s", plain)[0]
            lines.append(f"- [{title.lstrip('# ')}]({name}.md): {sentence}")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
