"""Hostile models and archives, generated."""

import itertools
from collections.abc import Iterator

from tests.scoreboard.forms import archives, assets, files, formats, texts, values
from tests.scoreboard.forms.form import Form

GROUPS = {
    "circles and chains": files.cycles,
    "special files": files.special_files,
    "numbers": values.numbers,
    "sizes": values.sizes,
    "texts": texts.forms,
    "names": texts.names,
    "assets": assets.forms,
    "archives": archives.forms,
    "compiled models": formats.compiled_models,
    "URDF": formats.urdf,
}
# The tests try one in N of these groups, whose forms are quickly written and are refused by MuJoCo itself.
QUICK = {"circles and chains": 38, "special files": 122, "numbers": 240, "names": 240, "URDF": 122}


def all_forms() -> Iterator[tuple[str, Form]]:
    """Yields all forms, each with its group."""
    for group, forms in GROUPS.items():
        for form in forms():
            yield group, form


def quick_forms() -> Iterator[tuple[str, Form]]:
    """Yields a few that are quickly written and tried, the same each time."""
    for group, every in QUICK.items():
        for form in itertools.islice(GROUPS[group](), 1, None, every):
            yield group, form
