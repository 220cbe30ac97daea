"""Versions of other packages, against `packaging`; and what is reported where one of them is wrong."""

import itertools
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement as OracleRequirement
from packaging.specifiers import SpecifierSet

import mjrun
import mjrun.packages
from mjrun.errors import MissingExtraError, WrongVersionError
from mjrun.packages import PackageRequirement, cause_of, require, require_all, require_core_versions, wrong_versions
from tests.packages import hidden, planted, run_with

RELEASES = ["0", "1", "1.0", "1.2", "1.2.0", "1.2.3", "1.10", "2", "2.0.1", "10.1", "1.2.3.4"]
CLAUSES = [
    *(f"{comparison}{release}" for comparison in (">=", "<=", ">", "<", "==", "!=") for release in RELEASES),
    *(f"{comparison}{release}.*" for comparison in ("==", "!=") for release in RELEASES),
    *(f"~={release}" for release in RELEASES if "." in release),
]

SCENES = Path(__file__).parents[1] / "scenes"


def test_a_version_is_allowed_where_packaging_allows_it() -> None:
    pairs = [">=1.2,<2", "<15,>=13.7", ">1,!=1.2.*", ""]
    for version, specifier in itertools.product([*RELEASES, "1.2.1", "1.3", "14.3.4", "15"], [*CLAUSES, *pairs]):
        allowed = SpecifierSet(specifier).contains(version)
        assert PackageRequirement("x", specifier, "").allows(version) == allowed, (version, specifier)


def test_what_installed_packages_need_is_read_as_packaging_reads_it() -> None:
    compared = 0
    for distribution in metadata.distributions():
        expected = [OracleRequirement(text) for text in distribution.requires or []]
        read = mjrun.packages._read(distribution.read_text("METADATA") or "")
        assert [each.package for each in read] == [
            each.name.lower().replace("_", "-").replace(".", "-") for each in expected
        ]
        for mine, oracle in zip(read, expected, strict=True):
            assert SpecifierSet(mine.specifier) == oracle.specifier
            assert bool(mine.marker) == (oracle.marker is not None)
            compared += 1
    assert compared > 100


def test_a_local_or_unfinished_version_counts_as_its_release() -> None:
    assert PackageRequirement("torch", ">=2.13", "").allows("2.13.0+cpu")
    assert not PackageRequirement("mujoco", ">=4", "").allows("3.11.0rc1")


def needs(monkeypatch: pytest.MonkeyPatch, *requirements: PackageRequirement) -> None:
    monkeypatch.setattr(mjrun.packages, "_requirements", lambda: list(requirements))


def test_a_library_is_required_in_a_version_that_works(monkeypatch: pytest.MonkeyPatch) -> None:
    needs(
        monkeypatch,
        PackageRequirement("scipy", ">=1", "extra == 'fit'"),
        PackageRequirement("scikit-image", ">=99", ""),
    )
    assert require("a fit", "fit", "scipy") == {"scipy": metadata.version("scipy")}
    with pytest.raises(
        MissingExtraError, match=r"^a fit needs not-here, which is not installed\npip install 'mjrun\[fit\]'$"
    ):
        require("a fit", "fit", "scipy", "not_here")
    with pytest.raises(MissingExtraError, match=r"a fit needs not-here\.part"):
        require("a fit", "fit", "not_here.part")
    installed = metadata.version("scikit-image")
    with pytest.raises(WrongVersionError) as error:
        require_all({"diff": (("skimage",), "a comparison")})
    needed = "scikit-image>=99"
    assert (
        str(error.value) == f"mjrun needs {needed}, but scikit-image {installed} is installed\npip install '{needed}'"
    )


def test_mujoco_and_numpy_are_those_that_are_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    require_core_versions()
    monkeypatch.setattr("mujoco.__version__", "3.11.0")
    needs(monkeypatch, PackageRequirement("mujoco", ">=4", ""), PackageRequirement("numpy", ">=2", ""))
    with pytest.raises(WrongVersionError, match=r"^mjrun needs mujoco>=4, but mujoco 3\.11\.0 is installed"):
        require_core_versions()


def test_without_metadata_no_version_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    needs(monkeypatch)
    assert list(wrong_versions({"mujoco": "1.0"})) == []
    assert cause_of(AttributeError("a real bug")) is None


# --- in other environments


