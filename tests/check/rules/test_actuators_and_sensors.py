"""Theorems about servos, forces that add energy, and the targets of actuators and sensors."""

import mujoco
import numpy as np
import pytest

from tests.check.models import lint, mjcf

STEP, INERTIA = 0.01, 0.5
# The largest stable h² kp / M and h kv / M of Euler, and of implicit integrators for kp.
MODEL = """<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/><worldbody>
<body name="b"><joint name="j" type="slide" range="-1 2" {joint}/><geom size=".1" mass="{inertia}"/></body>
</worldbody><actuator>{actuator}</actuator></mujoco>"""
SENSORS = [
    *(f'<{kind} site="s"/>' for kind in ("gyro", "accelerometer", "velocimeter")),
    *(f'<frame{kind} objtype="site" objname="s"/>' for kind in ("linvel", "angvel", "linacc", "angacc")),
    *('<gyro site="leg"/>', '<jointvel joint="j"/>', '<framelinvel objtype="body" objname="leg"/>'),
    *(f'<framelinvel objtype="site" objname="s" reftype="site" refname="{name}"/>' for name in ("leg", "still")),
]


def model(actuator: str, integrator: str = "Euler", joint: str = "") -> str:
    return MODEL.format(step=STEP, inertia=INERTIA, integrator=integrator, joint=joint, actuator=actuator)


def servo(kp: float = 0, kv: float = 0, gear: float = 1) -> str:
    return f'<general name="a" joint="j" gear="{gear}" gainprm="{kp}" biastype="affine" biasprm="0 {-kp} {-kv}"/>'


def found(code: str, text: str) -> list[tuple[str, str]]:
    return [(finding.object, finding.severity) for finding in lint(text) if finding.code == code]


def diverges(text: str) -> bool:
    """Whether a small velocity grows in a simulation without limits of the joint."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    data = mujoco.MjData(model)
    data.qvel[0] = 1e-9
    for _ in range(200):
        mujoco.mj_step(model, data)
    return not abs(data.qvel[0]) < 1e-8


@pytest.mark.parametrize("gear", [1, 3])
@pytest.mark.parametrize(("factor", "reported"), [(0.98, False), (1.02, True)])
def test_a_servo_may_turn_its_phase_by_one_in_a_timestep(gear: float, factor: float, reported: bool) -> None:
    kp = factor * INERTIA / (STEP * gear) ** 2
    text = model(servo(kp, gear=gear))
    assert found("MJ307", text) == [("actuator 'a'", "warning")] * reported
    assert found("MJ307", text.replace("Euler", "discrete")) == []
    assert diverges(model(servo(4.1 * kp / factor, gear=gear)))
    assert not diverges(model(servo(3.9 * kp / factor, gear=gear)))


@pytest.mark.parametrize(("integrator", "limit"), [("Euler", 2), ("RK4", 2.785)])
def test_damping_is_reported_where_it_diverges(integrator: str, limit: float) -> None:
    for factor in (0.99, 1.01):
        text = model(servo(kv=factor * limit * INERTIA / STEP), integrator)
        assert bool(found("MJ307", text)) == diverges(text) == (factor > 1)
        assert found("MJ307", text.replace(integrator, "implicitfast")) == []


@pytest.mark.parametrize("damping", ["joint", "servo"])
def test_implicit_damping_allows_more_stiffness(damping: str) -> None:
    """Where x' = x + h v' and (1 + d) v' = v − φ² x / h, the simulation is stable while φ² < 4 + 2 d."""
    decay, unit = 6.0, INERTIA / STEP**2
    joint = f'damping="{decay * INERTIA / STEP}"' if damping == "joint" else ""
    integrator = "Euler" if damping == "joint" else "implicitfast"
    kv = 0 if damping == "joint" else decay * INERTIA / STEP
    for share in (0.95, 1.05):
        assert diverges(model(servo(share * (4 + 2 * decay) * unit, kv), integrator, joint)) == (share > 1)
        assert bool(found("MJ307", model(servo(share * (1 + decay / 2) * unit, kv), integrator, joint))) == (share > 1)


@pytest.mark.parametrize(
    ("low", "high", "severity"),
    [(-1, 2, ""), (-1.29, 2, ""), (-1.31, 2, "note"), (-1, 2.31, "note"), (-1, 17.1, "warning"), (0, 0.1, "")],
)
@pytest.mark.parametrize(("gear", "gain"), [(1, 1), (-2, 1), (1, 3)])
def test_a_servo_may_exceed_its_joint_by_a_tenth(
    low: float, high: float, severity: str, gear: float, gain: float
) -> None:
    controls = np.sort(np.array([low, high]) * gear / gain)
    attributes = f'ctrlrange="{controls[0]} {controls[1]}" gainprm="{50 * gain}" biastype="affine" biasprm="0 -50 -1"'
    text = model(f'<general name="a" joint="j" gear="{gear}" {attributes}/>')
    (finding, *others) = [f for f in lint(text) if f.code == "MJ306"] or [None]
    assert (finding.severity if finding else "", others) == (severity, [])
    if finding:  # the range that it suggests is that of the joint
        start, end = sorted(np.array([-1, 2]) * gear / gain)
        assert f'ctrlrange="{start:.4g} {end:.4g}"' in finding.remedy


def test_only_servos_with_ranges_have_positions() -> None:
    for actuator in ('<motor joint="j" ctrlrange="-9 9"/>', '<velocity joint="j" kv="1" ctrlrange="-9 9"/>'):
        assert found("MJ306", model(actuator)) == []
    assert found("MJ306", model('<position joint="j" kp="9" ctrlrange="-9 9"/>', joint='limited="false"')) == []


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    "gains", ['joint stiffness="{}"', 'joint damping="{}"', "actuator 0 {} 0", "actuator 0 0 {}"], ids=str.split
)
def test_forces_that_add_energy_let_a_small_velocity_grow(gains: str, sign: int) -> None:
    kind, values = gains.split(" ", 1)
    bias = f'<general name="a" joint="j" biastype="affine" biasprm="{values.format(-9 * sign)}"/>'
    text = model(bias) if kind == "actuator" else model("", joint=values.format(9 * sign))
    assert bool(found("MJ312", text)) == diverges(text) == (sign < 0)


@pytest.mark.parametrize("joint", ["", '<joint axis="1 1 1"/>', "<freejoint/>"])
@pytest.mark.parametrize("sensor", SENSORS)
def test_sensors_of_motion_are_reported_where_they_never_change(sensor: str, joint: str) -> None:
    leg = '<joint name="j" axis="0 1 0"/><geom size=".1" pos=".1 0 0"/><site name="leg"/>'
    own = '<geom size=".1" pos=".2 .1 0"/><site name="s"/><site name="still" pos=".1 0 0"/>'
    base = f'{joint}{own}<body name="leg" pos=".3 0 0">{leg}</body>'
    text = mjcf(f'<geom type="plane" size="1 1 1"/><body pos="0 0 9">{base}</body>', f"<sensor>{sensor}</sensor>")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    values = set()
    for _ in range(20):
        mujoco.mj_step(model, data)
        values.add(tuple(data.sensordata))
    assert bool([f for f in lint(text) if f.code == "MJ311"]) == (len(values) == 1)
