"""Files of ranges of points are found in whichever folder they are, without a look at those of other ranges."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.formats.local_and_remote_folders import LocalFolder
from mjrun.study.range_folders import PointRange, RangeFolders

STUDY = "ab" * 32
RANGES = st.tuples(st.integers(0, 99), st.integers(0, 40)).map(lambda pair: (pair[0], pair[0] + pair[1]))


class ListedFolder(LocalFolder):
    """A folder that remembers which folders have been listed."""

    listed: ClassVar = list[str]()

    def __truediv__(self, name: str) -> "ListedFolder":
        return ListedFolder(Path(self.path(name)))

    def names(self, suffix: str | tuple[str, ...]) -> list[str]:
        self.listed.append(Path(self.path()).name)
        return super().names(suffix)


@pytest.fixture(autouse=True, scope="module")
def small_folders() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mjrun.study.range_folders.SIZES", (64, 32, 8))
        yield


@given(st.lists(RANGES, max_size=20, unique=True), RANGES)
def test_all_files_of_a_range_are_listed_and_no_folders_of_others(
    tmp_path_factory: pytest.TempPathFactory, ranges: list[tuple[int, int]], wanted: tuple[int, int]
) -> None:
    root = ListedFolder(tmp_path_factory.mktemp("parts"))
    folders = RangeFolders(root, STUDY, 100)
    names = dict[str, tuple[int, int]]()
    for points in ranges:
        name = folders.new_name(*points, "01234567.lease")
        Path(root.path(name)).touch()
        names[name] = points
    assert sorted(folders.names(".lease")) == sorted(names)

    ListedFolder.listed.clear()
    found = folders.names(".lease", lambda points: points.overlaps(*wanted))
    places = [points for name in ListedFolder.listed[1:] if (points := PointRange.of(name))]
    assert all(points.overlaps(*wanted) for points in places)
    assert {name for name, (first, last) in names.items() if first <= wanted[1] and wanted[0] <= last} <= {*found}
    for name, (first, last) in names.items():
        sizes = [size for size in (64, 32, 8) if first // size == last // size]
        assert name.count("/") == (len(sizes) if 64 in sizes else 0)


def test_the_files_of_a_small_study_are_in_one_folder_and_empty_folders_are_removed(tmp_path: Path) -> None:
    root = LocalFolder(tmp_path)
    assert RangeFolders(root, STUDY, 8).new_name(1, 2, "x.lease") == f"{STUDY[:16]}-1-2-x.lease"
    folders = RangeFolders(root, STUDY, 9)
    inner = folders.new_name(1, 2, "01234567.lease")
    assert inner == f"{STUDY[:16]}-0-7.points/{STUDY[:16]}-1-2-01234567.lease"
    (tmp_path / inner).touch()
    (tmp_path / "mine.points").mkdir()
    other = RangeFolders(root, "cd" * 32, 100)
    other.new_name(1, 2, "01234567.lease")
    assert [*map(Path, [folder.path() for folder in other.folders()])][-1] == tmp_path
    folders.remove_empty()
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{STUDY[:16]}-0-7.points", "mine.points"]
