"""Does everything for a release but the upload: `make release-check`.

Builds sdist and wheel in dist/, compares the versions that files state, installs the wheel in a fresh environment, and
runs it there outside of the checkout. `release_check.py notes` prints the section of CHANGELOG.md of the version.
"""

import re
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
LIMIT = 3_000_000  # bytes of the wheel
NEEDED = (
    "mjrun/py.typed",
    "mjrun/__init__.pyi",
    "mjrun/SKILL.md",
    "mjrun/scenes/dominos.xml",
    "mjrun/rendering/fonts/OFL.txt",
    "mjrun/outputs/exports/replay/viewer.js.gz",
    "mjrun/outputs/exports/replay/LICENSE-three",
)
UNWANTED = ("tests/", ".github/", "out/", "benchmarks/")


def main() -> None:
    """Runs all checks, or prints the notes of the release."""
    if sys.argv[1:] == ["notes"]:
        print(notes(version()))
        return
    check_versions()
    wheel, sdist = build()
    check_contents(wheel, sdist)
    try_wheel(wheel)
    print(f"ready: {wheel.name} ({wheel.stat().st_size:,} bytes), {sdist.name} ({sdist.stat().st_size:,} bytes)")


def version() -> str:
    """Returns the version of the package."""
    (text,) = re.findall(r'^__version__ = "([^"]+)"', (ROOT / "mjrun/version.py").read_text("utf-8"), re.MULTILINE)
    return text


def notes(name: str) -> str:
    """Returns the section of a version in the changelog.

    Raises:
      SystemExit: it has none.
    """
    sections = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text("utf-8"), flags=re.MULTILINE)
    section = next((each for each in sections if re.match(rf"{re.escape(name)}\b", each)), None)
    if section is None:
        sys.exit(f"CHANGELOG.md has no section {name}")
    return section.partition("\n")[2].strip()


def check_versions() -> None:
    """Compares the versions in files that no tool writes.

    Raises:
      SystemExit: one of them states another version.
    """
    name = version()
    notes(name)
    for file, pattern in (("CITATION.cff", r"^version: (.+)$"), ("packaging/recipe.yaml", r"^  version: (.+)$")):
        stated = re.findall(pattern, (ROOT / file).read_text("utf-8"), re.MULTILINE)[0]
        if stated != name:
            sys.exit(f"{file} states the version {stated}, and mjrun/version.py {name}")


def build() -> tuple[Path, Path]:
    """Builds wheel and sdist with the build backend of this environment, and returns them."""
    for old in DIST.glob("mjrun-*"):
        old.unlink()
    subprocess.run([sys.executable, "-m", "hatchling", "build"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    (wheel,), (sdist,) = DIST.glob("mjrun-*.whl"), DIST.glob("mjrun-*.tar.gz")
    return wheel, sdist


def check_contents(wheel: Path, sdist: Path) -> None:
    """Checks that the wheel is complete and small, and that the sdist can build it.

    Raises:
      SystemExit: a file is missing or unwanted, or the wheel is too large.
    """
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    missing = [name for name in NEEDED if name.format(version=version()) not in names]
    unwanted = [name for name in names if name.startswith(UNWANTED)]
    if missing or unwanted or wheel.stat().st_size > LIMIT:
        sys.exit(f"{wheel.name}: missing {missing}, unwanted {unwanted}, {wheel.stat().st_size:,} bytes")
    with tarfile.open(sdist) as archive:
        files = {name.partition("/")[2] for name in archive.getnames()}
    if lacking := {"pyproject.toml", "README.md", "LICENSE", "mjrun/version.py", "scenes/dominos.xml"} - files:
        sys.exit(f"{sdist.name}: missing {sorted(lacking)}")


def try_wheel(wheel: Path) -> None:
    """Installs the wheel in a fresh environment and runs what a first user runs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        venv.create(folder / "env", with_pip=True)
        program = folder / "env/bin"
        subprocess.run([program / "pip", "install", "--quiet", wheel], check=True)
        for arguments in (
            ["--version"],
            ["info", "scene:dominos"],
            ["trace", "scene:pendulum", "--key", "level", "--duration", "0.1", "-o", "trace.csv"],
            ["video", "scene:dominos", "--camera", "top", "--duration", "0.2", "--size", "160x90", "-o", "video.mp4"],
            ["completion", "bash"],
            ["skill"],
        ):
            subprocess.run([program / "mjrun", *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
