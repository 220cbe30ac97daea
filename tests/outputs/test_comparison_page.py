"""The page about a comparison shows what the report states, and the pictures as they are."""

import base64
import io
import re
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from mjrun.errors import BadValueError, UsageError
from mjrun.formats.ffmpeg import write_video
from mjrun.outputs.diff import LISTED, Diff
from tests.plotting.test_html_page import external_references, read


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def page(a: str, b: str, **options: object) -> str:
    """Compares two results, and returns the page; it must be complete in itself."""
    Diff(a, b, html="page.html", **options).run()  # type: ignore[arg-type]
    html = Path("page.html").read_text("utf-8")
    assert external_references(html) == []
    return html


def table(name: str, *rows: str) -> str:
    Path(name).write_text("\n".join(["time,x,y", *rows]) + "\n")
    return name


def pictures(html: str) -> list[np.ndarray]:
    """Decodes the pictures in a page."""
    found = re.findall('src="data:image/png;base64,([^"]+)"', html)
    return [iio.imread(io.BytesIO(base64.b64decode(content))) for content in found]


def test_tables_that_differ_have_their_columns_and_curves() -> None:
    a = table("a.csv", *(f"{i},{i},{i}" for i in range(20)))
    b = table("b.csv", *(f"{i},{i},{i + (i > 4)}" for i in range(20)))
    html = page(a, b)
    text = read(html).text
    result = Diff(a, b).run()
    for part in ("a.csv and b.csv", "they differ", *result.differences, "15 of 20"):
        assert part in text
    assert html.count("<svg") == 1
    assert "Columns that differ" in text


def test_what_agrees_says_so_and_has_no_sections() -> None:
    a = table("a.csv", "0,1,2")
    text = read(page(a, a)).text
    assert "they agree" in text
    assert "Differences" not in text


def test_pictures_are_under_a_slider_pixel_for_pixel() -> None:
    random = np.random.default_rng(0)
    a = random.integers(0, 200, (12, 16, 3), np.uint8)
    b = a.copy()
    b[3, 4] += 50
    iio.imwrite("a.png", a)
    iio.imwrite("b.png", b)
    html = page("a.png", "b.png")
    below, above, difference = pictures(html)
    assert np.array_equal(below, b)
    assert np.array_equal(above, a)
    assert np.argwhere(difference.any(2)).tolist() == [[3, 4]]
    assert html.count('class="over"') == 1


def test_videos_are_shown_with_their_worst_frames() -> None:
    frames = np.zeros((3, 16, 16, 3), np.uint8)
    write_video("a.webm", frames, fps=10)
    frames[2] = 90
    write_video("b.webm", frames, fps=10)
    html = page("a.webm", "b.webm", max_changed=0.5)
    assert html.count("<video") == 2
    assert html.count('src="data:video/webm') == 2
    below, above, _ = pictures(html)
    assert below.mean() - above.mean() == pytest.approx(90, abs=8)
    assert 'src="./a.webm"' in page("a.webm", "b.webm", embed_up_to=0)


def test_models_have_their_differences() -> None:
    for name, size in (("a.xml", 1), ("b.xml", 2)):
        Path(name).write_text(f"<mujoco><worldbody><geom name='g' size='{size}'/></worldbody></mujoco>")
    assert "geom_size" in read(page("a.xml", "b.xml")).text
    many = "".join(f"<geom name='{i}' size='{{}}'/>" for i in range(LISTED + 9))
    for name, size in (("a.xml", 1), ("b.xml", 2)):
        Path(name).write_text(f"<mujoco><worldbody>{many.replace('{}', str(size))}</worldbody></mujoco>")
    assert "they differ" in read(page("a.xml", "b.xml")).text


def test_a_page_never_replaces_what_is_compared() -> None:
    a = table("a.csv", "0,1,2")
    Path("link.html").symlink_to("a.csv")
    with pytest.raises(UsageError, match=r"html link\.html is a compared file"):
        Diff(a, a, html="link.html").run()
    with pytest.raises(BadValueError, match=r"ends with \.html"):
        Diff(a, a, html="page.txt").run()
    assert Path("a.csv").read_text() == "time,x,y\n0,1,2\n"
