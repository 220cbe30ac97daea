"""`--controller CODE`: what is found, what is refused, and where its prints go."""

from pathlib import Path

import pytest

MODEL = """
<mujoco>
  <worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>
  <actuator><motor name="m" joint="j"/></actuator>
</mujoco>
"""
CODE = """
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


@pytest.mark.parametrize(
    ("code", "last"),
    [
        ("code/policy.py:act", 0.04),
        ("code.policy:act", None),
        ("code/policy.py:Policy", 1.004),
        ("code/policy.py:Nested.act", 0.04),
    ],
)
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


@pytest.mark.parametrize(
    ("code", "exit_code", "said"),
    [
        ("policy.py", 2, "'policy.py' names no code"),
        ("code/policy.py:", 2, "names no code"),
        ("code/nothing.py:act", 7, "code/nothing.py: there is no such file"),
        ("code:act", 2, "code"),
        ("code/policy.py:akt", 2, "no controller 'akt' in code/policy.py (did you mean 'act'?)"),
        ("code/policy.py:VALUE", 2, "is of type int and cannot be called"),
        ("code/policy.py:one", 2, "the controller one must take (model, data)"),
        ("code/policy.py:Unmade", 2, "raised TypeError"),
        ("code/broken.py:act", 2, "raised ModuleNotFoundError: No module named 'nothing_like_this'"),
        ("code/leaves.py:act", 2, "raised SystemExit"),
        ("code/policy.py:fails", 2, "at step 0, time 0 s, raised RuntimeError: no \\x1b[31mway"),
    ],
)
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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--control-dt", ".1"], "requires --controller"),
        (["--controller", "code/policy.py:act", "--ctrl-from", "x.csv"], "exclude each other"),
        (["--controller", "code/policy.py:act", "--control-dt", "1e-4"], "shorter than the timestep"),
        (["--controller", "code/policy.py:act", "--control-dt", "0"], "not a positive number"),
        (["--ctrl-noise", "-1"], "'-1' is not a number of at least 0"),
        (["--ctrl-interpolation", "cubic"], "not one of"),
    ],
)
def test_options_that_do_not_go_together_are_refused(mjrun_here, policy: Path, options: list[str], said: str) -> None:  # type: ignore[no-untyped-def]
    done = mjrun_here("trace", "m.xml", "--steps", "2", *options)
    assert (done.returncode, done.stdout) == (2, b"")
    assert said in done.stderr.decode()
