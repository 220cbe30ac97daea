"""A variant of a model is, byte for byte, the model that compiling the source with its overrides gives."""

import copy
import gc
import re
import tracemalloc
from functools import cache
from pathlib import Path
from weakref import ReferenceType, ref

import mujoco
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjrun.errors import MjrunError, UnknownNameError
from mjrun.model import variants
from mjrun.model.override import Override
from mjrun.model.sources import parse_source
from mjrun.model.sources.file import FileSource
from mjrun.model.variants import ModelVariant, SharedCompilation, VariantLoader
from tests.cases import cases, mjcf
from tests.model.model_files import content

MODEL = """<mujoco><option timestep="0.003"/><default><geom friction=".9 .01 .001"/></default>
<worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="arm"><joint name="knee"/><geom size=".1"/><geom name="tip" size=".1" pos="1 0 0" solref=".01 1"/></body>
<body name="leg" pos="0 1 0"><joint name="hip"/><geom name="toe" size=".1"/></body></worldbody>
<actuator><position name="plain" joint="knee" kp="20" kv="1"/><position name="damped" joint="hip" kp="9" dampratio="1"/>
<motor name="motor" joint="hip" gear="3"/></actuator>EXTRA</mujoco>"""
MODELS = Path(__file__).resolve().parents[2] / "../shared/models"
PATHS = ["opt.timestep", "scale:opt.timestep", "opt.gravity[2]", "opt.wind[0]", "opt.impratio", "opt.density"]
PATHS += [
    "geom/floor.friction",
    "geom/*.friction[0]",
    "scale:geom/*.friction",
    "geom/geom:1.solref[0]",
    "geom/t*.solimp[1]",
]
PATHS += ["scale:actuator/plain.gainprm[0]", "actuator/*.gainprm[0]"]
PATHS += ["actuator/plain.biasprm[1]", "add:actuator/plain.biasprm[1]", "actuator/motor.gainprm[0]"]
COMPILED = ["actuator/plain.biasprm[2]", "actuator/plain.biasprm", "add:opt.timestep", "add:geom/tip.friction[0]"]
COMPILED += [
    "geom/tip.margin",
    "geom/toe.gap",
    "geom/tip.size[0]",
    "joint/knee.damping",
    "add:joint/knee.damping",
    "add:geom/*.friction",
    "scale:geom/*.density",
    "opt.iterations",
]


def source(folder: Path, extra: str = "") -> str:
    path = folder / f"model{len(extra)}.xml"
    if not path.exists():
        path.write_text(MODEL.replace("EXTRA", extra))
    return str(path)


@cache
def source_content(path: str) -> bytes:
    """The model without overrides."""
    return content(parse_source(path).load())


@pytest.mark.slow
@given(
    st.lists(
        st.tuples(st.sampled_from(PATHS + COMPILED), st.sampled_from(["0.5", "2", "0.001", "-1", "0"])), max_size=4
    ),
    st.sampled_from(["", "<contact><pair geom1='tip' geom2='toe'/></contact>"]),
)
@settings(max_examples=30, deadline=None)
def test_a_variant_is_the_compiled_model(
    tmp_path_factory: pytest.TempPathFactory, overrides: list[tuple[str, str]], extra: str
) -> None:
    path = source(tmp_path_factory.getbasetemp(), extra)
    varied = parse_source(path, [Override(*override) for override in overrides])
    shared = VariantLoader()
    shared.load(parse_source(path))
    try:
        expected = content(varied.load())
    except MjrunError as error:
        with pytest.raises(type(error)):
            shared.load(varied)
    else:
        assert content(shared.load(varied).model) == expected
    assert content(shared.load(parse_source(path)).model) == source_content(path)  # nothing stays behind


def test_what_the_compiler_copies_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compilations = []

    class Counted(SharedCompilation):
        def __init__(self, spec: mujoco.MjSpec | None, model: mujoco.MjModel) -> None:
            compilations.append(1)
            super().__init__(spec, model)

    monkeypatch.setattr(variants, "SharedCompilation", Counted)
    shared, path = VariantLoader(), source(tmp_path)
    for value in ("0.1", "0.2", "0.3"):
        for name in PATHS:
            shared.load(parse_source(path, [Override(name, value)]))
    # Once for all, and once a value for the gains of the actuator whose damping follows from them.
    assert len(compilations) == 1 + 3


