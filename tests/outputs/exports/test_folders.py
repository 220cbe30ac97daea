"""Formats of exports that are folders of episodes."""

from pkgutil import resolve_name

import pytest

from mjrun.options.datasets import EXTRAS
from mjrun.options.option import options_of
from mjrun.outputs.exports import FORMATS, ExportFormat


@pytest.mark.parametrize("known", [FORMATS["lerobot"], FORMATS["minari"]], ids=lambda known: known.name)
def test_a_folder_is_made_by_a_job_that_accepts_its_format(known: ExportFormat) -> None:
    assert (known.name in EXTRAS, known.suffixes, known.write) == (True, (), "")
    product = resolve_name(known.product)
    assert callable(product.run)
    (formats,) = (each.kind for each in options_of(product) if each.name == "format")
    assert formats(known.name) == known.name
