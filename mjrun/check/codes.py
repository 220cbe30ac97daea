"""The codes of all rules with their topics and explanations, known without importing the rules, MuJoCo or NumPy."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from mjrun.check.thresholds import described
from mjrun.errors import UnknownNameError

EXPLANATIONS = Path(__file__).with_name("explanations")
SITE = ""  # the address of the published documentation, ending in a slash; empty until one exists
TOPICS = {  # by the first digit of the code
    "0": "The check itself",
    "1": "Loading",
    "2": "Names, masses and inertias",
    "3": "Joints, actuators and sensors",
    "4": "Keyframes",
    "5": "Contacts and constraints",
    "6": "Cameras",
    "7": "Simulation",
    "8": "Tasks and policies",
}


@cache
def codes() -> Sequence[str]:
    """Returns the codes of all rules, sorted; each has a page in `mjrun.check.explanations`."""
    return sorted(page.stem for page in EXPLANATIONS.glob("*.md"))


def matching_codes(prefixes: Sequence[str]) -> frozenset[str]:
    """Returns the codes that begin with one of `prefixes`, in any case.

    Raises:
      UnknownNameError: no code begins with one of them.
    """
    matching: set[str] = set()
    for prefix in prefixes:
        found = {code for code in codes() if prefix and code.startswith(prefix.upper())}
        if not found:
            raise UnknownNameError("code", prefix, list(codes()))
        matching |= found
    return frozenset(matching)


def topic(code: str) -> str:
    """Returns the topic of a rule."""
    return TOPICS[code[2]]


def published_page(code: str) -> str:
    """Returns the address of the page of a rule; empty until the documentation is published."""
    return f"{SITE}rules/{code}.html" if SITE else ""


def local_page(code: str) -> str:
    """Returns the address of the file with the explanation of a rule, on this machine."""
    return (EXPLANATIONS / f"{code}.md").as_uri()


def explanation(code: str) -> str:
    """Returns what a rule finds, why it matters, what to do, its thresholds, an example and when to ignore it, in
    Markdown.
    """
    if code not in codes():
        raise UnknownNameError("rule", code, list(codes()))
    page = (EXPLANATIONS / f"{code}.md").read_text("utf-8")
    thresholds = "\n".join(f"- {line}" for line in described(code))
    return page.replace("## Example", f"## Thresholds\n\n{thresholds}\n\n## Example", 1) if thresholds else page
