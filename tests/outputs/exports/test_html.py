"""HTML replays of simulations, compared in a browser with images of the same instants."""

import base64
import gzip
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import mujoco
import numpy as np
import pytest
from websockets.sync.client import ClientConnection

import mjrun
from mjrun.outputs.export import Export
from mjrun.outputs.exports import FORMATS
from tests.browser import Tab, browser
from tests.cases import mjcf

HOSTILE = "<img src=x onerror=hurt=1>"
# Red shapes that tumble in front of a camera, without floor; a cloth that falls, and a skin that two bodies bend.
SHAPES = mjcf("shapes")
# A body behind a wall that is narrower.
WALL = """<mujoco>
  <worldbody>
    <camera name="front" pos="0 -3 0" xyaxes="1 0 0 0 0 1"/>
    <geom type="box" size=".2 .05 .5"/>
    <body pos="0 1 0"><joint type="slide" axis="1 0 0"/><geom type="box" size="1.4 .1 .3"/></body>
  </worldbody>
</mujoco>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    (folder / "shapes.xml").write_text(SHAPES)
    simulation = mjrun.Simulation(folder / "shapes.xml", key="thrown", duration=1)
    Export(simulation, str(folder / "shapes.html"), stage="none", fps=20).run()
    return folder / "shapes.html"


@pytest.fixture(scope="module")
def connection(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ClientConnection]:
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


def data_of(page: Path) -> dict[str, Any]:
    """Returns the JSON of a page."""
    text = re.search(r'<script id="data"[^>]*>([^<]*)', page.read_text("utf-8"))
    assert text
    content = gzip.decompress(base64.b64decode(text[1]))
    return json.loads(content[4 : 4 + int.from_bytes(content[:4], "little")])


def silhouette(model: Path, time: float, size: tuple[int, int]) -> np.ndarray:
    """Returns where `mjrun image` sees an object."""
    output = model.with_name("silhouette.png")
    simulation = mjrun.Simulation(model, key="thrown", duration=1)
    mjrun.Image(
        simulation, str(output), time=time, camera="front", view="seg", style="exact", stage="none", size=size
    ).run()
    return np.asarray(imageio.imread(output)) > 0


@pytest.mark.slow
@pytest.mark.gl
def test_a_dragged_slider_shows_the_pose_of_an_image_of_that_instant(connection: ClientConnection, page: Path) -> None:
    tab = Tab(connection, (480, 420))
    tab.open(f"{page.as_uri()}#t=0&camera=front")
    tab.wait("document.documentElement?.dataset.ready")
    tab.evaluate("document.querySelector('aside').hidden = true")
    times = data_of(page)["times"]["length"]
    assert times == 20
    left, top, width, height = tab.box("[role=slider]")
    for frame in (0, 7, 19):
        share = frame / 19
        tab.drag((left + 0.5 * width, top + height / 2), (left + share * width, top + height / 2))
        assert float(tab.evaluate("document.querySelector('[role=slider]').ariaValueNow")) == pytest.approx(
            0.05 * frame, abs=0.002
        )
        pixels = tab.screenshot("canvas.view").astype(int)
        seen = pixels[..., 0] - pixels[..., 1] > 50
        expected = silhouette(page.with_suffix(".xml"), 0.05 * frame, (seen.shape[1], seen.shape[0]))
        assert expected.mean() > 0.03
        assert (seen & expected).sum() / (seen | expected).sum() > 0.97
    tab.press("l")
    assert tab.evaluate("document.querySelector('aside option[value=\"0\"]').textContent") == HOSTILE
    assert tab.evaluate("document.querySelectorAll('img').length") == 0
    assert [address.partition("#")[0] for address in tab.requests] == [page.as_uri()]
    assert not tab.problems


def test_curves_have_the_values_of_mujoco_at_the_frames(swing: Path, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    Export(mjrun.Simulation(swing, duration=0.5), str(page), fps=20, plot=["energy", "xpos[ball]"]).run()
    text = re.search(r'<script id="data"[^>]*>([^<]*)', page.read_text("utf-8"))
    assert text
    content = gzip.decompress(base64.b64decode(text[1]))
    found, start = data_of(page), -(-(4 + int.from_bytes(content[:4], "little")) // 8) * 8

    def array(place: dict[str, Any]) -> np.ndarray:
        return np.frombuffer(content, np.dtype(f"<{place['dtype']}"), place["length"], start + place["offset"])

    model = mujoco.MjModel.from_xml_path(str(swing))
    data, heights = mujoco.MjData(model), list[float]()
    for step in range(250):
        mujoco.mj_kinematics(model, data)
        if step % 25 == 0:
            heights.append(float(data.body("ball").xpos[2]))
        mujoco.mj_step(model, data)
    assert [panel["title"] for panel in found["panels"]] == ["energy", "xpos"]
    height = next(curve for curve in found["panels"][1]["curves"] if curve["name"] == "xpos/ball/z")
    np.testing.assert_allclose(array(height["values"]), heights, atol=1e-6)
    assert array(found["times"]) == pytest.approx([0.05 * frame for frame in range(10)])
    assert array(found["contacts"]["counts"])[-1] == data.ncon


def test_panels_may_share_columns(swing: Path, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    Export(
        mjrun.Simulation(swing, duration=0.1), str(page), plot=["energy/total", "energy", "qpos,energy/kinetic"]
    ).run()
    names = [[curve["name"] for curve in panel["curves"]] for panel in data_of(page)["panels"]]
    assert names[0] == ["energy/total"]
    assert {"energy/total", "energy/kinetic"} < set(names[1])
    assert names[2][-1] == "energy/kinetic"


@pytest.mark.slow
def test_a_wall_hides_what_is_behind_it_from_a_tap(connection: ClientConnection, tmp_path: Path) -> None:
    model, page = tmp_path / "wall.xml", tmp_path / "wall.html"
    model.write_text(WALL)
    Export(mjrun.Simulation(model, duration=0.1), str(page)).run()
    tab = Tab(connection, (600, 420))
    tab.open(f"{page.as_uri()}#t=0&camera=front")
    tab.wait("document.documentElement?.dataset.ready")
    tab.evaluate("document.querySelector('aside').hidden = true")
    labels = "document.querySelector('canvas.labels')"
    is_named = f"{labels}.getContext('2d').getImageData(0, 0, {labels}.width, {labels}.height).data.some(Boolean)"
    left, top, width, height = tab.box("canvas.view")
    for x, expected in ((left + 3 / 8 * width, True), (left + width / 2, False)):
        tab.drag((x, top + height / 2), (x, top + height / 2))
        assert tab.evaluate(is_named) == expected


def test_contacts_and_names_of_bodies_are_switches_of_the_page(swing: Path, tmp_path: Path) -> None:
    page, plain = tmp_path / "a.html", tmp_path / "b.html"
    simulation = mjrun.Simulation(swing, duration=0.5)
    Export(simulation, str(page), show=["contactforce", "contactpoint"], label="body").run()
    Export(simulation, str(plain)).run()
    assert sorted(data_of(page)["layers"]) == ["contactforce", "contactpoint", "labels"]
    assert data_of(plain)["layers"] == []
    scenes = [re.search(r'<script id="scene"[^<]*', path.read_text("utf-8")) for path in (page, plain)]
    assert scenes[0]
    assert scenes[1]
    assert scenes[0][0] == scenes[1][0]


def test_events_and_assertions_are_marks_and_failures_exit(swing: Path, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    job = Export(
        mjrun.Simulation(swing, duration=0.5),
        str(page),
        mark_event=["landed=contact(ball, floor) > 0"],
        assert_=["xpos/ball/z < 1"],
    )
    result = job.run()
    assert [verdict.passed for verdict in result.assertions] == [True]
    marks = data_of(page)["marks"]
    assert [(mark["kind"], mark["text"]) for mark in marks[:1]] == [("event", "landed")]
    assert marks[-1] == {"time": None, "kind": "pass", "text": "xpos/ball/z < 1"}


def test_the_format_has_no_cameras_of_its_own() -> None:
    assert FORMATS["html"].suffixes == (".html", ".htm")
    assert FORMATS["html"].write == "mjrun.outputs.exports.html:write_page"
    assert not FORMATS["html"].cameras