@pytest.mark.parametrize("budget", [2**40, 0])
def test_forgotten_compilations_are_freed_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, budget: int) -> None:
    monkeypatch.setattr(variants, "REMEMBERED_BYTES", budget)
    shared, path = VariantLoader(), source(tmp_path)
    compilations: list[ReferenceType[SharedCompilation]] = []
    gc.disable()  # it would run now and then, after many objects that take little memory
    try:
        for index in range(20):
            overrides = [Override("opt.iterations", str(index + 1)), Override("geom/floor.friction[0]", str(index + 1))]
            variant = shared.load(parse_source(path, overrides))
            compilations.append(ref(variant.compilation))
            shared.reuse(variant)
            del variant
        alive = sum(each() is not None for each in compilations)
    finally:
        gc.enable()
    assert alive == (variants.REMEMBERED if budget else 1)


def test_what_is_remembered_fits_into_the_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.xml"
    texture = '<asset><texture name="t" builtin="flat" type="2d" width="256" height="256"/></asset>'
    path.write_text(MODEL.replace("EXTRA", "").replace("<worldbody>", f"{texture}<worldbody>"))
    size = variants.model_bytes(parse_source(str(path)).load())
    monkeypatch.setattr(variants, "REMEMBERED_BYTES", 10 * size)
    shared, loaded = VariantLoader(), list[ModelVariant]()
    for index in range(12):
        overrides = [Override("opt.iterations", str(index % 3 + 1)), Override("geom/floor.friction[0]", str(index + 1))]
        loaded.append(shared.load(parse_source(str(path), overrides)))
        if index % 3 == 2:
            for variant in loaded:
                shared.reuse(variant)
            loaded.clear()
        assert sum(each.bytes for each in shared._compilations.values()) <= 10 * size
    assert len(shared._compilations) == 2


def test_the_memory_of_a_model_includes_its_python_objects(tmp_path: Path) -> None:
    model = parse_source(source(tmp_path)).load()
    tracemalloc.start()
    try:
        copied = copy.copy(model)
        objects, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    buffer = mujoco.mj_sizeModel(copied)
    assert objects > buffer
    assert variants.model_bytes(model) >= buffer + objects


def test_an_unknown_name_is_reported_as_by_a_compilation(tmp_path: Path) -> None:
    shared = VariantLoader()
    with pytest.raises(UnknownNameError) as caught:
        shared.load(parse_source(source(tmp_path), [Override("geom/tup.friction", "1")]))
    assert "tip" in str(caught.value)


@pytest.mark.parametrize(("path", "value"), [("opt.timestep", "1e13"), ("geom/g.size", "1e-6")])
def test_what_a_compilation_refuses_is_refused_for_variants_too(tmp_path: Path, path: str, value: str) -> None:
    file = tmp_path / "model.xml"
    file.write_text("""<mujoco><worldbody><body name="b"><freejoint/><geom name="g" size=".1" mass="2"/></body>
      <body name="c" pos="1 0 0"><freejoint/><geom size=".1"/></body>
      <body name="d" pos="2 0 0"><freejoint/><geom size=".1"/></body></worldbody></mujoco>""")
    loader, bare = VariantLoader(), FileSource(file)
    for each in ("0.2", "0.3", "0.4"):
        loader.load(bare.with_overrides([Override(path, each)]))
    refused = bare.with_overrides([Override(path, value)])
    with pytest.raises(MjrunError) as error:
        refused.load()
    with pytest.raises(type(error.value), match=re.escape(str(error.value))):
        loader.load(refused)


def test_compiled_models_are_shared_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "model.mjb"
    mujoco.mj_saveModel(parse_source(source(tmp_path)).load(), str(path))
    shared = VariantLoader()
    assert shared.load(parse_source(str(path))).model is shared.load(parse_source(str(path))).model
    with pytest.raises(MjrunError):
        shared.load(parse_source(str(path), [Override("opt.timestep", "1")]))


# --- numbers that the compiler scales, or that others depend on -------------------------------------------------------

