"""`--controller CODE`: what is found, what is refused, and where its prints go."""

from pathlib import Path

import pandas as pd
import pytest

from tests.cases import cases

MODEL = """
<mujoco>
  <worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>
  <actuator><motor name="m" joint="j"/></actuator>
</mujoco>
"""
CODE = """
import gc
import helper_of_policy
from dataclasses import dataclass

VALUE = 3

def act(model, data):
    print("acting")
    return helper_of_policy.GAIN * data.time

class Policy:
    def reset(self, model, data):
        print("resetting")
        self.at = model.nu
    def __call__(self, model, data):
        data.ctrl[0] = self.at + data.time

class Nested:
    act = staticmethod(act)

def fails(model, data):
    deep(data)

def deep(data):
    raise RuntimeError("no \\x1b[31mway")

class Unmade:
    def __init__(self, needed):
        pass

def one(data):
    pass

def collected(model, data):
    data.ctrl[0] = gc.isenabled() and gc.get_threshold()[0]
"""


@pytest.fixture
def policy(mjrun, tmp_path: Path) -> Path:  # type: ignore[no-untyped-def]
    (mjrun.folder / "m.xml").write_text(MODEL)
    (mjrun.folder / "code").mkdir()
    (mjrun.folder / "code/policy.py").write_text(CODE)
    (mjrun.folder / "code/helper_of_policy.py").write_text("GAIN = 10")
    (mjrun.folder / "code/broken.py").write_text("import nothing_like_this\n")
    (mjrun.folder / "code/leaves.py").write_text("raise SystemExit(0)\n")
    return mjrun.folder / "code/policy.py"


@cases("code, last")
def test_code_drives_and_does_not_print_into_the_payload(mjrun, policy: Path, code: str, last: float | None) -> None:  # type: ignore[no-untyped-def]
    if last is None:  # a module is found from the working directory, and so is what it imports
        (mjrun.folder / "helper_of_policy.py").write_text("GAIN = 10")
        (mjrun.folder / "code").rename(mjrun.folder / "policies")
        code, last = "policies.policy:act", 0.04
    done = mjrun("trace", "m.xml", "--steps", "2", "--probe", "ctrl", "--controller", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.decode().splitlines()[0] == "time,ctrl/m"
    assert float(done.stdout.decode().splitlines()[-1].split(",")[1]) == pytest.approx(last)
    assert set(done.stderr.decode().split()) <= {"acting", "resetting"}
    assert done.stderr


@cases("code, exit_code, said")
def test_code_that_cannot_drive_is_refused(mjrun_here, policy: Path, code: str, exit_code: int, said: str) -> None:  # type: ignore[no-untyped-def]
    done = mjrun_here("trace", "m.xml", "--steps", "2", "-o", "t.csv", "--controller", code)
    text = done.stderr.decode()
    assert (done.returncode, done.stdout) == (exit_code, b""), text
    assert said in text
    assert text.startswith("mjrun: error: ")
    assert "t.csv" not in mjrun_here.files()


def test_a_failing_controller_shows_its_own_traceback_and_nothing_of_mjrun(mjrun_here, policy: Path) -> None:  # type: ignore[no-untyped-def]
    done = mjrun_here("trace", "m.xml", "--steps", "2", "--controller", "code/policy.py:fails")
    text = done.stderr.decode()
    assert "Traceback (most recent call last):" in text
    assert "in fails" in text
    assert "in deep" in text
    assert "mjrun/" not in text.replace("mjrun: error", "")


@cases("options, said")
def test_options_that_do_not_go_together_are_refused(mjrun_here, policy: Path, options: list[str], said: str) -> None:  # type: ignore[no-untyped-def]
    done = mjrun_here("trace", "m.xml", "--steps", "2", *options)
    assert (done.returncode, done.stdout) == (2, b"")
    assert said in done.stderr.decode()


def test_garbage_of_a_controller_is_collected_as_usual(mjrun, policy: Path) -> None:  # type: ignore[no-untyped-def]
    code = f"{policy}:collected"
    done = mjrun("trace", "m.xml", "--steps", "1", "--probe", "ctrl", "--controller", code)
    assert 0 < float(done.stdout.decode().splitlines()[-1].split(",")[1]) < 10_000, done.stderr
    metric = "often=last(ctrl/m)"
    mjrun("sweep", "m.xml", "--steps", "1", "--vary", f"controller={code}", "--metric", metric, "-o", "study")
    often = pd.read_csv(mjrun.folder / "study" / "results.csv").loc[0, "often"]
    assert 0 < float(often) < 10_000
