"""What this user may not read is refused with its name and the reason, whatever the command reads it for."""

import ctypes
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cases import cases
from tests.processes import PATIENCE

MODEL = '<mujoco><include file="{}"/><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody></mujoco>'
# Root reads every file unless the capabilities CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH are taken from it.
UNPRIVILEGED = """
import ctypes, os, sys
for capability in (1, 2):
    ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)
os.execv(sys.executable, [sys.executable, "-m", "mjrun", *sys.argv[1:]])
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    for name in ("secret", "study", "models/below"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "models/fine.xml").write_text("<mujoco/>")
    (tmp_path / "including.xml").write_text(MODEL.format("secret.xml"))
    secrets = [tmp_path / f"secret{suffix}" for suffix in ("", ".xml", ".csv", ".yaml", ".onnx")]
    for path in secrets[1:]:
        path.write_text("<mujoco/>")
    (tmp_path / "study/study.json").write_text("{}")
    secrets += [tmp_path / "study", tmp_path / "models/below"]
    for path in secrets:
        path.chmod(0)
    yield tmp_path
    for path in secrets:
        path.chmod(0o700)


@pytest.mark.skipif(ctypes.CDLL(None).prctl(23, 8, 0, 0, 0) != 1, reason="this user cannot give up capabilities")
@cases("command, code, message")
def test_what_this_user_may_not_read_is_refused_with_the_reason(
    folder: Path, command: str, code: int, message: str
) -> None:
    call = [sys.executable, "-c", UNPRIVILEGED, *command.split()]
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, (done.stderr + done.stdout).splitlines()[0]) == (code, message)