ARM = mjcf("arm_with_hand")
NUMBERS = [
    *(
        "body/box.pos",
        "body/arm.pos[2]",
        "body/hand.pos",
        "add:body/hand.pos[0]",
        "body/arm.mass",
        "scale:body/arm.mass",
    ),
    *("site/goal.pos", "site/tip.pos[2]", "scale:site/*.pos", "site/*.size[0]", "geom/pad.pos", "geom/floor.pos[2]"),
    *("geom/pad.size[0]", "geom/floor.size[0]", "scale:geom/box.size", "geom/palm.size[1]", "geom/thumb.size[0]"),
    *("geom/thumb.mass", "geom/palm.density", "scale:geom/*.density", "geom/nail.pos", "geom/ring.pos[2]"),
    *("geom/*.margin", "geom/upper.fromto[3]", "joint/*.damping", "joint/elbow.damping[0]", "joint/shoulder.damping"),
    *("scale:joint/*.armature", "joint/elbow.frictionloss", "joint/elbow.range[1]", "joint/shoulder.stiffness"),
    *(
        "joint/elbow.ref",
        "joint/elbow.pos[0]",
        "camera/eye.pos",
        "camera/eye.fovy",
        "light/light:0.pos",
        "body/hand.quat",
    ),
    *("tendon/cord.stiffness[0]", "actuator/elbow.gear[0]", "geom/geom:1.pos[0]", "body/1.pos[2]", "opt.gravity[2]"),
    *("material/grid.reflectance", "actuator/elbow.gainprm[0]", "geom/thumb.rgba[0]", "body/hand.gravcomp"),
]


@pytest.mark.slow
@given(
    st.sets(st.sampled_from(NUMBERS), min_size=1, max_size=3),
    st.lists(st.lists(st.floats(0.001, 1.5), min_size=3, max_size=3), min_size=4, max_size=5),
)
@settings(max_examples=15, deadline=None)
def test_numbers_that_vary_give_the_compiled_model(
    tmp_path_factory: pytest.TempPathFactory, paths: set[str], points: list[list[float]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "arm.xml"
    path.write_text(ARM)
    shared = VariantLoader()
    for numbers in points:
        overrides = [Override(name, _value(name, numbers)) for name in sorted(paths)]
        varied = parse_source(str(path), overrides)
        try:
            expected = content(varied.load())
        except MjrunError as error:
            with pytest.raises(type(error)):
                shared.load(varied)
            continue
        variant = shared.load(varied)
        assert content(variant.model) == expected
        shared.reuse(variant)


def _value(path: str, numbers: list[float]) -> str:
    """One number, or three for a vector of three."""
    is_vector = path.endswith((".pos", "box.size")) and not path.startswith("scale:")
    return ",".join(map(repr, numbers if is_vector else numbers[:1]))


@cases("name, path")
def test_numbers_of_real_models_give_the_compiled_model(name: str, path: str) -> None:
    model = MODELS / name
    if not model.exists():
        pytest.skip("the models are not here")
    shared = VariantLoader()
    for number in ("0.01", "1.1", "1.2345678", "0.01"):
        varied = parse_source(str(model), [Override(path, number)])
        try:
            expected = content(varied.load())
        except MjrunError:
            continue
        variant = shared.load(varied)
        assert content(variant.model) == expected
        shared.reuse(variant)


def test_models_that_are_overwritten_by_others_keep_no_number(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    shared = VariantLoader()
    # The pad passes the upper arm, so that their bounding volumes change places.
    for number in ("0.3", "0.25", "0.35", "0.1", "1.3"):
        for name in ("geom/box.size[0]", "geom/pad.pos[0]", "site/goal.pos[0]", "body/hand.pos[0]", "geom/pad.size[0]"):
            varied = parse_source(str(path), [Override(name, number)])
            variant = shared.load(varied)
            assert content(variant.model) == content(varied.load())
            shared.reuse(variant)


def test_numbers_that_vary_are_not_compiled_from_the_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    compilations: list[str] = []
    compile_source = FileSource.compile

    def counted(self: FileSource) -> tuple[mujoco.MjSpec | None, mujoco.MjModel]:
        compilations.append(str(self.overrides))
        return compile_source(self)

    monkeypatch.setattr(FileSource, "compile", counted)
    shared = VariantLoader()
    for index in range(10):
        for name in ("site/wrist.pos[0]", "geom/thumb.mass", "joint/elbow.range[1]"):
            shared.load(parse_source(str(path), [Override(name, str(0.1 + index / 100))]))
    # The first, the common one, and those that prove two values of each path.
    assert len(compilations) <= 2 + 3 * variants.PROOFS + 1
