"""Checks of required packages: missing ones, wrong versions, and the packages that require those versions.

Versions are compared with mjrun's metadata, which pip reads too. Without metadata, all versions are accepted.
"""

import importlib.util
import operator
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from mjrun.errors import DamagedPackageError, MissingExtraError, MjrunError, WrongVersionError

MODULES = {  # by package
    "pillow": "PIL",
    "protobuf": "google.protobuf",
    "pyyaml": "yaml",
    "scikit-image": "skimage",
    "usd-core": "pxr",
    "warp-lang": "warp",
}
PACKAGES = {module: package for package, module in MODULES.items()}
FIELD = "Requires-Dist: "  # of metadata
CORE = ("mujoco", "numpy")  # packages whose other versions may fail late, or compute other results

_REQUIREMENT = r"([\w.-]+)\s*(?:\[[^]]*\])?\s*\(?([^;()]*)\)?\s*(?:;(.*))?"
_CLAUSE = r"(~=|===?|!=|<=|>=|<|>)\s*([^\s,]+)"
_COMPARISONS = {
    "==": operator.eq,
    "===": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_LENGTH = 6  # numbers of a release that are compared


class PackageRequirement(NamedTuple):
    """A requirement of one package for another.

    Attributes:
      package: the normalized name of the required package: `scikit-image`.
      specifier: the accepted versions: `<15,>=13.7`; empty for any.
      marker: the condition of the requirement: `extra == 'plot'`; empty for always.
    """

    package: str
    specifier: str
    marker: str

    @property
    def module(self) -> str:
        """The module that the package installs."""
        return MODULES.get(self.package, self.package.replace("-", "_"))

    @property
    def lowest(self) -> str:
        """The lowest version, or an empty text."""
        return next((bound for comparison, bound in re.findall(_CLAUSE, self.specifier) if comparison == ">="), "")

    def allows(self, version: str) -> bool:
        """Returns whether the requirement accepts a version."""
        return all(_satisfies(version, comparison, bound) for comparison, bound in re.findall(_CLAUSE, self.specifier))


def require(use: str, extra: str, *modules: str) -> dict[str, str]:
    """Returns the versions of the libraries of an extra, by package, after checking them.

    Args:
      use: the feature that needs them, as the subject of a sentence.

    Raises:
      MissingExtraError: one is not installed.
      WrongVersionError: one has another version.
    """
    packages = [PACKAGES.get(module, module.replace("_", "-")) for module in modules]
    for module, package in zip(modules, packages, strict=True):
        if not _is_installed(module):
            raise MissingExtraError(use, package, extra)
    versions = {package: installed_version(package) for package in packages}
    for error in wrong_versions(versions):
        raise error
    return versions


def require_all(extras: Mapping[str, tuple[Sequence[str], str]]) -> None:
    """Does the same for several extras, each with its libraries and its features."""
    for extra, (modules, use) in extras.items():
        require(use, extra, *modules)


def require_core_versions() -> None:
    """Checks the versions of MuJoCo and NumPy if they are imported, in a fraction of a millisecond.

    Raises:
      WrongVersionError: a version is not supported.
    """
    imported = {package: sys.modules[package] for package in CORE if package in sys.modules}
    for error in wrong_versions({package: str(module.__version__) for package, module in imported.items()}):
        raise error


def core_versions() -> dict[str, str]:
    """Returns the versions of MuJoCo and NumPy after checking them, without importing them.

    Raises:
      WrongVersionError: a version is not supported.
    """
    versions = {package: installed_version(package) for package in CORE}
    for error in wrong_versions(versions):
        raise error
    return versions


def installed_wrong() -> Iterator[WrongVersionError]:
    """Yields an error for each always required package with a wrong version."""
    return wrong_versions(
        {each.package: installed_version(each.package) for each in _requirements() if not each.marker}
    )


def installed_versions() -> dict[str, str]:
    """Returns the versions of all packages that mjrun and its extras require; empty texts for missing ones."""
    return {package: installed_version(package) for package in sorted({each.package for each in _requirements()})}


def wrong_versions(versions: Mapping[str, str]) -> Iterator[WrongVersionError]:
    """Yields an error for each package, given with its version, that mjrun requires in another version."""
    needed = {each.package: each for each in _requirements()}
    for package, version in versions.items():
        if version and package in needed and not needed[package].allows(version):
            yield WrongVersionError(package, needed[package].specifier, version, _requiring(needed[package]))


def cause_of(error: BaseException) -> MjrunError | None:
    """Returns a package problem that may explain an unexpected `error`, if there is one."""
    for wrong in installed_wrong():
        return wrong
    if not isinstance(error, ImportError):
        return None
    from traceback import walk_tb

    place = [frame.f_globals.get("__name__", "") for frame, _ in walk_tb(error.__traceback__)][-1:]
    for each in _requirements():
        if not each.marker and not _is_installed(each.module):
            return MissingExtraError("mjrun", each.package)
        if place == [each.module]:  # it raised the error as it was imported
            return DamagedPackageError(each.package, installed_version(each.package), str(error))
    return None


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # the package that contains it
        return False


def _requiring(needed: PackageRequirement) -> dict[str, str]:
    """Returns the reasons for other versions than mjrun's, by the installed packages that require them."""
    from importlib.metadata import distributions

    installed = [
        (each.name, each.version, _read(each.read_text("METADATA") or ""))
        for each in distributions()
        if each.name != "mjrun"
    ]
    requiring: dict[str, str] = {}
    for name, version, requirements in installed:
        others = [each for each in requirements if each.package == needed.package and "extra" not in each.marker]
        if not others or any(each.allows(needed.lowest) for each in others):
            continue
        wish = f"{name} {version} ({needed.package}{others[0].specifier})"
        package = _normalized(name)
        users = [
            (user, user_version)
            for user, user_version, wishes in installed
            if any(each.package == package and "extra" not in each.marker for each in wishes)
        ]
        if users:
            wish += f", which {' and '.join(' '.join(user) for user in users)} needs"
        requiring[" and ".join(user for user, _ in users) or name] = wish
    return requiring


def _requirements() -> list[PackageRequirement]:
    """Returns mjrun's requirements; empty if it is not installed, as in a folder on PYTHONPATH."""
    return _read(_metadata("mjrun"))


def _read(metadata: str) -> list[PackageRequirement]:
    """Reads a package's requirements."""
    texts = _fields(metadata, FIELD)
    matches = [match for match in (re.match(_REQUIREMENT, text) for text in texts) if match]
    return [
        PackageRequirement(_normalized(name), specifier.strip(), (marker or "").strip())
        for name, specifier, marker in (match.groups() for match in matches)
    ]


def _fields(metadata: str, name: str) -> list[str]:
    """Returns the values of a field of a package's metadata, from its headers alone: parsing a whole README is slow."""
    headers, _, _ = metadata.partition("\n\n")
    return [line.removeprefix(name).strip() for line in headers.splitlines() if line.startswith(name)]


def _metadata(package: str) -> str:
    """Returns the metadata of a package; empty if it is not installed."""
    pattern = re.compile(rf"{package.replace('-', '_')}-\d[^-]*\.dist-info", re.IGNORECASE)
    for folder in sys.path:
        with suppress(OSError):
            for name in filter(pattern.fullmatch, os.listdir(folder or os.curdir)):  # noqa: PTH208 – of thousands
                return Path(folder, name, "METADATA").read_text("utf-8")
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import; knows other installations

    with suppress(PackageNotFoundError):
        return distribution(package).read_text("METADATA") or ""
    return ""


def _normalized(name: str) -> str:
    """Normalizes the name of a package."""
    return re.sub(r"[-_.]+", "-", name).lower()


def installed_version(package: str) -> str:
    """Returns the version of a package; empty if it is not installed."""
    return next(iter(_fields(_metadata(package), "Version: ")), "")


def packages_of(modules: Iterable[str]) -> list[str]:
    """Returns the packages that install modules, sorted; of missing ones, names made from those of the modules."""
    named = {module: [PACKAGES.get(module, module.replace("_", "-"))] for module in modules}
    for module, (package,) in named.items():
        if not installed_version(package):
            named[module] = _packages(tuple(sys.path)).get(module, [package])
    return sorted({package for packages in named.values() for package in packages})


@cache
def _packages(path: tuple[str, ...]) -> Mapping[str, list[str]]:
    """Returns the packages in `sys.path` by the modules that they install, which takes 0.1 s."""
    from importlib.metadata import packages_distributions

    return packages_distributions()


def _satisfies(version: str, comparison: str, bound: str) -> bool:
    """Returns whether `version` satisfies a clause such as `>=2.0`; `==1.*` and `~=` compare the first numbers only."""
    mine, theirs = _release(version), _release(bound)
    count = bound.removesuffix(".*").count(".") + 1
    if comparison == "~=":
        return mine >= theirs and mine[: count - 1] == theirs[: count - 1]
    if bound.endswith(".*"):
        mine, theirs = mine[:count], theirs[:count]
    return _COMPARISONS[comparison](mine, theirs)


def _release(version: str) -> tuple[int, ...]:
    """Returns the numbers of a release, 1.2.0 as 1.2, without suffixes such as `rc1` and `+cpu`."""
    match = re.match(r"v?(?:\d+!)?(\d+(?:\.\d+)*)", version)
    numbers = [int(part) for part in match[1].split(".")] if match else []
    return tuple([*numbers, *[0] * _LENGTH][:_LENGTH])
