"""The ways to the numbers of a variant, each against the compiler."""

import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.model.compiler_copied_fields import CompilerCopiedFields, CopiedElementNumbers
from mjrun.model.override import Override, apply
from mjrun.model.recompilation import ChangedBodyCompiler, DerivedNumbersComputer, Recompiler
from mjrun.model.sources import parse_source
from tests.model.model_files import content
from tests.model.test_variants import ARM

SCENES = ["scene:humanoid", "scene:dominos", "scene:pendulum", "scene:car"]


def compiled(*overrides: Override) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    spec = mujoco.MjSpec.from_string(ARM)
    for override in overrides:
        apply(spec, override)
    return spec, spec.compile()


@pytest.mark.parametrize("name", [*SCENES, ""])
def test_derived_numbers_are_those_of_the_compiler(name: str) -> None:
    spec, model = parse_source(name).compile() if name else compiled()
    assert spec
    spoiled = copy.copy(model)
    for array in ("body_subtreemass", "dof_M0", "dof_invweight0", "cam_pos0", "actuator_acc0"):
        getattr(spoiled, array)[...] = 0.5
    spoiled.tendon_lengthspring[[tendon.id for tendon in spec.tendons if tendon.springlength[0] == -1]] = 7
    spoiled.stat.meansize, spoiled.stat.meanmass, spoiled.stat.meaninertia = 3, 4, 5
    spoiled.stat.extent, spoiled.stat.center = 6, (1, 2, 3)
    assert DerivedNumbersComputer(spec, model).compute(spoiled)
    assert content(spoiled) == content(model)


def test_statistics_that_the_source_specifies_stay() -> None:
    spec = mujoco.MjSpec.from_string(ARM.replace("<asset>", '<statistic extent="7" center="1 2 3"/><asset>'))
    model = spec.compile()
    changed = copy.copy(model)
    DerivedNumbersComputer(spec, model).compute(changed)
    assert content(changed) == content(model)


def test_images_are_not_compiled_again() -> None:
    spec, model = compiled()
    recompiler = Recompiler(spec, model)
    again = recompiler.model([Override("geom/thumb.mass", "0.3")])
    assert again
    assert again.ntexdata < model.ntexdata
    target = copy.copy(model)
    recompiler.write(again, target)
    assert content(target) == content(compiled(Override("geom/thumb.mass", "0.3"))[1])


@pytest.mark.parametrize(
    "override",
    [
        Override("geom/thumb.condim", "4"),  # no decimal number
        Override("texture/grid.rgb1[0]", "0.5"),  # of an image
        Override("geom/thumb.size[0]", "-1"),  # refused
        Override("body/arm.gravcomp", "1"),  # which changes the number of bodies with it
        Override("opt.tolerance", "1e-9"),
        Override("geom/none.size[0]", "1"),
    ],
)
def test_other_overrides_are_compiled_from_the_source(override: Override) -> None:
    assert Recompiler(*compiled()).model([override]) is None


def test_a_part_has_the_numbers_of_its_bodies() -> None:
    spec, model = compiled()
    recompiler = Recompiler(spec, model)
    override = Override("geom/palm.size[0]", "0.07")
    changed = ChangedBodyCompiler(recompiler.spec, model, recompiler.is_number).changed([override])
    expected = compiled(override)[1]
    assert changed
    assert {"geom_size", "body_mass", "body_inertia"} <= changed.keys()
    for array, (rows, values) in changed.items():
        np.testing.assert_array_equal(getattr(expected, array)[rows], values)


@pytest.mark.parametrize("path", ["geom/2.size[0]", "tendon/cord.stiffness[0]", "body/hand.quat", "geom/thumb.condim"])
def test_a_part_is_not_compiled_for_what_is_not_in_it(path: str) -> None:
    spec, model = compiled()
    recompiler = Recompiler(spec, model)
    compiler = ChangedBodyCompiler(recompiler.spec, model, recompiler.is_number)
    assert compiler.changed([Override(path, "0.5")]) is None


