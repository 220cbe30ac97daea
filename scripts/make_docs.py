"""Builds the site of the documentation, out/site, and the manual pages, out/man: `make docs`.

The source of the site is a copy of docs/ whose links to other files of the repository lead to pages of the site, and
pages that follow from the code: one per command, kind of document and rule of `mjrun check`, the columns of traces, the
exit codes, and the gallery. Sphinx turns every warning, such as a link that leads nowhere, into an error.
"""

import ast
import base64
import hashlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import click
import yaml

ROOT = Path(__file__).parents[1]
DOCS, SOURCE, SITE, MANUAL = ROOT / "docs", ROOT / "out/site-source", ROOT / "out/site", ROOT / "out/man"

NOTEBOOK = DOCS / "notebook.ipynb"

# Pages outside of docs/, by their place on the site. The empty ones follow from the code.
PAGES = {
    "changelog.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
    "gallery.md": "scenes/README.md",
    "index.md": "README.md",
    "notebook.md": "docs/notebook.ipynb",
    "reference/options.md": "REFERENCE.md",
    "robustness.md": "SCORE.md",
    "security.md": "SECURITY.md",
}
GENERATED = ("index.md", "gallery.md", "notebook.md")
OUTPUTS = ("videos", "images", "traces", "plots", "exports")  # the sections of a run document that make files
SIGNALS = {130: ["Interrupted, as by Ctrl-C."], 141: ["The reader of a pipe ended."], 143: ["Terminated."]}
MOST_MEANINGS = 4  # of a group of columns
MOST_NUMBERS = 8  # of a scene in the gallery
# The pages of docs/ in the side bar. A page that is in none of these is an error.
CONTENTS = {
    "Begin": ("start", "installation", "tutorial", "notebook", "gallery"),
    "By task": (
        *("teaching", "robotics", "vision", "reinforcement-learning"),
        *("continuous-integration", "performance"),
    ),
    "Guides": (
        *("videos", "cameras", "images", "datasets", "view", "traces", "plots", "controls", "replay"),
        *("demonstrations", "exports", "episode-datasets", "documents"),
        *("studies", "fitting", "policies", "evaluation", "gymnasium", "model-sources", "checking", "fixes", "diff"),
        *("benchmarks", "scripting", "python"),
    ),
    "Reference": (
        *("reference/index", "reference/options", "reference/documents/index", "reference/columns"),
        "reference/exit-codes",
    ),
    "Problems": (
        *("problems/egl", "problems/glfw", "problems/libgl", "problems/framebuffer", "problems/loading"),
        *("problems/unstable", "problems/contacts", "problems/policy"),
        "rules/index",
    ),
    "About": ("exactness", "security", "robustness", "contributing", "changelog"),
}


def main() -> None:
    """Writes the picture of the architecture and the source of the site, and builds the site."""
    (DOCS / "architecture.svg").write_text(architecture(), "utf-8")
    shutil.rmtree(SOURCE, ignore_errors=True)
    write_source(SOURCE)
    with tempfile.TemporaryDirectory() as folder:
        cells = executed_notebook(folder)
    (SOURCE / "notebook.md").write_text(notebook_page(cells, SOURCE / "_static/notebook"), "utf-8")
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
    written |= {page: with_rule_links(written[page], page) for page in written if page.startswith("problems/")}
    written["notebook.md"] = notebook_page(json.loads(NOTEBOOK.read_text("utf-8"))["cells"])
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
        elif file.startswith("docs/") and file.endswith(".md"):
            target = file.removeprefix("docs/")
        else:
            target = f"files/{file}"
        return f"]({os.path.relpath(target, Path(page).parent)}{match[2] or ''})"

    return re.sub(r"\]\((?!https?:)([^)#]+)(#[^)]*)?\)", replaced, text)


