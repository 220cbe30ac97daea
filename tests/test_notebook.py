"""The notebook of the tutorial, executed in a kernel at a small size: every cell shows what its tag promises."""

import base64
import json
import re
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

import mjrun
from tests.documentation import ROOT, plain_scenes

sys.path.append(str(ROOT))

from scripts import make_docs

CELLS = json.loads(make_docs.NOTEBOOK.read_text("utf-8"))["cells"]
SMALLER = {
    "size, fps = (480, 360), 30": "size, fps = (64, 48), 1",
    "wide = (800, 480)": "wide = (400, 240)",
    "size=(900, 700)": "size=(450, 350)",
    "episodes=5": "episodes=2, jobs=1",
    "perturb=1e-7, duration=10": "perturb=1e-7, duration=2",
    "9}, duration=10": "9}, duration=1",
    "duration=2, rate=100": "duration=0.5, rate=100",
    "duration=1.5, set=arrows": "duration=0.5, set=arrows",
    "duration=1, probe=probes": "duration=0.3, probe=probes",
    # The camera looks for the throw at every step; with longer ones it takes place too.
    r"dominos.xml\", duration=3": r"dominos.xml\", duration=3, timestep=0.002",
}
COPY = "!mjrun examples scenes"


def embedded(kind: str, shown: str) -> bytes:
    """Returns a file of a kind of media within an output."""
    content = re.search(f'src="data:{kind};base64,([^"]+)"', shown)
    assert content
    return base64.b64decode(content[1])


def check_image(data: dict[str, str]) -> None:
    content = base64.b64decode(data["image/png"]) if "image/png" in data else embedded("image/png", data["text/html"])
    assert np.ptp(iio.imread(content, extension=".png")) > 0


def check_video(data: dict[str, str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "v.mp4")
        file.write_bytes(embedded("video/mp4", data["text/html"]))
        frames = np.stack(list(mjrun.read_video(file)))
    assert np.ptp(frames, axis=0).max() > 0  # it moves


def check_table(data: dict[str, str]) -> None:
    rows = ElementTree.fromstring(f"<div>{data['text/html'].replace('<br/>', ' ')}</div>").findall(".//tr")
    assert len(rows) > 1
    assert len({len(row) for row in rows}) == 1


def check_figure(data: dict[str, str]) -> None:
    if "image/svg+xml" in data:
        assert ElementTree.fromstring(data["image/svg+xml"]).get("width")
    else:
        check_image(data)


def check_text(data: dict[str, str]) -> None:
    assert data.keys() == {"text/plain"}


SHOWN: dict[str, Callable[[dict[str, str]], None]] = {
    "figure": check_figure,
    "image": check_image,
    "table": check_table,
    "text": check_text,
    "video": check_video,
}


def data_of(cell: dict[str, Any]) -> Iterator[dict[str, str]]:
    """Yields what a cell shows, by its types, except for warnings."""
    for output in cell["outputs"]:
        if output["output_type"] == "stream":
            if output["name"] == "stdout":
                yield {"text/plain": output["text"]}
        elif output["data"].get("text/html") != "":  # a bar that has ended
            yield output["data"]


def test_the_notebook_is_stored_without_outputs_and_says_what_cells_show() -> None:
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in CELLS)
    tags = [cell["metadata"].get("tags") for cell in CELLS if cell["cell_type"] == "code"]
    assert tags[0] == ["parameters"]
    assert {tag for (tag,) in tags[1:]} == SHOWN.keys()


@pytest.mark.gl
@pytest.mark.slow
def test_every_cell_of_the_notebook_shows_what_it_promises(tmp_path: Path) -> None:
    plain = plain_scenes(tmp_path / "plain")
    cells = make_docs.executed_notebook(tmp_path, {**SMALLER, COPY: f"{COPY} && cp -r {plain} ."})
    for cell in cells:
        if cell["cell_type"] == "code":
            (tag,) = cell["metadata"]["tags"]
            *_, last = data_of(cell)
            assert "<progress" not in str(list(data_of(cell))), cell["source"]
            SHOWN.get(tag, check_text)(last)

    page = make_docs.notebook_page(cells, tmp_path / "media")
    media = {path.suffix: path for path in (tmp_path / "media").iterdir()}
    assert media.keys() == {".mp4", ".png", ".svg"}
    assert "data:" not in page
    assert page.count("<video") == sum(cell["metadata"].get("tags") == ["video"] for cell in cells)
