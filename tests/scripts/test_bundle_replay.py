"""The viewer of replays is bundled from its source, which is in the repository."""

import gzip
import runpy
from pathlib import Path

from mjrun.outputs.exports.html import VIEWER

SCRIPT = Path(__file__).parents[2] / "scripts" / "bundle_replay.py"


def test_the_viewer_is_made_from_its_present_source_and_has_the_licence_of_three() -> None:
    script = runpy.run_path(str(SCRIPT))
    notice = gzip.decompress((VIEWER / "viewer.js.gz").read_bytes()).decode().partition("*/")[0]
    assert f"sha256 {script['source_hash']()}\n" in notice, "run scripts/bundle_replay.py"
    assert (VIEWER / "LICENSE-three").read_text("utf-8").strip() in notice
