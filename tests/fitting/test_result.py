"""Inertias of a payload from the log of an arm by a bare loop, and the schema of the report."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.document.json_schema import report_schema
from mjrun.fitting.fit import Fit
from mjrun.fitting.result import FitResult
from mjrun.model.sources.file import FileSource
from mjrun.simulation.simulation import Simulation
from tests.fitting.arm import ARM, NOMINAL, TRUTH, log
from tests.fitting.logs import write_log

MASS_AND_CENTRE = (("inertia:payload.mass", "log:0.1..5"), ("inertia:payload.center", "-0.2..0.3"))


@pytest.fixture
def arm(tmp_path: Path) -> Simulation:
    (tmp_path / "arm.xml").write_text(ARM.format(**NOMINAL))
    return Simulation(str(tmp_path / "arm.xml"))


def by_name(result: FitResult) -> dict[str, tuple[float, float, float]]:
    (inertia,) = result.inertias
    assert inertia.body == "payload"
    return {each.name: (each.low, each.value, each.high) for each in inertia.quantities}


def test_mass_and_centre_of_a_payload_are_found(tmp_path: Path, arm: Simulation) -> None:
    data = [str(write_log(tmp_path / "log.csv", log(1.0)))]
    output = tmp_path / "fitted.xml"
    result = Fit(arm, data=data, free=MASS_AND_CENTRE, starts=1, output=str(output)).run()
    found = by_name(result)
    truth = {"mass": 1.4, "center/x": 0.03, "center/y": -0.02, "center/z": 0.13}
    for name, expected in truth.items():
        low, value, high = found[name]
        assert low < value < high
        assert value == pytest.approx(expected, rel=0.02, abs=2e-3)
        assert abs(value - expected) < 2 * (high - low)
    assert found["moment/1"][1] == pytest.approx(0.0056, rel=0.02)
    model = FileSource(output).load()
    assert model.body("payload").mass[0] == result.parameters[0].value
    assert model.body("payload").ipos.tolist() == [each.value for each in result.parameters[1:]]


def test_the_shape_is_found_too_where_the_arm_turns_it(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ARM.format(**{**TRUTH, "inertia": NOMINAL["inertia"]}))
    arm = Simulation(str(tmp_path / "arm.xml"))
    inertia = 'fullinertia="0.03 0.02 0.022 0.002 0.003 -0.004"'
    data = [str(write_log(tmp_path / "log.csv", log(1.2, inertia=inertia)))]
    output = tmp_path / "fitted.xml"
    free = (("inertia:payload.shape", "0.3..6~normal(1, 3)"),)
    result = Fit(arm, data=data, free=free, starts=1, output=str(output)).run()
    truth = mujoco.MjModel.from_xml_string(ARM.format(**{**TRUTH, "inertia": inertia})).body("payload").inertia
    for (low, value, high), expected in zip([by_name(result)[f"moment/{i}"] for i in (1, 2, 3)], truth, strict=True):
        assert abs(value - expected) < high - low
        assert value == pytest.approx(expected, rel=0.3)
    np.testing.assert_allclose(
        FileSource(output).load().body("payload").inertia, [by_name(result)[f"moment/{i}"][1] for i in (1, 2, 3)]
    )


def test_every_field_of_a_report_is_described() -> None:
    properties = report_schema("fit", "mjrun fit", FitResult)["properties"]
    assert set(properties) == {*FitResult.__dataclass_fields__, "error"}
    assert all(each.get("description") or name == "schema" for name, each in properties.items())
