"""A tray that is fixed becomes convex parts of the same shape, in which a ball comes to rest."""

import subprocess
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest

from mjrun.check.context import CheckContext
from mjrun.check.fixing import changed_fields
from mjrun.check.rules import decomposition_fix
from mjrun.check.rules.decomposition_fix import FINENESS
from mjrun.formats.user_cache import VARIABLE, UserCache
from mjrun.model.xml_source import read_xml
from mjrun.platform import system
from tests.check import fixes
from tests.check.fixes import fix, fixing
from tests.check.models import mjcf, write
from tests.check.rules.test_meshes import TRAY, TRAY_FACES

WALLS = ((0, 5, 6, 7), (1, 2, 3, 4), (0, 1, 4, 5))  # the corners of the profile of each convex part: its exact shape
PARTS = [[*wall, *(corner + 8 for corner in wall)] for wall in WALLS]
QUADS = ((0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
BOX = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))])
BALL = '<body name="ball" pos="{}"><freejoint/><geom name="ball" size=".03"/></body>'
IN_TRAY = BALL.format(".1 .1 .06")
TRAY_GEOM = '<geom name="tray" type="mesh" mesh="tray"/>'
ASSET = '<asset>\n  <mesh name="tray" file="meshes/tray.obj"/>\n</asset>'


@pytest.fixture(autouse=True)
def tray(workplace: Path) -> None:
    Path("meshes").mkdir()
    lines = [f"v {x} {y} {z}" for x, y, z in 0.2 * TRAY] + [f"f {a} {b} {c}" for a, b, c in TRAY_FACES + 1]
    write("meshes/tray.obj", "\n".join(lines))
    mujoco.mj_clearCache(mujoco.mj_getCache())  # of meshes, which it identifies by relative paths


