"""Layout and contents of contact sheets."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mjrun.formats.ffmpeg import write_video
from mjrun.formats.image_and_video_reader import read_video
from mjrun.study.video_grid import GAP, LARGEST, VideoCell, sheet_layout, write_contact_sheet

COLOURS = [(200, 30, 30), (30, 200, 30), (30, 30, 200)]
SIZE = (120, 160, 3)


@pytest.mark.parametrize(
    ("cells", "grid"), [(1, (1, 1)), (2, (2, 1)), (4, (2, 2)), (6, (3, 2)), (9, (3, 3)), (16, (4, 4))]
)
def test_cells_stand_in_a_grid_of_the_shape_of_a_screen(cells: int, grid: tuple[int, int]) -> None:
    layout = sheet_layout(cells, (320, 240))
    assert (layout.columns, layout.rows) == grid
    assert layout.size[0] % 2 == layout.size[1] % 2 == 0


def test_cells_do_not_overlap_and_large_ones_are_made_smaller() -> None:
    layout = sheet_layout(7, (1281, 721))
    sheet = np.zeros(layout.size[::-1], int)
    for index in range(7):
        sheet[layout.place(index)] += 1
    assert sheet.max() == 1
    assert sheet.sum() == 7 * layout.width * layout.height
    assert max(layout.size) <= LARGEST
    assert layout.shrink == 2


def test_every_cell_shows_its_video_and_one_that_ended_stays_dimmed(tmp_path: Path) -> None:
    cells = []
    for index, colour in enumerate(COLOURS):
        frames = [np.full(SIZE, colour, np.uint8)] * (4 - 2 * (index == 1))
        path = tmp_path / f"{index}.mkv"
        write_video(path, frames, 10, codec="ffv1")
        cells.append(VideoCell(path, f"mass {index}", "unstable at step 20" if index == 1 else ""))
    output = tmp_path / "sheet.mkv"
    write_contact_sheet(str(output), cells, Fraction(10), Fraction(1))
    frames = read_video(output).frames.astype(int)
    layout = sheet_layout(3, (160, 120))
    assert frames.shape == (4, *layout.size[::-1], 3)
    middle = np.s_[55:65, 100:110]
    for index, colour in enumerate(COLOURS):
        shown = frames[:, *layout.place(index)][:, *middle]
        np.testing.assert_allclose(shown[:2], np.broadcast_to(colour, shown[:2].shape), atol=6)
        dimmed = 0.35 if index == 1 else 1
        np.testing.assert_allclose(shown[2:], np.broadcast_to(np.multiply(colour, dimmed), shown[2:].shape), atol=6)
        caption = frames[0, *layout.place(index)][:30, :80]
        assert caption.min(axis=2).max() > 150
    assert GAP == 4


def test_a_cell_that_reached_its_end_stays_as_it_is(tmp_path: Path) -> None:
    for name, count in (("a", 1), ("b", 3)):
        write_video(tmp_path / f"{name}.mkv", [np.full(SIZE, 120, np.uint8)] * count, 10, codec="ffv1")
    cells = [VideoCell(tmp_path / f"{name}.mkv", "") for name in "ab"]
    write_contact_sheet(str(tmp_path / "s.mkv"), cells, Fraction(10), Fraction(1))
    frames = read_video(tmp_path / "s.mkv").frames.astype(int)
    assert abs(frames[:, 50:70, 40:120] - 120).max() <= 4


def test_the_sheet_ends_with_the_notes_of_the_longest_videos(tmp_path: Path) -> None:
    write_video(tmp_path / "a.mkv", [np.full(SIZE, 200, np.uint8)] * 2, 10, codec="ffv1")
    cells = [VideoCell(tmp_path / "a.mkv", "", "unstable at step 20")] * 2
    write_contact_sheet(str(tmp_path / "s.mkv"), cells, Fraction(10), Fraction(1))
    frames = read_video(tmp_path / "s.mkv").frames.astype(int)
    assert [round(frame[60, 80].mean() / 10) for frame in frames] == [20, 20, 7]
