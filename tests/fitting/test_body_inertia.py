"""Inertias that are physical whatever the numbers are."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import BadValueError, UnknownNameError, UsageError
from mjrun.fitting.free_parameter import free_parameters, overrides, require_effect
from mjrun.model.source import ModelSource
from mjrun.model.sources import parse_source
from tests.fitting.arm import ARM, NOMINAL

TEN = (
    ("inertia:payload.mass", "log:0.05..5"),
    ("inertia:payload.center", "-0.3..0.3"),
    ("inertia:payload.shape", "0.2..4"),
)
FULL = 'fullinertia="0.003 0.0025 0.0016 0.0001 -0.0002 0.0003"'
TURNED = 'diaginertia="0.0028 0.0022 0.0014" quat="0.9 0.1 -0.3 0.2"'


def source(folder: Path, inertia: str = NOMINAL["inertia"]) -> ModelSource:
    (folder / "arm.xml").write_text(ARM.format(**{**NOMINAL, "inertia": inertia}))
    return parse_source(str(folder / "arm.xml"))


def compiled(arm: ModelSource, made: list) -> mujoco.MjModel:
    return replace(arm, overrides=tuple(made)).load()


def matrix(model: mujoco.MjModel) -> np.ndarray:
    """The inertia of the payload about its centre, in its frame."""
    axes = np.zeros(9)
    body = model.body("payload")
    mujoco.mju_quat2Mat(axes, body.iquat)
    return axes.reshape(3, 3) @ np.diag(body.inertia) @ axes.reshape(3, 3).T


@pytest.fixture(scope="module", params=[NOMINAL["inertia"], FULL, TURNED])
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ModelSource:
    return source(tmp_path_factory.mktemp("arm"), request.param)


def test_starts_are_what_the_model_has(arm: ModelSource) -> None:
    parameters = free_parameters(TEN, arm, [])
    assert len(parameters) == 10
    model = compiled(arm, overrides(parameters, [each.start for each in parameters]))
    body, before = model.body("payload"), arm.load()
    assert body.mass[0] == before.body("payload").mass[0]
    np.testing.assert_array_equal(body.ipos, before.body("payload").ipos)
    np.testing.assert_allclose(matrix(model), matrix(before), atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=10, max_size=10))
def test_whatever_is_within_bounds_compiles_and_is_physical(arm: ModelSource, coordinates: list[float]) -> None:
    parameters = free_parameters(TEN, arm, [])
    values = [each.value(c) for each, c in zip(parameters, coordinates, strict=True)]
    model = compiled(arm, overrides(parameters, values))
    moments = np.sort(model.body("payload").inertia)
    assert 0 < moments[2] < moments[0] + moments[1]
    (inertia,) = {each.inertia for each in parameters}
    assert inertia is not None
    expected = inertia.principal_moments({p.name: v for p, v in zip(parameters, values, strict=True)})
    np.testing.assert_allclose(moments[::-1], expected, rtol=1e-9)


def test_corners_compile_too(arm: ModelSource) -> None:
    parameters = free_parameters(TEN, arm, [])
    for corner in product((0.0, 1.0), repeat=3):
        coordinates = [corner[0], *[corner[1]] * 3, *[corner[2]] * 6]
        compiled(arm, overrides(parameters, [p.value(c) for p, c in zip(parameters, coordinates, strict=True)]))


def test_moments_grow_with_a_mass_whose_shape_stays(arm: ModelSource) -> None:
    (mass,) = free_parameters(TEN[:1], arm, [])
    model, before = compiled(arm, overrides([mass], [2.1])), arm.load()
    assert model.body("payload").mass[0] == 2.1
    np.testing.assert_allclose(matrix(model), 3 * matrix(before), rtol=1e-12)


def test_a_stretch_in_one_direction_moves_the_mass_there(tmp_path: Path) -> None:
    """Second moments along x become fourfold, the others stay: I_y and I_z grow by three of them."""
    arm = source(tmp_path)
    (stretch,) = free_parameters([("inertia:payload.shape[0]", "0.2..4")], arm, [])
    model, before = compiled(arm, overrides([stretch], [2.0])), arm.load()
    second = 0.0014 / 2
    np.testing.assert_allclose(matrix(model) - matrix(before), np.diag([0, 3, 3]) * second, atol=1e-15)


def test_a_rod_of_no_thickness_can_be_free(tmp_path: Path) -> None:
    arm = source(tmp_path, 'diaginertia="0.003 0.003 0.0000000001"')
    parameters = free_parameters(TEN, arm, [])
    compiled(arm, overrides(parameters, [each.value(0.3) for each in parameters]))


def test_one_number_of_a_centre_can_be_free_and_all_have_a_prior(tmp_path: Path) -> None:
    arm = source(tmp_path)
    (one,) = free_parameters([("inertia:payload.center[2]", "0..0.3")], arm, [])
    assert (one.path, one.start, one.override_path) == ("inertia:payload.center[2]", 0.1, "body/payload.ipos[2]")
    require_effect(one, arm)
    shape = free_parameters([("inertia:payload.shape", "0.5..2~normal(1, 0.1)")], arm, [])
    assert [each.prior for each in shape] == [(1, 0.1)] * 3 + [(0, 0.1)] * 3
    assert [(each.low, each.high) for each in shape] == [(0.5, 2)] * 3 + [(-0.75, 0.75)] * 3
    assert {each.override_path for each in shape} == {None}


@pytest.mark.parametrize(
    ("path", "text", "error", "message"),
    [
        ("inertia:payload.weight", "0..1", BadValueError, "BODY.mass, .center or .shape"),
        ("inertia:payload.center[3]", "0..1", BadValueError, "BODY.mass, .center or .shape"),
        ("inertia:payload.mass", "0..1", BadValueError, "above 0"),
        ("inertia:payloat.mass", "0.1..1", UnknownNameError, "did you mean 'payload'"),
        ("inertia:wrist.mass", "0.1..1", UsageError, "comes from its geoms"),
        ("inertia:*.mass", "0.1..1", UsageError, "give one body at a time"),
    ],
)
def test_what_cannot_be_free_is_refused(
    tmp_path: Path, path: str, text: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        free_parameters([(path, text)], source(tmp_path), [])


def test_a_number_is_free_once(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="twice"):
        free_parameters([*TEN, ("inertia:payload.center[1]", "0..1")], source(tmp_path), [])
