"""Theorems about the page about a check, and its pictures."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mjrun.check import check_page
from mjrun.check.check import CheckResult, ModelCheck
from mjrun.check.check_page import FindingCards, FindingRenderer, write_check_page
from mjrun.check.finding import Finding, ModelCheckResult
from mjrun.errors import NoRendererError, UsageError
from tests.check.models import hinged, keyed, mjcf, write
from tests.check.rules.test_meshes import TRAY, TRAY_FACES, asset
from tests.reporters import RecordingReporter


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check_page, "SIZE", (140, 105))


PAIR = mjcf(
    '<geom name="floor" type="plane" size="2 2 .1"/>\n<body name="left"><geom name="l" size=".1"/></body>\n'
    '<body name="right" pos=".5 0 0"><joint name="r" axis="0 1 0"/><geom size=".1"/></body>'
)


def colours(object_: str, message: str = "", code: str = "MJ206") -> tuple[float, float]:
    """The shares of a picture that are red, for the object, and blue, for others that the message names."""
    image = FindingRenderer("pair.xml").picture(Finding(code, "warning", message, "pair.xml", 1, object_))
    red, green, blue = np.moveaxis(np.asarray(Image.open(io.BytesIO(image)), float), 2, 0)
    return float((red > 1.5 * np.maximum(green, blue)).mean()), float((blue > 1.5 * red).mean())


def test_the_object_is_red_and_others_that_a_message_names_are_blue() -> None:
    write("pair.xml", PAIR)
    for name in ("body 'left'", "joint 'r'", "geom 'l'", "geom 2 of body 'right'"):
        red, blue = colours(name)
        assert red > 0.02
        assert blue == 0
    red, blue = colours("body 'left'", "it touches geom 2 of body 'right'")
    assert min(red, blue) > 0.01
    assert FindingRenderer("pair.xml").picture(Finding("MJ701", "error", "unstable", "pair.xml")) == b""


def test_a_page_has_a_card_for_each_finding_the_worst_first() -> None:
    write("a.xml", hinged('range="2 1"'))
    write("broken.xml", hinged("limited='true'"))
    result = ModelCheck(["a.xml", "broken.xml"], steps=0).run()
    reporter = RecordingReporter()
    write_check_page("page.html", result, "2 models", FindingCards(reporter), "mjrun check a.xml")
    page = Path("page.html").read_text()
    assert re.findall(r"</span> (MJ\d+)", page) == ["MJ303", "MJ302"]
    assert re.findall(r"<code>([^<]*xml:\d+)</code>", page) == ["broken.xml:5", "a.xml:5"]
    assert len(re.findall(r'<img src="data:image/jpeg;base64,', page)) == 1
    assert reporter.warnings == []


def test_a_hull_is_drawn_where_a_mesh_collides_as_it() -> None:
    before = asset(TRAY, TRAY_FACES)
    write("pair.xml", mjcf('<geom name="tray" type="mesh" mesh="m"/>', before=before))
    assert colours("geom 'tray'", code="MJ506")[0] > 1.02 * colours("geom 'tray'")[0]


@pytest.mark.parametrize("dry_run", [True, False])
def test_a_fix_has_a_card_with_pictures_of_both_models_if_it_can_be_seen(dry_run: bool) -> None:
    write(
        "a.xml",
        keyed('qpos="1.5"', 'range="-1 1" actuatorfrcrange="9 -9"').replace('size=".1"', 'size=".1" pos=".3 0 0"'),
    )
    cards = FindingCards(RecordingReporter())
    result = ModelCheck(["a.xml"], steps=0, fix=True, unsafe_fixes=True, dry_run=dry_run).run(
        before_fix=cards.add_fixes
    )
    write_check_page("page.html", result, "", cards, "")
    page = Path("page.html").read_text()
    assert re.findall(r"fix</span> (MJ\d+)", page) == ["MJ302", "MJ402"]
    before, after = re.findall(r'<img src="data:image/jpeg;base64,([^"]*)', page)
    assert before != after
    assert page.count("before and after the fix") == 1


def test_names_are_escaped_and_a_page_without_a_renderer_has_no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> bytes:
        raise NoRendererError({}, "install one")

    write("a.xml", hinged())
    monkeypatch.setattr(FindingRenderer, "picture", fail)
    finding = Finding("MJ302", "warning", "<script>\x1b", "a.xml", 5, "joint 'j'", "<b>")
    reporter = RecordingReporter()
    result = CheckResult((ModelCheckResult("a.xml", True, (finding, finding)),), 0, 0)
    write_check_page("page.html", result, "", FindingCards(reporter), "")
    page = Path("page.html").read_text()
    assert "&lt;script&gt;\\x1b" in page
    assert "<img" not in page
    assert len(reporter.warnings) == 1
    with pytest.raises(UsageError, match="a file that ends with"):
        write_check_page("page.txt", CheckResult((), 0, 0), "", FindingCards(reporter), "")
