"""The site: every page is reachable, every link leads somewhere, and every rule is explained."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pygments.lexers import get_lexer_by_name
from pygments.token import Error

from mjrun.check.rule_runner import RULES
from mjrun.cli.main import COMMANDS
from tests.documentation import ROOT

sys.path.append(str(ROOT))

from docs.conf import LEXERS
from scripts import make_docs

BLOCK = re.compile(r"^```(\w+)$\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)")


@pytest.fixture(scope="module")
def source() -> dict[str, str]:
    return make_docs.pages()


@pytest.fixture(scope="module")
def pages(source: dict[str, str]) -> dict[str, str]:
    return {name: text for name, text in source.items() if name.endswith(".md")}


def prose(text: str) -> str:
    return re.sub(r"^```.*?^```|`[^`\n]*`", "", text, flags=re.DOTALL | re.MULTILINE)


def test_every_link_leads_to_a_page_or_a_file(pages: dict[str, str]) -> None:
    for name, text in pages.items():
        for target, _ in LINK.findall(prose(text)):
            place = os.path.normpath(Path(name).parent / target) if target else name
            file = ROOT / place.removeprefix("files/")
            assert place in pages or (place.startswith("files/") and file.is_file()), f"{name}: {target}"


def test_every_test_that_a_page_names_exists() -> None:
    pages = [*ROOT.glob("docs/*.md"), *ROOT.glob("*.md")]
    named = {name for page in pages for name in re.findall(r"\btests/[\w/]+\.py", page.read_text())}
    assert len(named) > 20
    assert not [name for name in sorted(named) if not (ROOT / name).exists()]


def test_every_page_is_in_the_contents_once(pages: dict[str, str]) -> None:
    listed = [f"{name}.md" for names in make_docs.CONTENTS.values() for name in names]
    for name, text in pages.items():
        if name != "index.md":
            trees = re.findall(r"```\{toctree\}.*?```", text, re.DOTALL)
            entries = "\n".join(trees).splitlines()
            listed += [f"{Path(name).parent / entry}.md" for entry in entries if re.fullmatch(r"[\w/-]+", entry)]

    assert sorted(listed) == sorted(pages.keys() - {"index.md"})


def test_every_command_and_every_rule_has_a_page(pages: dict[str, str]) -> None:
    assert {f"reference/commands/{name}.md" for name in COMMANDS} <= pages.keys()
    assert {f"rules/{code}.md" for code in RULES} <= pages.keys()


def test_a_command_page_has_each_option_of_its_help(pages: dict[str, str], tmp_path: Path) -> None:
    help_text = subprocess.run(
        [sys.executable, "-m", "mjrun", "video", "--help"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    options = set(re.findall(r"^  (?:-\w, )?(--[a-z-]+)", help_text, re.MULTILINE)) - {"--help"}

    assert len(options) > 60
    assert all(
        f"{option}`" in text or f"{option} " in text
        for text in [pages["reference/commands/video.md"]]
        for option in options
    )


def test_the_picture_of_the_architecture_is_current() -> None:
    current = (ROOT / "docs/architecture.svg").read_text("utf-8") == make_docs.architecture()

    assert current, "make docs draws it again"


def test_codes_of_rules_lead_to_their_pages_except_in_code() -> None:
    text = make_docs.with_rule_links("see MJ104, not `MJ104`", "problems/loading.md")

    assert text == "see [MJ104](../rules/MJ104.md), not `MJ104`"


def test_every_block_of_code_can_be_highlighted(pages: dict[str, str]) -> None:
    lexers = {lexer.aliases[0]: lexer() for lexer in LEXERS}
    blocks = [(name, *block) for name, text in pages.items() for block in BLOCK.findall(text)]
    assert {"py", "sh", "snakemake"} <= {language for _, language, _ in blocks}
    for name, language, code in blocks:
        lexer = lexers.get(language) or get_lexer_by_name(language)
        assert Error not in {kind for kind, _ in lexer.get_tokens(code)}, f"{name}: {code}"


@pytest.mark.slow
def test_sphinx_builds_the_site_without_a_warning(
    source: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(make_docs, "pages", lambda: source)
    make_docs.write_source(tmp_path / "source")
    make_docs.build(tmp_path / "source", tmp_path / "site", builder="dummy")
