"""USD exports of simulations, read back by OpenUSD."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjrun
from mjrun.outputs.export import Export
from mjrun.outputs.exports import FORMATS, export_format


@pytest.mark.parametrize("fps", [25, 50])
def test_bodies_are_where_mujoco_puts_them_at_every_time_code(swing: Path, tmp_path: Path, fps: int) -> None:
    from pxr import Usd, UsdGeom

    Export(mjrun.Simulation(swing, duration=0.2), str(tmp_path / "a.usdc"), fps=fps).run()
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert stage.GetTimeCodesPerSecond() == fps
    model = mujoco.MjModel.from_xml_path(str(swing))
    data = mujoco.MjData(model)
    for frame in range(int(stage.GetEndTimeCode()) + 1):
        step = round(frame / fps / model.opt.timestep)
        mujoco.mj_step(model, data, nstep=step - round(data.time / model.opt.timestep))
        mujoco.mj_kinematics(model, data)
        prim = UsdGeom.Xformable(stage.GetPrimAtPath("/World/ball"))
        found = prim.ComputeLocalToWorldTransform(Usd.TimeCode(frame)).ExtractTranslation()
        assert np.abs(np.array(found) - data.body("ball").xpos).max() < 1e-9
    assert stage.GetRootLayer().customLayerData["mjrun"].startswith("{")


def test_suffixes_choose_text_binary_or_package(swing: Path, tmp_path: Path) -> None:
    starts = {".usda": b"#usda", ".usdc": b"PXR-USDC", ".usdz": b"PK\3\4", ".usd": b"PXR-USDC"}
    assert {*starts} == {*FORMATS["usd"].suffixes}
    for suffix, start in starts.items():
        path = tmp_path / f"a{suffix}"
        Export(mjrun.Simulation(swing, steps=1), str(path)).run()
        assert path.read_bytes().startswith(start)
        assert export_format(path.name) is FORMATS["usd"]
