"""Each exit code and each class of error through the command line.

A message states what is wrong, where, and what is valid or to be done next: each case lists words for these.
"""

import inspect
import os
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mjrun import errors
from tests.policy.networks import linear
from tests.scoreboard.command import QUICK_IMPORTS, ROOT, CommandServer
from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import CSV, IMPORTS, MODEL, TASK, Content, write
from tests.scoreboard.measure import Tally, measured

KINDS = "kinds.txt"  # the file to which a run writes the classes of the errors that it reports
CALL = "tests.scoreboard.exit_codes:recording"
INPUTS = inputs_of(__name__)
CASES, EXPECTED, ELSEWHERE = INPUTS["CASES"], INPUTS["EXPECTED"], INPUTS["ELSEWHERE"]
MADE: Mapping[str, Content] = {
    "keyframe that is not finite": MODEL.replace("</mujoco>", '<keyframe><key qpos="nan"/></keyframe></mujoco>'),
    "exploding model": MODEL.replace('timestep="0.01"', 'timestep="0.01" gravity="1e14 0 0"'),
    "policy that is not finite": lambda path: linear(path, np.full((1, 1), 0.5, np.float32), bias=np.nan),
    "log of another machine": "time,qpos/hinge\n" + "".join(f"{t},{np.cos(9 * t)}\n" for t in np.arange(100) / 100),
}


def recording(arguments: list[str]) -> int:
    """Runs mjrun, and writes down the classes of the errors that it reports.

    Packages in the folder of the case precede installed ones; the module that the variable WITHOUT names is missing.
    """
    from mjrun.cli.main import run

    sys.path.insert(0, "")
    if missing := os.environ.get("WITHOUT"):
        sys.modules[missing] = None  # type: ignore[assignment]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which the tests may ignore
    spell = errors.MjrunError.spelled

    def spelled(error: errors.MjrunError, spelling: errors.Spelling = str) -> str:
        with Path(KINDS).open("a") as file:
            file.write(f"{type(error).__name__}\n")
        return spell(error, spelling)

    errors.MjrunError.spelled = spelled  # type: ignore[method-assign]
    return run(arguments)


def with_bug(arguments: list[str]) -> int:
    """Runs mjrun with a bug in it."""
    from mjrun.cli.commands import info
    from mjrun.cli.main import run

    def fail(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    info.import_mujoco = fail
    return run(arguments)


def classes() -> set[str]:
    """Returns all classes of mjrun/errors.py."""
    raised = (errors.MjrunError, errors.EndRequestedError)
    return {name for name, each in inspect.getmembers(errors, inspect.isclass) if issubclass(each, raised)}


@measured(
    "every exit code and every error class",
    "reached through the command line; the message says what, where and how to fix",
    25,
)
def exit_codes(quick: bool) -> Tally:
    tally = Tally()
    base: dict[str, Content] = {"m.xml": MODEL, "good.csv": CSV, "task.yaml": TASK}
    imports = QUICK_IMPORTS if quick else IMPORTS
    with tempfile.TemporaryDirectory() as top, CommandServer(limit=120, imports=imports) as server:
        for number, case in enumerate(CASES[::5] if quick else CASES):
            folder = Path(top, str(number))
            folder.mkdir()
            write(folder, {**base, **files_of(case)})
            ended = server.run(
                *shlex.split(case["line"]), folder=folder, environment=case.get("environment"), call=CALL
            )
            kinds = (folder / KINDS).read_text().split() if (folder / KINDS).exists() else []
            error, code = case["error"], case["code"]
            faults = [each for each in ended.faults_unless({code}) if each not in EXPECTED.get(error, ())]
            if ended.code == code:
                faults = [each for each in faults if not each.startswith("exit code")]
            faults += [f"does not say {word!r}" for word in case.get("says", ()) if word not in ended.message]
            if code not in (0, 130, 143) and error not in kinds:
                faults.append(f"is a {', '.join(kinds) or 'nothing'}")
            tally.expect(not faults, f"{error or 'done'}: {'; '.join(faults)}: {ended}")
        if not quick:
            folder = Path(top, "0")
            ended = server.run("info", "m.xml", folder=folder, call="tests.scoreboard.exit_codes:with_bug")
            holds = ended.code == 70 and "a bug in mjrun" in ended.message and "--debug" in ended.message
            tally.expect(holds, f"a bug: {ended}")
            tally.expect(_closed_pipe(folder) == 141, "a reader that is gone: expected code 141")
    missing = sorted(classes() - {case["error"] for case in CASES} - {"ClosedPipeError"} - set(ELSEWHERE))
    tally.expect(not missing, f"classes that no case reaches: {', '.join(missing)}")
    tally.left_out += [f"{name}: {why}" for name, why in ELSEWHERE.items() if name in classes()]
    return tally


def files_of(case: Mapping[str, Mapping[str, str]]) -> dict[str, Content]:
    """Returns the files that a case needs in addition."""
    return {name: MADE.get(content, content) for name, content in case.get("files", {}).items()}


def _closed_pipe(folder: Path) -> int:
    """Returns the exit code of mjrun when the reader of its standard output is gone."""
    command = [sys.executable, "-m", "mjrun", "trace", "m.xml", "--duration", "1000", "--csv"]
    with subprocess.Popen(
        command, cwd=folder, env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout
        process.stdout.readline()
        process.stdout.close()
        return process.wait(120)