def with_rule_links(text: str, page: str) -> str:
    """Returns a text in which codes of rules of `mjrun check`, except in code and links, lead to their pages."""
    folder = os.path.relpath("rules", Path(page).parent)
    parts = re.split(r"(^```.*?^```|`[^`\n]*`|\[[^]]*\])", text, flags=re.DOTALL | re.MULTILINE)
    parts[::2] = [re.sub(r"\b(MJ\d{3})\b", rf"[\1]({folder}/\1.md)", part) for part in parts[::2]]
    return "".join(parts)


def copy_files(source: Path) -> None:
    """Copies what pages show or offer: images, scenes, and the videos and replays that `make gallery` has made."""
    shutil.copytree(ROOT / "scenes", source / "files/scenes", ignore=shutil.ignore_patterns("__pycache__", "*.md"))
    for name in ("LICENSE", "constraints.txt"):
        shutil.copy(ROOT / name, source / "files" / name)
    media = source / "_static/gallery"
    media.mkdir(parents=True, exist_ok=True)
    for path in sorted((ROOT / "scenes").glob("*.xml")):
        shutil.copy(ROOT / f"scenes/pictures/{path.stem}.jpg", media)
        for suffix in (".mp4", ".html"):
            made = ROOT / f"out/{path.stem}/{path.stem}{suffix}"
            if made.is_file():
                shutil.copy(made, media)
    (source / "files/docs").mkdir()
    shutil.copy(DOCS / "architecture.svg", source / "files/docs")
    shutil.copy(NOTEBOOK, source / "files/docs")
    shutil.copy(DOCS / "site.css", source / "_static/site.css")
    shutil.copy(DOCS / "conf.py", source / "conf.py")


def architecture() -> str:
    """Returns a picture of the packages, SVG: a row per level of the table that a test enforces for all imports."""
    table = re.search(r"^HOUSE = (\(.*?^\))", (ROOT / "tests/test_architecture.py").read_text("utf-8"), re.S | re.M)
    assert table
    levels = [names for names in ast.literal_eval(table[1]) if names != ("__main__",)]
    width, row, box = 760, 40, 28  # pixels
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {row * len(levels)}" role="img">',
        "<title>The packages and modules of mjrun: each imports only from rows below its own</title>",
        "<style>",
        "rect { fill: #eef2f7; stroke: #9fb0c4; } text { fill: #1f2d3d; font: 12px sans-serif; text-anchor: middle; }",
        "@media (prefers-color-scheme: dark) { rect { fill: #24303d; stroke: #52667c; } text { fill: #e3eaf2; } }",
        "</style>",
    ]
    for level, names in enumerate(levels):
        shares = [len(name) + 4 for name in names]
        left = 0.0
        for name, share in zip(names, shares, strict=True):
            span = width * share / sum(shares)
            top = level * row + (row - box) / 2
            lines += [
                f'<rect x="{left + 2:.1f}" y="{top:.1f}" width="{span - 4:.1f}" height="{box}" rx="4"/>',
                f'<text x="{left + span / 2:.1f}" y="{top + 18:.1f}">{name}</text>',
            ]
            left += span
    return "\n".join([*lines, "</svg>", ""])


def gallery() -> str:
    """Returns the page of the scenes: a card for each with a run document, and a section for each other subject."""
    text = (ROOT / "scenes/README.md").read_text("utf-8")
    introduction, *sections = re.split(r"^## ", text, flags=re.MULTILINE)
    cards: list[str] = []
    subjects: list[str] = []
    for section in sections:
        title, _, body = section.partition("\n")
        scene = re.match(r"\s*([^`]*)```sh\n(mjrun run scenes/(\w+)\.yaml .*)\n```\s*!\[([^]]*)\]", body)
        if scene:
            cards += _card(title, scene[1].strip(), scene[2], scene[3], scene[4])
        else:
            subjects += [f"## {title}", "", with_site_links(body.strip(), ROOT / "scenes", "gallery.md"), ""]
    grid = ["::::::{grid} 1 1 2 2", ":gutter: 3", "", *cards, "::::::", ""]
    introduction = with_site_links(introduction.replace("# Scenes", "# Gallery", 1), ROOT / "scenes", "gallery.md")
    return "\n".join([introduction.rstrip(), "", *grid, *subjects])


