"""Bundles the viewer of replays, mjrun/outputs/exports/replay, from its source in scripts/replay and three.js.

    python scripts/bundle_replay.py

npm installs the versions that scripts/replay/package-lock.json pins; the same source gives the same bytes. The first
line of the viewer holds the hash of its source, by which a test recognizes an outdated bundle.
"""

import gzip
import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).with_name("replay")
TARGET = Path(__file__).parents[1] / "mjrun" / "outputs" / "exports" / "replay"
MODULES = SOURCE / "node_modules"
BROWSERS = "chrome94,firefox113,safari16.4"


def source_hash() -> str:
    """Returns the hash of everything that the bundle is made from."""
    digest = hashlib.sha256()
    for path in sorted([*SOURCE.glob("*.js"), *SOURCE.glob("*.css"), SOURCE / "package-lock.json"]):
        digest.update(f"{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def notice() -> str:
    """Returns the comment at the top of the viewer, with the licence of three.js."""
    version = json.loads((MODULES / "three" / "package.json").read_text("utf-8"))["version"]
    licence = (MODULES / "three" / "LICENSE").read_text("utf-8").strip()
    first = f"Replay viewer of mjrun, Apache-2.0. Source: sha256 {source_hash()}"
    return f"/*! {first}\nIt contains three.js {version}:\n\n{licence}\n*/"


def bundle() -> None:
    """Writes the viewer.

    Raises:
      CalledProcessError: npm or esbuild fails.
    """
    subprocess.run(["npm", "ci", "--no-audit", "--no-fund"], cwd=SOURCE, check=True, stdout=sys.stderr)
    TARGET.mkdir(exist_ok=True)
    common = ["--minify", "--legal-comments=none", f"--target={BROWSERS}", "--log-level=warning"]
    bundled = ["--bundle", "--format=iife", "--global-name=replay", f"--banner:js={notice()}"]
    for source, output, options in (
        ("main.js", "viewer.js", bundled),
        ("boot.js", "boot.js", ()),
        ("viewer.css", "viewer.css", ()),
    ):
        command = [MODULES / ".bin" / "esbuild", source, *common, *options, f"--outfile={TARGET / output}"]
        subprocess.run(command, cwd=SOURCE, check=True)
    viewer = TARGET / "viewer.js"
    viewer.with_name("viewer.js.gz").write_bytes(gzip.compress(viewer.read_bytes(), 9, mtime=0))
    viewer.unlink()
    shutil.copy(MODULES / "three" / "LICENSE", TARGET / "LICENSE-three")


if __name__ == "__main__":
    bundle()
