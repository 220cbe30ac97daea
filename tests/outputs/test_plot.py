"""Plots of whole simulations, against curves of a bare loop."""

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

import mjrun.plotting.figure_writer
from mjrun.errors import BadValueError, MissingExtraError, MjrunError, UnknownNameError, UsageError
from mjrun.outputs.plot import Plot
from mjrun.plotting.figure_data import DrawnFigure
from mjrun.simulation.simulation import Simulation

SIZE = (320, 200)


@pytest.fixture
def drawings(monkeypatch: pytest.MonkeyPatch) -> list[DrawnFigure]:
    """Everything that is drawn."""
    drawn: list[DrawnFigure] = []
    encoded = mjrun.plotting.figure_writer.encoded
    monkeypatch.setattr(
        mjrun.plotting.figure_writer, "encoded", lambda drawing, *rest: drawn.append(drawing) or encoded(drawing, *rest)
    )
    return drawn


@pytest.mark.parametrize(("every", "steps"), [(1, [*range(101)]), (7, [*range(0, 101, 7), 100])])
def test_a_plot_is_the_curves_of_a_bare_loop(
    swing: Path, tmp_path: Path, drawings: list[DrawnFigure], every: int, steps: list[int]
) -> None:
    simulation = Simulation(swing, duration=0.2, qvel={"hinge": 3})
    options = {"y": ["qpos/hinge", "up [°]=qpos/hinge*180/pi"], "size": SIZE, "every": every}
    result = Plot(simulation, f"{tmp_path}/p.png", probe=["qpos[hinge]"], **options).run()  # type: ignore[arg-type]
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    data.joint("hinge").qvel = 3
    angles = []
    for _ in range(101):
        angles.append(float(data.qpos[0]))
        mujoco.mj_step(model, data)
    assert (result.samples, result.size, result.panels) == (len(steps), SIZE, ["qpos/hinge [rad]", "up [°]"])
    (radians,), (degrees,) = (panel.curves for panel in drawings[0].panels)
    assert np.array_equal(radians.points.x, np.array(steps) / 500)
    assert np.array_equal(radians.points.y, np.array(angles)[steps])
    assert np.allclose(degrees.points.y, np.degrees(angles)[steps])
    with Pillow.open(tmp_path / "p.png") as image:
        assert image.size == SIZE


@pytest.mark.parametrize("suffix", ["svg", "pdf", "jpg"])
def test_a_plot_is_written_in_every_format(swing: Path, tmp_path: Path, suffix: str) -> None:
    target = tmp_path / f"p.{suffix}"
    Plot(Simulation(swing, duration=0.1), str(target), probe=["energy", "qpos[hinge]"], size=SIZE).run()
    content = target.read_bytes()
    if suffix == "svg":
        texts = [each.text for each in ElementTree.fromstring(content).iter() if each.tag.endswith("text")]
        assert {"energy [J]", "qpos/hinge [rad]", "time [s]"} <= set(texts)
    elif suffix == "pdf":
        assert content.startswith(b"%PDF")
    else:
        with Pillow.open(target) as image:
            assert image.size == SIZE


def test_probes_are_panels_and_each_unit_has_its_own(swing: Path, tmp_path: Path) -> None:
    plot = Plot(Simulation(swing, duration=0.1), f"{tmp_path}/p.png", probe=["energy", "qpos,qvel[hinge]"])
    assert plot.run().panels == ["energy [J]", "qpos/hinge [rad]", "qpos/ball [m]", "qpos/ball", "qvel/hinge [rad/s]"]


def test_a_picture_says_what_made_it(swing: Path, tmp_path: Path) -> None:
    Plot(Simulation(swing, duration=0.1), f"{tmp_path}/p.png", probe=["energy"], command="mjrun run x.yaml").run()
    text = Pillow.open(tmp_path / "p.png").text  # type: ignore[attr-defined]
    found = {name.lower(): value for name, value in text.items()}
    assert json.loads(found["description"])["command"] == "mjrun run x.yaml"
    assert f"MuJoCo {mujoco.mj_versionString()}" in found["comment"]


@pytest.mark.parametrize(
    ("how", "kind", "message"),
    [
        ({"y": ["qpos/hnge"]}, UnknownNameError, "no column 'qpos/hnge'"),
        ({"probe": ["energy"], "size": (79, 200)}, BadValueError, "size: '79x200' is not at least 140x96 for 1 panel"),
        ({"probe": ["energy", "qpos[hinge]"], "size": (200, 119)}, BadValueError, "at least 140x152 for 2 panels"),
        ({"probe": ["enrgy"]}, UnknownNameError, "did you mean 'energy'"),
        ({"probe": ["energy"], "y": ["qpos/hinge"]}, UnknownNameError, "no column 'qpos/hinge'"),
        ({"probe": ["act"]}, UsageError, "this model has no such values"),
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


def test_without_matplotlib_nothing_is_simulated(swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mjrun.plotting.figure_writer, "LIBRARY", "no_such_library")
    plot = Plot(Simulation(swing, steps=10**9), f"{tmp_path}/p.png", probe=["energy"])
    with pytest.raises(MissingExtraError, match="plot"):
        plot.run()