def _card(title: str, text: str, command: str, name: str, alternative: str) -> Iterator[str]:
    """Yields the card of a scene: its video or image, what happens, its command, replay, numbers and document."""
    yield f":::::{{grid-item-card}} {title}\n"
    if (ROOT / f"out/{name}/{name}.mp4").is_file():
        files = f'src="_static/gallery/{name}.mp4" poster="_static/gallery/{name}.jpg" preload="metadata"'
        yield f'<video controls loop muted playsinline {files} aria-label="{alternative}"></video>\n'
    else:
        yield f"![{alternative}](files/scenes/pictures/{name}.jpg)\n"
    yield f"{text}\n\n```sh\n{command}\n```\n"
    if (ROOT / f"out/{name}/{name}.html").is_file():
        yield f'<a href="_static/gallery/{name}.html">Replay in 3D</a>\n'

    document = (ROOT / f"scenes/{name}.yaml").read_text("utf-8").rstrip()
    yield f"::::{{dropdown}} Numbers\n{numbers(yaml.safe_load(document))}\n::::\n"
    yield f"::::{{dropdown}} {name}.yaml\n```yaml\n{document}\n```\n::::\n"
    yield ":::::\n"


def numbers(document: Mapping[str, Any]) -> str:
    """Returns the size of the model of a run document, and the range of each quantity that its plots show."""
    import mjrun

    model = mjrun.load(ROOT / "scenes" / document["model"])
    settings = {key: value for key, value in document.items() if key not in OUTPUTS}
    simulation = mjrun.Simulation(ROOT / "scenes" / settings.pop("model"), **settings)
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder, "trace.npz")
        probes = [probe for plot in document["plots"] for probe in plot["probe"]]
        mjrun.Trace(simulation, str(trace), probe=probes).run()
        table = mjrun.read_table(trace)

    steps, timestep = len(table["time"]) - 1, model.opt.timestep
    lines = [
        f"Bodies: {model.nbody - 1} · degrees of freedom: {model.nv} · actuators: {model.nu} · "
        f"steps: {steps:,} of {1000 * timestep:g} ms",
        "",
    ]
    lines += ["| column | unit | lowest | highest | last |", "|---|---|---:|---:|---:|"]
    for name in [name for name in table if name != "time"][:MOST_NUMBERS]:
        values = table[name]
        cells = (f"{each:.4g}" for each in (values.min(), values.max(), values[-1]))
        lines.append(f"| `{name}` | {table.units.get(name) or '–'} | {' | '.join(cells)} |")
    return "\n".join(lines)