@pytest.mark.parametrize(
    ("path", "value", "arrays"),
    [
        ("body/box.pos[2]", "0.7", {"body_pos", "qpos0", "qpos_spring"}),
        ("body/arm.mass", "3", {"body_mass"}),
        ("scale:joint/*.armature", "2", {"dof_armature"}),
        ("joint/elbow.damping", "0.3", {"dof_damping"}),
        ("site/*.pos", "1,-2,3", {"site_pos"}),
        ("geom/floor.size[0]", "0.2", {"geom_size"}),
        ("scale:geom/box.size", "0.7", {"geom_size", "body_mass", "body_inertia"}),
        ("body/arm.mass", "0", None),  # refused
        ("body/world.pos", "1,2,3", None),
        ("geom/palm.size[0]", "0.2", None),  # which determines an inertia together with others
        ("geom/pad.size[0]", "0.2", None),  # whose bounds are sorted with those of others
        ("geom/ring.pos", "1,2,3", None),  # in a frame
        ("joint/shoulder.damping", "1,2", None),
        ("scale:joint/shoulder.damping", "2", None),
        ("joint/elbow.range[0]", "1", None),  # in degrees
    ],
)
def test_numbers_of_elements_are_copied(path: str, value: str, arrays: set[str] | None) -> None:
    override = Override(path, value)
    changed = CopiedElementNumbers(*compiled()).changed([override])
    assert (changed and changed.keys()) == arrays
    if changed:
        expected = compiled(override)[1]
        for array, (rows, values) in changed.items():
            np.testing.assert_array_equal(getattr(expected, array)[rows], values)


@pytest.mark.parametrize("weight", ['mass="0.7"', 'density="333"'])
@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ("sphere", 'size=".13"'),
        ("capsule", 'size=".1 .23"'),
        ("capsule", 'fromto="0 .1 .2 .3 .5 .1" size=".07"'),
        ("cylinder", 'size=".11 .31"'),
        ("ellipsoid", 'size=".1 .2 .3"'),
        ("box", 'size=".12 .2 .07"'),
    ],
)
def test_the_size_of_the_only_geom_of_a_body_determines_its_inertia(shape: str, size: str, weight: str) -> None:
    geom = f'<geom name="solid" type="{shape}" {size} {weight}/>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody><body><joint/>{geom}</body></worldbody></mujoco>")
    numbers = CopiedElementNumbers(spec, spec.compile())
    for factor in (0.3, 0.9123, 1.7, 2.345678):
        override = Override("scale:geom/solid.size", repr(factor))
        changed = numbers.changed([override])
        assert changed
        assert changed.keys() == {"geom_size", "body_mass", "body_inertia"}
        varied = spec.copy()
        apply(varied, override)
        expected = varied.compile()
        for array, (rows, values) in changed.items():
            np.testing.assert_array_equal(getattr(expected, array)[rows], values)


def test_copied_fields_keep_the_numbers_of_other_elements(tmp_path: Path) -> None:
    override = Override("geom/pad.friction[1]", "0.2")
    changed = CompilerCopiedFields(*compiled()).changed([override])
    assert changed
    ((rows, values),) = changed.values()
    assert [mujoco.mj_id2name(compiled()[1], mujoco.mjtObj.mjOBJ_GEOM, row) for row in rows] == ["pad"]
    np.testing.assert_array_equal(values, compiled(override)[1].geom_friction[rows])


def test_a_part_that_loses_static_bodies_is_compiled_whole() -> None:
    spec = mujoco.MjSpec.from_string(
        """
        <mujoco>
          <compiler fusestatic="true"/>
          <worldbody>
            <body name="base">
              <geom size=".1"/>
              <body name="arm"><joint/><geom size=".1"/><site name="tip"/></body>
            </body>
            <body><freejoint/><geom size=".1"/></body>
            <body><freejoint/><geom size=".1"/></body>
          </worldbody>
          <sensor><framepos objtype="body" objname="base"/></sensor>
        </mujoco>
        """
    )
    model = spec.compile()
    assert model.nbody == 5  # the sensor keeps the base, but a part has no sensors
    assert ChangedBodyCompiler(spec, model, lambda _: True).changed([Override("site/tip.size[0]", "0.3")]) is None
