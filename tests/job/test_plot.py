"""Plots of whole simulations, against curves of a bare loop."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.errors import BadValueError, MjrunError, UnknownNameError, UsageError
from mjrun.job.plot import LETTERS, SMALLEST_LETTERS, Plot
from mjrun.job.simulation import Simulation
from mjrun.rendering.graph import Graph

SIZE = (320, 200)


@pytest.mark.parametrize(("every", "steps"), [(1, [*range(101)]), (7, [*range(0, 101, 7), 100])])
def test_a_plot_is_the_graph_of_a_bare_loop(swing: Path, tmp_path: Path, every: int, steps: list[int]) -> None:
    simulation = Simulation(swing, duration=0.2, qvel={"hinge": 3})
    result = Plot(simulation, f"{tmp_path}/p.png", probe=["qpos[hinge]"], size=SIZE, every=every).run()
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    data.joint("hinge").qvel = 3
    angles = []
    for _ in range(101):
        angles.append([data.qpos[0]])
        mujoco.mj_step(model, data)
    times = np.array(steps) / 500
    letters = max(SMALLEST_LETTERS, LETTERS * min(SIZE))
    graph = Graph(times, np.array(angles)[steps], ["qpos/hinge"], ["rad"], SIZE, letters)
    assert (result.samples, result.size) == (len(steps), SIZE)
    assert np.array_equal(np.array(Pillow.open(tmp_path / "p.png")), graph.draw(float(times[-1])))


def test_graphs_of_a_plot_share_its_height(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1)
    Plot(simulation, f"{tmp_path}/p.png", probe=["energy", "qpos[hinge]", "qvel"], size=(300, 251)).run()
    pixels = np.array(Pillow.open(tmp_path / "p.png"))
    assert pixels.shape == (251, 300, 3)
    assert all(len(np.unique(part.reshape(-1, 3), axis=0)) > 10 for part in np.array_split(pixels, 3))


def test_a_picture_says_what_made_it(swing: Path, tmp_path: Path) -> None:
    Plot(Simulation(swing, duration=0.1), f"{tmp_path}/p.png", probe=["energy"], command="mjrun run x.yaml").run()
    text = Pillow.open(tmp_path / "p.png").text  # type: ignore[attr-defined]
    found = {name.lower(): value for name, value in text.items()}
    assert json.loads(found["description"])["command"] == "mjrun run x.yaml"
    assert f"MuJoCo {mujoco.mj_versionString()}" in found["comment"]


@pytest.mark.parametrize(
    ("how", "kind", "message"),
    [
        ({"probe": []}, UsageError, "probe: a plot needs values"),
        ({"probe": ["energy"], "size": (79, 200)}, BadValueError, "size: '79x200' is not at least 80x60 for 1"),
        ({"probe": ["energy", "qpos"], "size": (200, 119)}, BadValueError, "at least 80x120 for 2 panels"),
        ({"probe": ["enrgy"]}, UnknownNameError, "did you mean 'energy'"),
        ({"probe": ["act"]}, UsageError, "this model has none of it"),
        ({"probe": ["energy"], "output": "p.npy"}, MjrunError, "npy"),
    ],
)
def test_a_plot_that_cannot_be_is_refused(
    swing: Path, tmp_path: Path, how: dict[str, object], kind: type, message: str
) -> None:
    output = str(how.pop("output", "p.png"))
    with pytest.raises(kind, match=message):
        Plot(Simulation(swing, steps=1), f"{tmp_path}/{output}", **how).run()  # type: ignore[arg-type]
    assert [*tmp_path.iterdir()] == [swing]