def executed_notebook(folder: str | Path, changes: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Executes the notebook of the tutorial in a folder, and returns its cells with their outputs.

    Args:
      changes: replacements in its text, by what they replace.

    Raises:
      CellExecutionError: a cell has failed.
    """
    import nbformat
    from nbclient import NotebookClient

    text = NOTEBOOK.read_text("utf-8")
    for old, new in (changes or {}).items():
        assert old in text, old
        text = text.replace(old, new)
    document = nbformat.reads(text, nbformat.NO_CONVERT)
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    client = NotebookClient(document, timeout=None, resources={"metadata": {"path": str(folder)}})
    client.execute(env={**os.environ, "PATH": programs, "IPYTHONDIR": str(Path(folder, ".ipython"))})
    return document.cells


def notebook_page(cells: Sequence[Mapping[str, Any]], media: Path | None = None) -> str:
    """Returns the page of a notebook: its texts, its code, and what each cell shows.

    Args:
      media: folder for images and videos, if the notebook was executed.
    """
    lines = list[str]()
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            lines += [with_site_links(source, DOCS, "notebook.md"), ""]
        else:
            lines += ["```ipython3", source, "```", ""]
        for output in cell.get("outputs", ()):
            lines += _shown(output, media)
    lines.insert(2, "[The notebook](files/docs/notebook.ipynb), to execute and change.\n")
    return "\n".join(lines)


def _shown(output: Mapping[str, Any], media: Path | None) -> Iterator[str]:
    """Yields an output of a cell as Jupyter shows it, except for warnings."""

    def moved(match: re.Match[str]) -> str:
        assert media
        media.mkdir(parents=True, exist_ok=True)
        content = base64.b64decode(match[2])
        name = f"{hashlib.sha256(content).hexdigest()[:16]}.{match[1].removesuffix('+xml')}"
        (media / name).write_bytes(content)
        return f'src="_static/notebook/{name}"'

    data = output.get("data", {"text/plain": output.get("text", "")})
    plain = escape(data["text/plain"].rstrip())
    if "image/svg+xml" in data:
        content = base64.b64encode(data["image/svg+xml"].encode()).decode()
        html = f'<img alt="{plain}" src="data:image/svg+xml;base64,{content}">'
    elif "image/png" in data:
        html = f'<img alt="{plain}" src="data:image/png;base64,{data["image/png"].strip()}">'
    else:
        html = data.get("text/html", f"<pre>{plain}</pre>")
    if html and output.get("name") != "stderr":  # a bar that has ended is empty
        linked = re.sub(r'src="data:\w+/([\w+]+);base64,([^"]+)"', moved, html)
        yield f'```{{raw}} html\n<div class="shown">{linked}</div>\n```\n'


def command_pages() -> dict[str, str]:
    """Returns the page of each command, and the page that lists them."""
    from mjrun.cli.main import COMMANDS, command_summary, load_command

    written = {f"reference/commands/{name}.md": _command_page(name, load_command(name)) for name in COMMANDS}
    table = "\n".join(
        f"| [`mjrun {name}`](commands/{name}.md) | {command_summary(name).rstrip('.')} |" for name in COMMANDS
    )
    toctree = _toctree("Commands", [f"commands/{name}" for name in COMMANDS])
    heading = "# Commands\n\n| command | purpose |\n|---|---|"
    written["reference/index.md"] = f"{heading}\n{table}\n\n{toctree}\n"
    return written


def _command_page(name: str, command: click.Command) -> str:
    from mjrun.cli.click_command import DeclaredOption, flags, is_repeatable, shown_default
    from mjrun.outputs.format_lists import with_formats

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
    from mjrun.probe.select import available_columns, column_groups

    columns = [column for path in sorted((ROOT / "scenes").glob("*.xml")) for column in available_columns(load(path))]
    lines = [
        "# Columns",
        "",
        "Everything that `--probe` can measure, by group. A model offers the groups for which it has objects;",
    ]
    lines += ["`mjrun trace MODEL --list` lists its groups, and with `--all` its columns.", ""]
    lines += ["| group | meaning | of | unit | example |", "|---|---|---|---|---|"]
    for group in column_groups(columns):
        units, kinds, meanings = (group.texts(name) for name in ("unit", "kind", "meaning"))
        meaning = "; ".join(meanings[:MOST_MEANINGS]) + "; …" * (len(meanings) > MOST_MEANINGS)
        facts = [f"`{group.name}`", _prose(meaning), ", ".join(kinds) or "–", ", ".join(units) or "–"]
        lines.append(f"| {' | '.join(facts)} | `{group.columns[0].name}` |")
    return "\n".join([*lines, ""])


def exit_codes_page() -> str:
    """Returns the page of the exit codes: the errors behind each."""
    from mjrun import errors

    codes = {errors.MjrunError.exit_code: ["A bug in mjrun; please report it."], **SIGNALS}
    for _, cls in inspect.getmembers(errors, inspect.isclass):
        if issubclass(cls, errors.MjrunError) and cls is not errors.MjrunError and isinstance(cls.exit_code, int):
            summary = re.split(r"(?<=\w)[.;:]\s", " ".join((cls.__doc__ or "").split()) + " ")[0]
            if "exit_code" in vars(cls):
                codes.setdefault(cls.exit_code, []).append(f"{summary}.")
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
    from mjrun.check.rule_catalogue import TOPICS, explanation, topic
    from mjrun.check.rule_runner import RULES

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
