"""Facts of manifests, against hashlib and the values themselves."""

import hashlib
import json
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from mjrun.formats.table_reader import open_table
from mjrun.outputs.trace import Trace
from mjrun.simulation.origin import origin, plain
from mjrun.simulation.simulation import Simulation

TEXT = """
<mujoco>
  <worldbody><body name="bob"><joint name="h" axis="0 1 0"/><geom size=".05" pos=".3 0 2"/></body></worldbody>
  <actuator><motor name="m" joint="h"/></actuator>
</mujoco>
"""
MODEL = mujoco.MjModel.from_xml_string(TEXT)


def test_the_manifest_says_what_made_the_tables(tmp_path: Path) -> None:
    table, contacts, manifest = (tmp_path / name for name in ("t.parquet", "c.npz", "m.json"))
    simulation = Simulation(MODEL, duration=0.1, seed=7, ctrl={"m": 2})
    job = Trace(simulation, str(table), contacts=str(contacts), manifest=str(manifest), command="mjrun trace x")
    result = job.run()
    outcome = json.loads(manifest.read_text())
    assert (outcome["mujoco"], outcome["command"], outcome["seed"]) == (mujoco.mj_versionString(), "mjrun trace x", 7)
    assert (outcome["steps"], outcome["timestep"]) == (50, 0.002)
    assert outcome["options"]["simulation"]["ctrl"] == {"m": [2.0]}
    assert outcome["result"]["rows"] == result.rows == 51
    for output, path in zip(outcome["outputs"], (table, contacts), strict=True):
        content = path.read_bytes()
        assert (output["path"], output["bytes"]) == (str(path), len(content))
        assert output["sha256"] == hashlib.sha256(content).hexdigest()
    heavier = mujoco.MjModel.from_xml_string(TEXT.replace('size=".05"', 'size=".06"'))
    Trace(Simulation(heavier, duration=0.1), str(table), manifest=str(manifest)).run()
    assert json.loads(manifest.read_text())["model"]["sha256"] != outcome["model"]["sha256"]


def test_tables_that_are_read_are_in_the_manifest_with_their_hashes(tmp_path: Path) -> None:
    table, names = tmp_path / "log.csv", tmp_path / "names.map"
    table.write_text("t,deg\n0,0\n0.01,90\n")
    names.write_text("time=t\nqpos/h=deg*pi/180\n")
    simulation = Simulation(MODEL, replay=table, map=names)
    Trace(simulation, f"{tmp_path}/t.h5", manifest=f"{tmp_path}/m.json").run()
    result = json.loads((tmp_path / "m.json").read_text())["inputs"]
    assert [(entry["path"], entry["sha256"]) for entry in result] == [
        (str(path), hashlib.sha256(path.read_bytes()).hexdigest()) for path in (table, names)
    ]
    with open_table(tmp_path / "t.h5") as made:
        assert made.manifest is not None
        assert made.manifest["inputs"] == result


def test_the_fingerprint_of_a_model_is_that_of_its_content_wherever_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(simulation: Simulation) -> str:
        model = simulation.load()
        facts = origin(Trace(simulation, "t.csv"), simulation, model, simulation.timeline(model))
        return facts["model"]["sha256"]

    assets = '<asset><texture name="t" type="2d" file="t.png"/></asset>'
    for folder in ("robot", "edited"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "m.xml").write_text(TEXT.replace("<worldbody>", f"{assets}<worldbody>"))
        Image.new("RGB", (8, 8), "red" if folder == "robot" else "blue").save(tmp_path / folder / "t.png")
    monkeypatch.chdir(tmp_path / "robot")
    relative = Simulation("m.xml", duration=0.1)
    absolute = Simulation(tmp_path / "robot" / "m.xml", duration=0.1)
    assert made(relative) == made(absolute) == made(relative.with_snapshot())
    assert made(Simulation(tmp_path / "edited" / "m.xml", duration=0.1)) != made(relative)


def test_the_origin_of_an_output_is_plain_values() -> None:
    simulation = Simulation(MODEL, duration=0.1)
    job = Trace(simulation, "t.csv", command="mjrun trace x -o t.csv")
    facts = origin(job, simulation, MODEL, simulation.timeline(MODEL))
    assert (facts["command"], facts["steps"], facts["numpy"]) == ("mjrun trace x -o t.csv", 50, np.__version__)
    assert "command" not in facts["options"]
    assert json.loads(json.dumps(facts)) == facts


@dataclass(frozen=True)
class Point:
    """A value with fields."""

    x: Fraction
    y: np.ndarray


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (Point(Fraction(1, 4), np.arange(3)), {"x": 0.25, "y": [0, 1, 2]}),
        ({"a": (1, True, None), 2: "b"}, {"a": [1, True, None], "2": "b"}),
        (np.float64(0.5), 0.5),
        (MODEL, "a compiled model"),
        (json.dumps, "dumps"),
        (Path("a/b"), "a/b"),
    ],
)
def test_values_are_plain_in_a_manifest(value: object, expected: object) -> None:
    result = plain(value)
    assert json.loads(json.dumps(result)) == expected
