"""The page of a replay, opened in a headless browser: what it shows is computed from the perspective of its camera."""

import dataclasses
import itertools
import json
import math
import re
import struct
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from websockets.sync.client import ClientConnection

from mjrun.model.table_column import Column
from mjrun.outputs.event_detection import TimelineMark
from mjrun.outputs.export import FrameContacts, MeasuredValues
from mjrun.outputs.exports.html import Replay, ReplayCurve, ReplayPanel, curve_panels, replay_page
from mjrun.physics.recorded_states import SpooledRows
from tests.browser import Tab, browser

HOSTILE = "</script><img src=x onerror=hurt=1><script>hurt=1</script>"
TIMES = np.array([0.0, 0.5, 1.0, 2.0])
PLACES = np.array([-0.5, 0.0, 0.5, -0.5])  # x of a square at these times [m]
HALF, DISTANCE, YFOV = 0.25, 3.0, math.radians(40)  # of the square, and of the camera in front of it
SIZE = (640, 480)
LARGEST = 300_000  # bytes of a page without its data


def glb() -> bytes:
    """Returns a scene in which a red square moves in front of a camera."""
    corners = HALF * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], "<f4")
    moved = np.zeros((len(PLACES), 3), "<f4")
    moved[:, 0] = PLACES
    arrays = [corners, np.tile(np.array([0, 0, 1], "<f4"), (4, 1)), np.array([0, 1, 2, 0, 2, 3], "<u4")]
    arrays += [TIMES.astype("<f4"), moved]
    kinds = [(5126, "VEC3"), (5126, "VEC3"), (5125, "SCALAR"), (5126, "SCALAR"), (5126, "VEC3")]
    blocks = [array.tobytes() for array in arrays]
    starts = [0, *itertools.accumulate(map(len, blocks))]
    accessors = [
        {"bufferView": index, "componentType": component, "type": kind, "count": len(arrays[index])}
        for index, (component, kind) in enumerate(kinds)
    ]
    square = {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}
    nodes = [
        {"name": "world", "children": [1, 2], "extras": {"kind": "world"}},
        {"name": HOSTILE, "mesh": 0, "extras": {"kind": "body", "id": 1, "parent": "world"}},
        {"name": "front", "camera": 0, "translation": [0, 0, DISTANCE], "extras": {"kind": "camera", "id": 0}},
    ]
    channel = {"sampler": 0, "target": {"node": 1, "path": "translation"}}
    red = {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1}}
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": [square]}],
        "materials": [red],
        "cameras": [{"type": "perspective", "perspective": {"yfov": YFOV, "znear": 0.1}}],
        "animations": [{"samplers": [{"input": 3, "output": 4}], "channels": [channel]}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(block)}
            for start, block in zip(starts, blocks, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", starts[-1], b"BIN\0") + b"".join(blocks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def replay() -> Replay:
    """Returns a replay of the square, in which every name is hostile."""
    return Replay(
        title=HOSTILE,
        subtitle=HOSTILE,
        maker=HOSTILE,
        times=TIMES,
        panels=[ReplayPanel(HOSTILE, "m", [ReplayCurve(HOSTILE, "m", np.array([1.0, 0.0, 9.0]))])],
        curve_times=np.array([0.0, 1.0, 2.0]),
        marks=[TimelineMark(1.5, "event", HOSTILE)],
        contacts=FrameContacts(np.array([0, 1, 1, 0]), np.array([[0, 0, 0, 0, 0, 1, 0, 0, 5.0]] * 2)),
        facts=[(HOSTILE, HOSTILE)],
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    path.write_bytes(replay_page(replay(), glb()))
    return path


@pytest.fixture(scope="module")
def connection(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ClientConnection]:
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture
def tab(connection: ClientConnection, page: Path) -> Tab:
    """Returns the page at 0.25 s, seen by the camera of the model."""
    opened = Tab(connection, SIZE)
    opened.open(f"{page.as_uri()}#t=0.25&camera=front")
    opened.wait("document.documentElement?.dataset.ready")
    opened.settle()
    return opened


def time_of(tab: Tab) -> float:
    return float(tab.evaluate("document.querySelector('[role=slider]').ariaValueNow"))


def assert_shows(tab: Tab, time: float) -> None:
    """Asserts that the page shows `time` [s], and the square where the camera sees it then, to a pixel."""
    assert time_of(tab) == pytest.approx(time, abs=1e-6)
    pixels = tab.screenshot("canvas.view").astype(int)
    height, width, _ = pixels.shape
    columns = np.flatnonzero(((pixels[..., 0] - pixels[..., 1]) > 60).any(axis=0))
    x = np.interp(time, TIMES, PLACES)
    scale = height / 2 / math.tan(YFOV / 2) / DISTANCE
    expected = [width / 2 + scale * (x - HALF), width / 2 + scale * (x + HALF)]
    assert [columns[0], columns[-1] + 1] == pytest.approx(expected, abs=1)


@pytest.mark.slow
def test_page_is_driven_by_address_slider_keys_and_curves(tab: Tab) -> None:
    tab.evaluate("document.querySelector('aside').hidden = true")  # would cover the square
    assert_shows(tab, 0.25)
    x, y, width, height = tab.box("[role=slider]")
    tab.drag((x + 1, y + height / 2), (x + 0.75 * width, y + height / 2))
    assert_shows(tab, 1.5)
    tab.press("ArrowRight")
    assert_shows(tab, 2.0)
    tab.press("ArrowLeft")
    assert_shows(tab, 1.0)
    tab.press("Home")
    assert_shows(tab, 0.0)
    x, y, width, height = tab.box(".plot-area")
    tab.drag((x + 0.5 * width, y + 9), (x + 0.25 * width, y + 9))
    assert_shows(tab, 0.5)
    assert tab.evaluate("document.querySelector('.value').textContent") == "0.500"
    tab.evaluate("location.hash = '#t=0.75&camera=front'")
    tab.settle()
    assert_shows(tab, 0.75)


@pytest.mark.slow
def test_playing_runs_in_time_and_keys_show_what_is_hidden(tab: Tab) -> None:
    tab.press("Home")
    tab.press(" ")
    tab.wait("document.querySelector('[role=slider]').ariaValueNow > 0.1")
    tab.press(" ")
    stopped = time_of(tab)
    tab.settle()
    assert time_of(tab) == stopped
    assert tab.evaluate("document.querySelectorAll('.switch input').length") == 3  # no geom collides
    for key in "cfl":
        tab.press(key)
    assert tab.evaluate("[...document.querySelectorAll('.switch input')].every(input => input.checked)")
    theme = "document.documentElement.dataset.theme"
    before = tab.evaluate(theme)
    tab.press("t")
    assert {before, tab.evaluate(theme)} == {"light", "dark"}


@pytest.mark.slow
def test_page_is_alone_and_hostile_names_stay_text(tab: Tab, page: Path) -> None:
    assert [address.partition("#")[0] for address in tab.requests] == [page.as_uri()]
    assert not tab.problems
    assert tab.evaluate("typeof hurt") == "undefined"
    assert tab.evaluate("document.querySelectorAll('img').length") == 0
    assert tab.evaluate("document.title") == HOSTILE
    for selector in ("h1", "aside option[value='0']", ".jump span", ".legend .name", "dd"):
        assert tab.evaluate(f"document.querySelector({json.dumps(selector)}).textContent") == HOSTILE
    with pytest.raises(AssertionError):
        tab.evaluate("fetch('data:,')")  # the policy permits no request


@pytest.mark.slow
def test_small_values_have_a_scale_and_controls_end_before_the_slider(
    connection: ClientConnection, tmp_path: Path
) -> None:
    small = [ReplayPanel("", "", [ReplayCurve("a", "", np.array([-3e-12, -2e-12, 0]))])]
    page = tmp_path / "replay.html"
    times = {"times": 1000 * TIMES, "curve_times": np.array([0.0, 1000, 2000])}
    page.write_bytes(replay_page(dataclasses.replace(replay(), panels=small, **times), glb()))
    tab = Tab(connection, (800, 600))
    tab.open(f"{page.as_uri()}#t=1000")
    tab.wait("document.documentElement?.dataset.ready")
    tab.settle()
    assert tab.evaluate("document.querySelector('.value').textContent") == "−2.00e−12"
    left, _, width, _ = tab.box("[aria-label=Speed]")
    assert left + width < tab.box("[role=slider]")[0]


@pytest.mark.slow
def test_page_fits_a_phone(tab: Tab) -> None:
    tab.resize((390, 844), mobile=True)
    tab.settle()
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    _, _, width, height = tab.box(".view")
    assert width == 390
    assert height > 844 / 3
    hidden = "document.querySelector('aside').hidden"
    before = tab.evaluate(hidden)
    tab.evaluate("document.querySelector('header .actions button:last-child').click()")
    assert tab.evaluate(hidden) != before


def test_viewer_is_small_and_equal_pages_have_equal_bytes() -> None:
    content = replay_page(replay(), glb())
    assert content == replay_page(replay(), glb())
    data = sum(len(match[0]) for match in re.finditer(rb'<script id="(scene|data)".*?</script>', content))
    assert data
    assert len(content) - data < LARGEST


def test_policy_permits_the_scripts_of_the_page_alone() -> None:
    content = replay_page(replay(), glb()).decode()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', content)
    assert policy
    assert policy[1].startswith("default-src &#x27;none&#x27;; script-src &#x27;sha256-")
    assert "unsafe" not in policy[1]
    assert HOSTILE not in content


def test_the_curves_of_a_page_take_the_memory_of_their_table_however_many_they_are(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    names = [f"xpos/{model.body(body).name}/{axis}" for body in range(1, model.nbody) for axis in "xyz"]
    columns = [Column("time", "s"), *(Column(name, "m") for name in names)]
    table = np.random.default_rng(5).standard_normal((20000, len(columns)))
    context = SimpleNamespace(model=model, episode=None)
    with closing(SpooledRows(len(columns))) as stored:
        stored.extend(table)
        values = MeasuredValues(columns, range(len(table)), stored)
        scene: Any = SimpleNamespace(values=values, request=SimpleNamespace(plot=names), context=context)
        tracemalloc.start()
        panels = list(curve_panels(scene))
        kept = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
    curves = [curve for panel in panels for curve in panel.curves]
    assert [curve.name for curve in curves] == names
    assert np.array_equal(np.stack([curve.values for curve in curves], 1), table[:, 1:].astype(np.float32))
    assert kept < 1.5 * table.nbytes
