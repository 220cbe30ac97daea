"""The options of pages."""

import pytest

from mjrun.errors import BadValueError
from mjrun.options.report import PageOptions


def test_the_size_of_embedded_files_is_not_negative() -> None:
    assert PageOptions(html="a.html", embed_up_to=0).embed_up_to == 0
    with pytest.raises(BadValueError, match="embed_up_to"):
        PageOptions(embed_up_to=-1)
