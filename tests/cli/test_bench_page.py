"""Pages about benchmarks, against the report."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tests.page_cells import PageCells

if TYPE_CHECKING:
    from tests.conftest import Command


def test_the_page_has_the_tables_of_the_report(mjrun_here: Command) -> None:
    (mjrun_here.folder / "m.xml").write_text(
        '<mujoco><worldbody><body><joint/><geom size="1"/></body></worldbody></mujoco>'
    )
    options = ("--steps", "20", "--repeats", "2", "--scan", "integrator=euler,rk4")
    done = mjrun_here("bench", "m.xml", *options, "--html", "page.html")
    assert done.returncode == 0
    text = (mjrun_here.folder / "page.html").read_text("utf-8")
    cells = [cell for cell in PageCells(text).texts if cell]
    report = done.stdout.decode()
    for cell in cells[:10]:
        assert all(word in report for word in cell.split())
    assert "rk4" in cells
    assert "mjrun bench m.xml" in text
    assert not re.search(r"<script", text)


def test_a_page_of_another_name_is_refused_before_measuring(mjrun_here: Command) -> None:
    done = mjrun_here("bench", "scene:pendulum", "--html", "page.txt")
    assert done.returncode == 2
    assert b"a file that ends with .html" in done.stderr