@pytest.fixture
def coacd(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replaces CoACD, which the example of the explanation is fixed with, by what is right for the tray."""
    library = ModuleType("coacd")
    library.__spec__ = ModuleSpec("coacd", None)
    functions: dict[str, Any] = {
        "Mesh": lambda vertices, faces: vertices,
        "run_coacd": lambda vertices, threshold: [(vertices[part], BOX) for part in PARTS],
        "set_log_level": str,
    }
    for name, function in functions.items():
        setattr(library, name, function)
    monkeypatch.setitem(sys.modules, "coacd", library)


def loaded(path: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def corners(path: str, collide: bool) -> np.ndarray:
    """The vertices of the meshes that collide, or of the others, in the world."""
    model, data = loaded(path)
    points = []
    for geom in np.flatnonzero((model.geom_dataid >= 0) & ((model.geom_contype != 0) == collide)):
        start = model.mesh_vertadr[model.geom_dataid[geom]]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[model.geom_dataid[geom]]]
        points.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(points)


@pytest.mark.skipif(not system.CAN_FORK_LATE, reason="the limit is that of a fork")
@pytest.mark.usefixtures("coacd")
def test_a_mesh_whose_parts_take_too_long_is_left_alone_and_the_reason_is_stated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def compute(*_: object, **__: object) -> None:
        while True:
            pass

    monkeypatch.setattr(sys.modules["coacd"], "run_coacd", compute)
    monkeypatch.setattr(decomposition_fix, "TIME_LIMIT", 1)
    model = write("model.xml", mjcf(TRAY_GEOM + IN_TRAY, before=ASSET))
    made: Any = fixing(model, unsafe=True)
    assert made.files == []
    assert all("take more than 1 s of computing" in finding.unfixed for finding in made.results[0].findings)


@pytest.mark.usefixtures("coacd")
def test_parts_of_a_mesh_are_computed_once_and_stored_exactly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    model, found = (
        Path(write("model.xml", mjcf(TRAY_GEOM + IN_TRAY, before=ASSET))),
        list[list[decomposition_fix.Surface]](),
    )
    for _ in range(2):
        context = CheckContext.load(model, read_xml(model))
        context.cache = UserCache("parts")
        with monkeypatch.context() as patch:
            patch.setattr(decomposition_fix, "limit_this_process", dict)  # this process is not one of those that check
            found.append(decomposition_fix._parts(context, 0, 0.05))
        monkeypatch.setattr(sys.modules["coacd"], "run_coacd", None)
    for first, second in zip(*found, strict=True):
        np.testing.assert_array_equal(first.vertices, second.vertices)
        np.testing.assert_array_equal(first.faces, second.faces)
    assert len(found[0]) == len(PARTS)


@pytest.mark.usefixtures("coacd")
def test_a_ball_comes_to_rest_on_the_bottom_of_a_tray() -> None:
    model = write("model.xml", mjcf(TRAY_GEOM + IN_TRAY, before=ASSET))
    assert set(fix(model, unsafe=True)) == {model, *map(str, Path().glob("meshes/tray_part*.obj"))}
    assert fix(model, unsafe=True) == {}
    compiled, data = loaded(model)
    mujoco.mj_step(compiled, data, 500)
    np.testing.assert_allclose(data.body("ball").xpos, [0.1, 0.1, 0.05], atol=2e-3)


@pytest.mark.parametrize(
    ("mesh", "geom", "defaults"),
    [
        ("", "", '<mesh scale="2 2 2"/>'),
        ('scale="1 1 1.2"', 'pos=".01 0 0" euler="0 0 5"', ""),
        ('refpos=".01 .02 0" refquat="1 .1 0 0"', 'quat="1 .1 .02 .01"', ""),
    ],
)
@pytest.mark.usefixtures("coacd")
def test_the_parts_are_where_the_mesh_was(mesh: str, geom: str, defaults: str) -> None:
    asset = ASSET.replace('tray.obj"', f'tray.obj" {mesh}')
    frame = f'<frame pos="0 0 .001" euler="2 0 0"><geom type="mesh" mesh="tray" {geom}/></frame>'
    size = ".1 .1 .06" if not defaults else ".2 .2 .12"
    model = write("model.xml", mjcf(frame + BALL.format(size), before=f"<default>{defaults}</default>{asset}"))
    whole = corners(model, True)
    fix(model, unsafe=True)
    np.testing.assert_allclose(corners(model, False), whole, rtol=0, atol=1e-8)  # quaternions are normalized, too
    distances = np.linalg.norm(corners(model, True)[:, None] - whole, axis=2)
    np.testing.assert_allclose(distances.min(axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(distances.min(axis=1), 0, atol=1e-6)


INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>'
SHOWN = '<geom type="mesh" mesh="tray" contype="0" conaffinity="0" mass="0"/>'


@pytest.mark.parametrize(
    ("inertial", "others", "geom", "stays"),
    [
        ("", "", "", True),  # visible, and gives mass
        (INERTIAL, "", "", True),  # visible
        (INERTIAL, SHOWN, "", False),  # another one is visible
        (INERTIAL, "", 'group="3"', False),
        ("", SHOWN, 'group="3"', True),  # gives mass
        ("", SHOWN, 'group="3" mass="0"', False),
    ],
)
@pytest.mark.usefixtures("coacd")
def test_a_geom_stays_if_it_has_another_use_and_the_body_keeps_its_inertia(
    inertial: str, others: str, geom: str, stays: bool
) -> None:
    other = others.replace('mass="0"', "") if 'mass="0"' in geom else others
    body = f'<body name="tray">\n<freejoint/>{inertial}\n{other}\n<geom type="mesh" mesh="tray" {geom}/>\n</body>'
    model = write("model.xml", mjcf(body + IN_TRAY, before=ASSET))
    before, _ = loaded(model)
    original = write("original.xml", Path(model).read_text())
    fix(model, unsafe=True)
    after, _ = loaded(model)
    colliding = after.geom_contype[after.geom_dataid >= 0] != 0
    assert (colliding.sum(), (~colliding).sum()) == (3, stays + bool(others))
    assert (after.geom_group[after.geom_dataid >= 0][colliding] == (0 if other and not geom else 3)).all()
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    changes = changed_fields(Path(original), after)
    assert changes
    assert {name.partition("_")[0] for name, _ in changes} == {"geom", "mesh"}


@pytest.mark.parametrize(
    "after",
    ['<contact><pair geom1="tray" geom2="ball"/></contact>', '<sensor><contact geom1="tray" data="found"/></sensor>'],
)
@pytest.mark.usefixtures("coacd")
def test_a_geom_that_is_named_for_contacts_is_left_alone(after: str) -> None:
    model = write("model.xml", text := mjcf(TRAY_GEOM + IN_TRAY, after, ASSET))
    made = fixing(model, unsafe=True)
    assert Path(model).read_text() == text
    reasons = {f.unfixed for f in made.results[0].findings if f.code == "MJ506"}  # type: ignore[attr-defined]
    assert reasons == {"a <pair> or a sensor of contacts refers to the geom by name"}


@pytest.mark.usefixtures("coacd")
def test_a_geom_that_penetrates_the_walls_too_is_left_alone_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    decompositions: list[float] = []
    coacd: Any = sys.modules["coacd"]
    run = coacd.run_coacd

    def counted(vertices: np.ndarray, threshold: float) -> object:
        decompositions.append(threshold)
        return run(vertices, threshold)

    monkeypatch.setattr(coacd, "run_coacd", counted)
    monkeypatch.setattr(decomposition_fix, "_limited", lambda decompose: decompose())  # which counts no calls in a fork
    model = write("model.xml", mjcf(TRAY_GEOM + BALL.format(".1 .1 .025"), before=ASSET))
    (cavity,) = (f for f in fixes.lint(model, unsafe=True).result.findings if f.code == "MJ506")
    assert cavity.fixes == ()
    assert cavity.unfixed.startswith("geom 'ball' penetrates convex parts of the mesh, too")
    assert decompositions == [FINENESS[0]]  # for both findings: finer parts could not make room


def test_without_the_library_the_finding_states_what_to_install_and_other_faults_are_fixed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "coacd", None)
    hinge = '<body>\n<joint range="9 -9"/><geom size=".1" pos="9 9 9"/></body>'
    model = write("model.xml", mjcf(TRAY_GEOM + IN_TRAY + hinge, before=ASSET))
    made = fixing(model, unsafe=True)
    assert [dict(file.fixes) for file in made.files] == [{"MJ302": 1}]
    reasons = [f.unfixed for f in made.results[0].findings if f.code in ("MJ501", "MJ506")]  # type: ignore[attr-defined]
    assert len(reasons) == 2
    assert all("needs coacd, which is not installed" in reason for reason in reasons)
    assert all(reason.endswith("pip install 'mjrun[coacd]'") for reason in reasons)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.usefixtures("coacd")
def test_parts_in_place_of_another_geom_of_the_mesh_are_refused(named: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ('name="tray"', 'name="other"') if named else ("", "")
    geoms = "".join(
        f'<geom {name} type="mesh" mesh="tray" pos="{x} 0 0"/>' for name, x in zip(names, (0, 5), strict=True)
    )
    model, element = write("model.xml", text := mjcf(geoms + IN_TRAY, before=ASSET)), CheckContext.element
    wrong = {("geom", 0): 1}
    monkeypatch.setattr(CheckContext, "element", lambda self, kind, i: element(self, kind, wrong.get((kind, i), i)))
    made = fixing(model, unsafe=True)
    assert (made.files, Path(model).read_text()) == ([], text)
    assert {f.code for f in made.results[0].findings} >= {"MJ007", "MJ506"}  # type: ignore[attr-defined]


@pytest.mark.usefixtures("coacd")
def test_a_file_of_the_same_name_is_not_replaced() -> None:
    other = write("meshes/tray_part2.obj", "# mine")
    model = write("model.xml", text := mjcf(TRAY_GEOM + IN_TRAY, before=ASSET))
    fix(model, unsafe=True)
    assert Path(other).read_text() == "# mine"
    assert 'file="meshes/tray_2_part2.obj"' in Path(model).read_text()
    write(model, text)
    assert list(fix(model, unsafe=True)) == [model]  # its files are still there, with the same content


@pytest.mark.usefixtures("coacd")
def test_nothing_changes_if_one_of_the_files_appears_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    model = write("model.xml", text := mjcf(TRAY_GEOM + IN_TRAY, before=ASSET))
    check = fixes.lint

    def late(name: str, *arguments: Any, **options: bool) -> Any:
        checked = check(name, *arguments, **options)
        write("meshes/tray_part3.obj", "# mine")
        return checked

    monkeypatch.setattr(fixes, "lint", late)
    made = fixing(model, unsafe=True)
    problems = [(f.file, f.message) for f in made.results[0].findings if f.code == "MJ007"]  # type: ignore[attr-defined]
    assert problems == [("meshes/tray_part3.obj", "it exists already, with other content")]
    assert (made.files, Path(model).read_text()) == ([], text)
    assert sorted(path.name for path in Path("meshes").iterdir()) == ["tray.obj", "tray_part3.obj"]


@pytest.mark.usefixtures("coacd")
def test_parts_outside_the_given_folders_are_not_created_and_reported_once() -> None:
    Path("robots").mkdir()
    asset = ASSET.replace("meshes/", "../meshes/")
    model = write("robots/model.xml", text := mjcf(TRAY_GEOM + IN_TRAY, before=asset))
    made = fixing(model, unsafe=True)
    problems = [f.file for f in made.results[0].findings if f.code == "MJ007"]  # type: ignore[attr-defined]
    assert problems == ["meshes/tray_part1.obj"]
    assert (made.files, Path(model).read_text()) == ([], text)
    assert "meshes/tray_part1.obj" in [file.file for file in fixing(model, given=["."], unsafe=True).files]


@pytest.mark.usefixtures("coacd")
def test_the_diff_of_a_dry_run_is_a_patch_that_creates_the_files() -> None:
    model = write("model.xml", mjcf(TRAY_GEOM + IN_TRAY, before=ASSET))
    made = fixing(model, unsafe=True, dry_run=True)
    assert [path.name for path in Path("meshes").iterdir()] == ["tray.obj"]
    patch = "".join(file.diff for file in made.files)
    subprocess.run(["patch", "-p0"], input=patch, text=True, capture_output=True, check=True)
    assert fix(model, unsafe=True) == {}
    assert loaded(model)[0].nmesh == 4
