"""Theorems about constraints at the start."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun.check.context import CheckContext
from mjrun.check.rules import contacts, simulation
from mjrun.model.xml_source import read_xml
from tests.cases import cases
from tests.check.models import hinged, lint, mjcf


def apart(gap: float) -> str:
    """Two spheres of radius 0.1 m, `gap` [m] apart, the first of which can move."""
    return hinged(
        'type="slide" axis="1 0 0"', world=f'<geom name="h" size=".1" pos="{0.2 + gap} 0 0"/>', before="<option/>"
    )


def stiff(solref: str, option: str = 'timestep=".002"') -> str:
    return hinged(geom=f'size=".1" solref="{solref}"', before=f"<option {option}/>")


def steps_until_it_diverges(solref: tuple[float, float], step: float) -> bool:
    """Whether a unit mass on the direct spring of `solref` gains amplitude under semi-implicit Euler steps."""
    position, velocity = 1.0, 0.0
    for _ in range(2000):
        velocity += step * (solref[0] * position + solref[1] * velocity)
        position += step * velocity
        if abs(position) > 1e6:
            return True
    return False


@given(stiffness=st.floats(1, 1e6), damping=st.floats(0, 1e3), step=st.floats(1e-4, 1e-2))
def test_a_direct_spring_is_stiff_exactly_when_its_steps_diverge(stiffness: float, damping: float, step: float) -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    model.opt.timestep = step
    margin = 2 * step * damping + step**2 * stiffness
    spring = simulation.ConstraintSpring("geom", 0, "solref", (-stiffness, -damping))
    if abs(margin / 4 - 1) > 0.05:
        is_stiff = bool(simulation.stiffness_problem(model, spring))
        assert is_stiff == steps_until_it_diverges(spring.solref, step)


@cases("solref, option, stiff_for_it")
def test_how_stiff_a_contact_may_be_depends_on_the_integrator_and_the_format(
    solref: str, option: str, stiff_for_it: bool
) -> None:
    assert ("MJ503" in {f.code for f in lint(stiff(solref, option))}) == stiff_for_it


def test_disabled_contacts_are_never_too_stiff() -> None:
    text = stiff(".001 1").replace("/>", '><flag contact="disable"/></option>', 1)
    assert lint(text) == []


def test_without_refsafe_a_stiff_contact_may_be_unstable() -> None:
    text = stiff(".001 1").replace("/>", '><flag refsafe="disable"/></option>', 1)
    assert [f.message.rpartition(": ")[2] for f in lint(text)] == ["it may become unstable"]


@given(st.floats(0.02, 0.19))
def test_the_depth_of_two_spheres_is_that_of_geometry(depth: float) -> None:
    path = Path("deep.xml")
    path.write_text(apart(-depth))
    context = CheckContext.load(path, read_xml(path))
    ((deepest, share),) = contacts.penetration_depths(context, None).values()
    np.testing.assert_allclose([deepest, share], [depth, depth / 0.1], rtol=1e-6)


@pytest.mark.parametrize(
    ("other", "depth", "reported"),
    [("moving", 0.0019, False), ("moving", 0.0021, True), ("static", 0.0099, False), ("static", 0.0101, True)],
)
def test_a_penetration_is_reported_from_2_mm_on_or_10_mm_against_a_static_geom(
    other: str, depth: float, reported: bool
) -> None:
    """The spheres are small, so that both depths are large shares of their sizes."""
    joint = '<joint name="k" type="slide"/>' if other == "moving" else ""
    sphere = '<geom size=".015" mass="1"/>'
    text = mjcf(
        f'<body name="b"><joint name="j" type="slide"/>{sphere}</body>'
        f'<body name="c" pos="{0.03 - depth} 0 0">{joint}{sphere}</body>'
    )
    penetrations = [f for f in lint(text) if f.code == "MJ501"]
    assert len(penetrations) == reported
    excluded = ('<exclude body1="c" body2="b"/>', '<exclude body1="b" body2="c"/>')
    assert all(any(exclude in f.remedy for exclude in excluded) == bool(joint) for f in penetrations)
    assert all(f.object.endswith(("geom 0 of body 'b'", "geom 1 of body 'c'")) for f in penetrations)


@pytest.mark.parametrize(
    ("text", "cause"),
    [(apart(-0.15), "MJ501"), (hinged('type="slide" axis="1 0 0" range="2 3"', before="<option/>"), "MJ304")],
)
def test_a_cause_with_a_rule_of_its_own_is_not_reported_as_violent_forces(text: str, cause: str) -> None:
    path = Path("violent.xml")
    path.write_text(text)
    context = CheckContext.load(path, read_xml(path))
    assert simulation.constraint_accelerations(context.model, context.data_at(None)).max() > 20 * 9.81
    assert [f.code for f in lint(text)] == [cause]


def test_bodies_are_thrown_as_a_bare_step_throws_them() -> None:
    path = Path("thrown.xml")
    path.write_text(apart(-0.15).replace("<option/>", '<option gravity="0 0 0" timestep="1e-5"/>'))
    context = CheckContext.load(path, read_xml(path))
    data = mujoco.MjData(context.model)
    mujoco.mj_step(context.model, data)
    thrown = simulation.constraint_accelerations(context.model, context.data_at(None))
    np.testing.assert_allclose(thrown[1], abs(data.qvel[0]) / 1e-5, rtol=1e-6)


def test_a_keyframe_is_a_start_too() -> None:
    text = apart(0.5).replace("<worldbody>", '<keyframe>\n<key name="in" qpos="0.6"/></keyframe><worldbody>')
    (inside,) = [f for f in lint(text) if f.code == "MJ501"]
    assert inside.message.startswith("in keyframe 'in' it penetrates geom 'h' by 0.1 m, 100 %")
    assert inside.line == 4
    assert inside.remedy == "move one of them in the keyframe"  # and not without all contacts with the world
