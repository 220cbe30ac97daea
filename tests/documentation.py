"""The pages that users read, README.md and those in docs/, and the code in them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = {
    path: path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
}
TEXT = "\n".join(PAGES.values())


def blocks(language: str, text: str = TEXT) -> list[str]:
    """Returns the code blocks in a language, without those that others contain."""
    unique = dict.fromkeys(re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    return [block for block in unique if not any(block in other for other in unique if other != block)]


def commands(text: str = TEXT) -> list[str]:
    """Returns the shell commands, each once and on one line."""
    lines = "".join(blocks("sh", text)).replace("\\\n", " ").splitlines()
    return list(dict.fromkeys(line for line in lines if line.strip()))
