"""What a folder of results may replace."""

import json
from contextlib import ExitStack
from pathlib import Path

import pytest

from mjrun.errors import FileError
from mjrun.evaluation.folder import ResultsFolder
from mjrun.options.evaluation import MANIFEST


def test_a_new_folder_is_made_by_the_first_output_in_it(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b"
    folder = ResultsFolder(path)
    assert not (tmp_path / "a").exists()
    with ExitStack() as stack:
        folder.write_manifest(stack, {}).publish()
    assert [each.name for each in path.iterdir()] == [MANIFEST]


def test_what_an_evaluation_wrote_may_be_written_again_and_its_films_go(tmp_path: Path) -> None:
    with ExitStack() as stack:
        ResultsFolder(tmp_path).write_manifest(stack, {"seed": 3}).publish()
    for name in ("worst_seed1.mp4", "rank3_point2_seed7.mp4", "mine.mp4", "worst_seed1.mp4.txt"):
        (tmp_path / name).touch()
    folder = ResultsFolder(tmp_path)
    folder.remove_old_films(())
    assert {path.name for path in tmp_path.iterdir()} == {MANIFEST, "mine.mp4", "worst_seed1.mp4.txt"}
    assert json.loads((tmp_path / MANIFEST).read_text()) == {"seed": 3}


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("x")
    with pytest.raises(FileError, match="holds other things than an evaluation"):
        ResultsFolder(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "f").touch()
    with pytest.raises(FileError, match="is no folder"):
        ResultsFolder(tmp_path / "f")


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "f").touch()
    with pytest.raises(FileError, match="is not a folder"):
        ResultsFolder(tmp_path / "f" / "a")
