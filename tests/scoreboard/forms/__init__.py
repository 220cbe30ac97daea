"""Hostile models and archives, generated."""

import itertools
from collections.abc import Iterator

from tests.scoreboard.forms import (
    archives,
    assets,
    compiled_models,
    cycles,
    names,
    numbers,
    sizes,
    special_files,
    texts,
    urdf,
)
from tests.scoreboard.forms.form import Form

GROUPS = {
    "circles and chains": cycles.forms,
    "special files": special_files.forms,
    "numbers": numbers.forms,
    "sizes": sizes.forms,
    "texts": texts.forms,
    "names": names.forms,
    "assets": assets.forms,
    "archives": archives.forms,
    "compiled models": compiled_models.forms,
    "URDF": urdf.forms,
}
# Of these, one in so many is tried by the tests: they are quickly written, and MuJoCo refuses them by itself.
QUICK = {"circles and chains": 19, "special files": 61, "numbers": 120, "names": 120, "URDF": 61}


def all_forms() -> Iterator[tuple[str, Form]]:
    """All of them, each with its group."""
    for group, forms in GROUPS.items():
        for form in forms():
            yield group, form


def quick_forms() -> Iterator[tuple[str, Form]]:
    """A few that are quickly written and tried, the same each time."""
    for group, every in QUICK.items():
        for form in itertools.islice(GROUPS[group](), 1, None, every):
            yield group, form
