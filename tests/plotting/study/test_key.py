"""The key above panels."""

from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from mjrun.plotting.study.axes import Sheet
from mjrun.plotting.study.key import LINE, Key, KeyEntry


def test_entries_take_as_many_lines_as_they_need(sheet: Sheet) -> None:
    entries = [KeyEntry(f"opt.integrator = {name}", Line2D([], [])) for name in ("Euler", "RK4", "implicit")]
    one, three = Key(sheet.canvas, entries, 600, 12), Key(sheet.canvas, entries, 180, 12)
    assert three.height == 3 * one.height
    assert Key(sheet.canvas, [], 600, 12).height == 0
    assert one.height == LINE * 0.92 * 12


def test_samples_and_names_are_drawn(sheet: Sheet) -> None:
    key = Key(sheet.canvas, [KeyEntry("median", Line2D([], [])), KeyEntry("failed", Rectangle((0, 0), 0, 0))], 600, 12)
    key.draw(10, 10)
    assert [text.get_text() for text in sheet.canvas.figure.texts] == ["median", "failed"]
    assert len(sheet.canvas.figure.artists) + len(sheet.canvas.figure.lines) + len(sheet.canvas.figure.patches) == 2
