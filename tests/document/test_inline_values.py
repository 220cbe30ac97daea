"""Cameras and ghosts may be written where they are used."""

from pathlib import Path

import pytest

from mjrun.errors import DocumentError
from tests.document.run_documents import jobs


def test_a_ghost_cannot_go_through_a_file_in_a_folder_with_a_comma() -> None:
    Path("a,b").mkdir()
    with pytest.raises(
        DocumentError, match=r"^a,b/d.yaml:1:48: videos\[0\].ghost: 'a,b/g.csv': the path of what a ghost goes"
    ):
        jobs("{model: m.xml, videos: [{output: a.mp4, ghost: {trace: g.csv}}]}", name="a,b/d.yaml")
