"""Files of figures: read back, and the same bytes for the same drawing."""

import io
import os
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun.plotting.figure_writer
from mjrun.errors import BadValueError, FileError, MissingExtraError
from mjrun.plotting.figure_data import CurvePoints, DrawnCurve, DrawnFigure, DrawnPanel, panel_grid
from mjrun.plotting.figure_writer import FigureWriter, encoded, require_matplotlib, svg_text

SIZE = (480, 320)
GRID = panel_grid(2, 2, True, SIZE, None)
TIME = np.linspace(0, 1, 30)
CURVES = [DrawnCurve(name, CurvePoints(TIME, TIME**i), i) for i, name in enumerate(["α_1", "位置 <&>"])]
DRAWING = DrawnFigure(
    "Title & more", "time [s]", False, [DrawnPanel(f"p{i} [m]", CURVES, False, ()) for i in range(2)], ()
)
TAGS = {"title": "a title", "comment": "mjrun 1", "description": "{}"}


@pytest.mark.parametrize("name", ["svg", "pdf"])  # for a png, see test_table_and_study_plot.py
@pytest.mark.slow
def test_the_same_drawing_is_the_same_bytes(name: str) -> None:
    assert encoded(DRAWING, GRID, "light", name, TAGS) == encoded(DRAWING, GRID, "light", name, TAGS)


def test_a_png_has_its_size_and_its_tags() -> None:
    image = Image.open(io.BytesIO(encoded(DRAWING, GRID, "light", "png", TAGS)))
    assert (image.size, image.mode) == (SIZE, "RGB")
    tags = {name.lower(): text for name, text in image.text.items()}  # type: ignore[attr-defined]
    assert tags == TAGS


def test_an_svg_has_its_size_its_texts_as_text_and_its_panels() -> None:
    document = encoded(DRAWING, GRID, "light", "svg", TAGS).decode()
    root = ElementTree.fromstring(document)
    space = "{http://www.w3.org/2000/svg}"
    texts = [text.text for text in root.iter(f"{space}text")]
    assert {"Title & more", "time [s]", "p0 [m]", "p1 [m]", "α_1", "位置 <&>"} <= set(texts)
    assert len([g for g in root.iter(f"{space}g") if str(g.get("id")).startswith("axes_")]) == 2
    points = [float(root.attrib[side].removesuffix("pt")) * 96 / 72 for side in ("width", "height")]
    assert tuple(points) == SIZE
    assert not re.search(r"\b20\d\d-\d\d-\d\d\b", document)
    assert "DejaVu Sans" in document
    assert "sans-serif" in document


def test_an_svg_for_a_page_is_the_element_alone() -> None:
    text = svg_text(DRAWING, GRID, "dark")
    assert text.startswith("<svg")
    assert ElementTree.fromstring(text).tag.endswith("svg")


def test_a_pdf_is_one_page_of_its_size_without_a_date(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "abc")
    content = encoded(DRAWING, GRID, "print", "pdf", TAGS)
    assert content.startswith(b"%PDF")
    assert b"CreationDate" not in content
    assert os.environ["SOURCE_DATE_EPOCH"] == "abc"
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    assert box
    assert [float(side) * 96 / 72 for side in box.groups()] == pytest.approx(SIZE)


def test_the_user_s_own_settings_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib

    plain = encoded(DRAWING, GRID, "light", "png", {})
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 30, "axes.facecolor": "red", "text.usetex": True}):
        assert encoded(DRAWING, GRID, "light", "png", {}) == plain
        assert matplotlib.rcParams["font.size"] == 30


def test_a_file_appears_when_it_is_published(tmp_path: Path) -> None:
    target = tmp_path / "a.svg"
    with FigureWriter(str(target), "svg", SIZE) as writer:
        writer.write(DRAWING, GRID, "light")
        assert not target.exists()
        assert writer.publish() == [target]
    assert target.read_bytes() == encoded(DRAWING, GRID, "light", "svg", {})
    with FigureWriter(str(target), "svg", SIZE):
        pass
    assert [*tmp_path.iterdir()] == [target]


def test_what_cannot_be_written_is_reported_first(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="is not a folder"):
        FigureWriter("/dev/null/a.png", "png", SIZE)
    with pytest.raises(BadValueError, match="at most 16383 a side for webp"):
        FigureWriter(f"{tmp_path}/a.webp", "webp", (20_000, 100))


def test_without_matplotlib_what_to_install_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    require_matplotlib()
    monkeypatch.setattr(mjrun.plotting.figure_writer, "LIBRARY", "no_such_library")
    with pytest.raises(MissingExtraError, match=r"a plot needs no-such-library, .*\n.*mjrun\[plot\]"):
        require_matplotlib()
