"""Names that are long, empty, double, or look like something else."""

import itertools
from collections.abc import Iterator

from tests.scoreboard.forms.form import EITHER, REFUSED, Form, mjcf
from tests.scoreboard.forms.texts import HINGE, PLACES

EVERY = 3  # each name stands in a third of the places
NAMES = {
    "66,000 characters": "n" * 66000,
    "5,000 characters": "n" * 5000,
    "nothing": "",
    "a space": " ",
    "a slash": "a/b",
    "up and away": "../../x",
    "percents": "%s%n%x",
    "a formula": "=1+1",
    "a wildcard": "*",
    "brackets": "a[0]",
    "a comma and a colon": "a,b:c=d",
    "an index": "joint:0",
    "a number": "0",
    "not a number": "nan",
    "the world": "world",
    "a dash": "--help",
    "quotes": "&quot;'`$(id)",
    "markup": "&lt;b&gt;[bold]x[/]",
    "braces": "{name!r}",
    "an emoji": "\U0001f9e0" * 30,
    "a thousand accents": "e" + "\u0301" * 1000,
    "another alphabet": "колено",
    "a home": "~root",
    "a backslash": "a\\b",
}
FILES = (
    "%s%n",
    "-q",
    "--help",
    "a b",
    "=1+1",
    "a'b\"c",
    "$(id)",
    "[bold]",
    "*",
    "scene:x",
    "a:b",
    "{0}",
    "é",
    "\U0001f9e0",
    "x" * 240,
    "nul",
    "~",
    ";",
    "a\\b",
    "http:",
    ".",
    "..x",
)


def forms() -> Iterator[Form]:
    for i, (what, name) in enumerate(NAMES.items()):
        for place, inner in itertools.islice(PLACES.items(), i % EVERY, None, EVERY):
            if len(name) > 1000 and "missing" in place:
                continue
            model = mjcf(inner, 'model="{0}"' if place == "model" else "").replace("{0}", name)
            long = len(name) > 60000
            yield Form(f"{what} as {place}", {"model.xml": model}, loads=EITHER if long else None, drawn=False)
    for stem in FILES:
        for what, text, loads in (("model", mjcf(HINGE), None), ("broken model", "<mujoco><a/></mujoco>", REFUSED)):
            name = f"./{stem}.xml"
            yield Form(f"a {what} in {stem[:20]}.xml", {name: text}, name, loads)
    many = "".join(f'<body name="{"n" * 2000}{i}"/>' for i in range(300))
    yield Form("300 names of 2,000 characters", {"model.xml": mjcf(f"<worldbody>{many}</worldbody>")})
