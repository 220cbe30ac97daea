"""Options of the files of points."""

import pytest

from mjrun.errors import BadValueError
from mjrun.options.keep import KeepOptions


def test_kinds_are_a_list_or_a_text_with_commas() -> None:
    assert KeepOptions(keep="trace,video").keep == ("trace", "video")  # type: ignore[arg-type]
    assert KeepOptions(keep=("recording",)).keep == ("recording",)
    assert KeepOptions().keep == ()
    with pytest.raises(BadValueError, match="trace, recording, video"):
        KeepOptions(keep="movie")  # type: ignore[arg-type]