@pytest.fixture
def old_mujoco(tmp_path: Path) -> Path:
    """A folder with an older MuJoCo, and a package that asks for it."""
    planted(tmp_path, "mujoco", "3.11.0", code="__version__ = '3.11.0'")
    planted(tmp_path, "some_lab", "1.6.0", "mujoco~=3.11.0")
    planted(tmp_path, "some_tool", "2.0", "mujoco>=3; extra == 'all'")
    return tmp_path


SENTENCE = "mjrun needs mujoco>=4, but mujoco 3.11.0 is installed, as required by some_lab 1.6.0 (mujoco~=3.11.0)"
INSTALLATION = "pip uninstall -y mujoco mujoco-core mujoco-studio && pip install 'mujoco>=4'"
REMEDY = f"to use only the models of some_lab: {INSTALLATION}, although pip warns"


@pytest.mark.parametrize("line", ["info scene:swing", "schema run", "plot a.csv -o a.png"])
def test_an_older_mujoco_ends_every_command_with_one_sentence_that_names_who_asks_for_it(
    old_mujoco: Path, line: str
) -> None:
    done = run_with(old_mujoco, "-m", "mjrun", *line.split())
    assert (done.returncode, done.stdout) == (2, "")
    first, second, third = done.stderr.splitlines()
    assert first == f"mjrun: error: {SENTENCE}"
    assert "python -m venv mjrun-env && mjrun-env/bin/pip install mjrun" in second
    assert third.strip() == REMEDY


@pytest.mark.parametrize("code", ["import mujoco, mjrun; mjrun.render", "import mjrun.gym"])
def test_python_raises_the_same_sentence(old_mujoco: Path, code: str) -> None:
    done = run_with(old_mujoco, "-c", code)
    assert done.returncode == 1
    assert f"mjrun.errors.WrongVersionError: {SENTENCE}\n" in done.stderr
    assert "During handling" not in done.stderr


def test_what_a_package_brought_is_named_with_it(tmp_path: Path) -> None:
    planted(tmp_path, "mujoco", "3.11.0", code="__version__ = '3.11.0'")
    planted(tmp_path, "some_solver", "0.1", "mujoco<4,>=3")
    planted(tmp_path, "some_suite", "1.5", "some-solver; python_version > '3'")
    done = run_with(tmp_path, "-m", "mjrun", "info", "scene:swing")
    assert ", as required by some_solver 0.1 (mujoco<4,>=3), which some_suite 1.5 needs\n" in done.stderr
    assert f"to use only the models of some_suite: {INSTALLATION}, " in done.stderr


@pytest.mark.parametrize("line", ["info scene:swing", "doctor", "plot a.csv -o a.png"])
def test_a_package_that_another_one_has_damaged_is_to_be_installed_again(tmp_path: Path, line: str) -> None:
    planted(tmp_path, "mujoco", "4.1", code="raise ImportError('core bindings are missing. Help yourself')")
    done = run_with(tmp_path, "-m", "mjrun", *line.split())
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "mjrun: error: mujoco 4.1 is damaged: core bindings are missing\n"
        "  pip uninstall -y mujoco mujoco-core mujoco-studio && pip install 'mujoco==4.1'\n"
    )


def test_another_package_is_named_when_it_fails(tmp_path: Path) -> None:
    planted(tmp_path, "orjson", "1.0.0", code="")
    done = run_with(tmp_path, "-m", "mjrun", "trace", str(SCENES / "dominos.xml"), "--steps", "1")
    assert done.returncode == 2
    assert done.stderr.startswith("mjrun: error: mjrun needs orjson>=")
    assert "but orjson 1.0.0 is installed\n  pip install 'orjson>=" in done.stderr


def test_a_package_that_is_missing_is_named(tmp_path: Path) -> None:
    task = SCENES / "car_drive.yaml"
    done = run_with(hidden(tmp_path, "yaml"), "-c", f"import mjrun; mjrun.read_task({str(task)!r})")
    assert (
        "mjrun.errors.MissingExtraError: mjrun needs pyyaml, which is not installed\npip install pyyaml" in done.stderr
    )


def test_a_bug_is_still_called_a_bug() -> None:
    assert cause_of(AttributeError("module 'mujoco' has no attribute 'x'")) is None
    assert cause_of(ImportError("cannot import name")) is None
