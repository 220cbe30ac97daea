"""Each exit code and each class of error through the command line: the code, the class, and what the message must say.

A message says what is wrong, where, and what is valid or to be done next: for each case the words that stand for these.
"""

import inspect
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjrun import errors
from tests.policy.networks import linear
from tests.scoreboard.command import ROOT, CommandServer
from tests.scoreboard.data import inputs_of
from tests.scoreboard.document_forms import TASK
from tests.scoreboard.documents import MODEL
from tests.scoreboard.input_forms import IMPORTS, Content, write
from tests.scoreboard.measure import Measure, Tally
from tests.scoreboard.table_forms import CSV

KINDS = "kinds.txt"  # where the classes of the errors that a run tells of are written
CALL = "tests.scoreboard.exit_codes:telling"
EXPLODING = MODEL.replace('timestep="0.01"', 'timestep="0.01" gravity="1e14 0 0"')
SIGNAL = "import os, signal\n\ndef act(model, data):\n    os.kill(os.getpid(), signal.{})\n"
FAILING = "def act(model, data):\n    raise ValueError('no luck')\n"
SWEEP = ("sweep", "m.xml", "--steps", "3", "--metric", "x=last(qpos/hinge)", "--jobs", "1", "-o", "study")
EVAL = ("eval", "task.yaml", "--episodes", "1", "--jobs", "1", "-o", "new", "--policy")
TRACE = ("trace", "m.xml", "--steps", "3")
IMAGE = ("image", "m.xml", "--size", "32x32", "-o", "new.png")


@dataclass(frozen=True)
class Case:
    """A command line, how it must end, and the words that it must say."""

    kind: str
    code: int
    arguments: tuple[str, ...]
    says: tuple[str, ...]
    files: Mapping[str, Content] = field(default_factory=dict[str, Content])
    environment: Mapping[str, str] = field(default_factory=dict[str, str])


def policy(bias: float) -> Content:
    return lambda path: linear(path, np.full((1, 1), 0.5, np.float32), bias=bias)


CASES = (
    Case("", 0, ("info", "m.xml"), ()),
    Case("FailedAssertionError", 1, (*TRACE, "--assert", "max(qpos/hinge) > 9"), ("max(qpos/hinge)", "row 0", "it is")),
    Case("GoldenDifferenceError", 1, (*TRACE, "--golden", "good.csv"), ("good.csv", "--update")),
    Case(
        "UnidentifiableError",
        1,
        ("fit", "m.xml", "good.csv", "--free", "geom/bob.friction[0]=0.1..1", "--starts", "1"),
        ("geom/bob.friction[0]", "--allow-unidentifiable"),
    ),
    Case("UsageError", 2, ("trace", "m.xml", "--steps", "3", "--duration", "1"), ("--steps", "--duration")),
    Case("UnknownNameError", 2, (*TRACE, "--probe", "qpso"), ("qpso", "did you mean", "qpos")),
    Case("BadValueError", 2, (*TRACE, "--set", "opt.timestep=-1"), ("timestep", "-1", "positive")),
    Case(
        "DocumentError",
        2,
        ("run", "bad.yaml"),
        ("bad.yaml:2:1", "duraton", "duration"),
        {"bad.yaml": "model: m.xml\nduraton: 1\n"},
    ),
    Case(
        "ControllerError", 2, (*TRACE, "--controller", "c.py:act"), ("c.py", "no luck", "ValueError"), {"c.py": FAILING}
    ),
    Case(
        "CompiledOverrideError",
        2,
        ("trace", "m.mjb", "--timestep", "0.1"),
        ("m.mjb", "--timestep", ".xml"),
        {"m.mjb": b"x"},
    ),
    Case("ModelNotFoundError", 3, ("trace", "n.xml"), ("n.xml", "no such model", "m.xml")),
    Case("BrokenModelError", 3, ("trace", "b.xml"), ("b.xml:2", "nothing"), {"b.xml": "<mujoco>\n<nothing/></mujoco>"}),
    Case(
        "ModelError",
        3,
        ("trace", "k.xml", "--key", "0"),
        ("keyframe", "finite"),
        {"k.xml": MODEL.replace("</mujoco>", '<keyframe><key qpos="nan"/></keyframe></mujoco>')},
    ),
    Case("UnstableError", 4, ("trace", "e.xml"), ("step 0", "hinge", "--timestep"), {"e.xml": EXPLODING}),
    Case(
        "InvalidActionError",
        4,
        (*EVAL[:1], *EVAL[1:], "p.onnx"),
        ("p.onnx", "step 0", "nan"),
        {"p.onnx": policy(np.nan)},
    ),
    Case("SoftwareRendererError", 5, (*IMAGE, "--require-gpu"), ("--require-gpu", "mjrun doctor")),
    Case(
        "NoRendererError", 5, (*IMAGE, "--gl", "glfw"), ("glfw", "renderer"), {}, {"DISPLAY": "", "WAYLAND_DISPLAY": ""}
    ),
    Case(
        "EncoderError",
        6,
        ("video", "m.xml", "--duration", "0.1", "--size", "32x32", "-o", "v.mp4"),
        ("the encoder failed",),
        {},
        {"IMAGEIO_FFMPEG_EXE": "/bin/false"},
    ),
    Case("FileError", 7, (*TRACE, "--replay", "none.csv"), ("none.csv", "no such file")),
    Case("FileError", 7, (*TRACE, "-o", "/dev/null/new.csv"), ("/dev/null", "not a folder")),
    Case(
        "CellError",
        7,
        ("plot", "cell.csv", "-o", "new.svg", "--y", "qpos/hinge"),
        ("cell.csv:2", "word"),
        {"cell.csv": "time,qpos/hinge\n0,word\n"},
    ),
    Case("FailedPointsError", 8, (*SWEEP, "--vary", "opt.gravity[0]=0,1e14"), ("1 unstable", "2 points")),
    Case("TerminatedError", 143, (*TRACE, "--controller", "c.py:act"), (), {"c.py": SIGNAL.format("SIGTERM")}),
    Case("KeyboardInterrupt", 130, (*TRACE, "--controller", "c.py:act"), (), {"c.py": SIGNAL.format("SIGINT")}),
)
# Of a user's own code the traceback is shown; what is interrupted says nothing more.
INPUTS = inputs_of(__name__)
EXPECTED = INPUTS["EXPECTED"]
# Classes that no command line of a moment can reach, and who reaches them.
ELSEWHERE = INPUTS["ELSEWHERE"]


def telling(arguments: list[str]) -> int:
    """Runs mjrun, and writes down the classes of the errors that it tells of."""
    from mjrun.cli.main import run

    signal.signal(signal.SIGINT, signal.default_int_handler)  # which whoever started the tests may ignore
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
    """All classes of mjrun/errors.py."""
    raised = (errors.MjrunError, errors.EndedFromOutsideError)
    return {name for name, each in inspect.getmembers(errors, inspect.isclass) if issubclass(each, raised)}


def run(quick: bool) -> Tally:
    tally = Tally()
    base: dict[str, Content] = {"m.xml": MODEL, "good.csv": CSV, "task.yaml": TASK}
    with tempfile.TemporaryDirectory() as top, CommandServer(limit=120, imports=IMPORTS) as server:
        for number, case in enumerate(CASES[::5] if quick else CASES):
            folder = Path(top, str(number))
            folder.mkdir()
            write(folder, {**base, **case.files})
            ended = server.run(*case.arguments, folder=folder, environment=case.environment, call=CALL)
            kinds = (folder / KINDS).read_text().split() if (folder / KINDS).exists() else []
            own = EXPECTED.get(case.kind, ())
            found = [each for each in ended.faults if each not in own and not each.startswith("exit code")]
            found += [f"expected code {case.code}"] if ended.code != case.code else []
            found += [f"does not say {word!r}" for word in case.says if word not in ended.message]
            if case.code not in (0, 130, 143) and case.kind not in kinds:
                found.append(f"is a {', '.join(kinds) or 'nothing'}")
            tally.expect(not found, f"{case.kind or 'done'}: {'; '.join(found)}: {ended}")
        if not quick:
            folder = Path(top, "0")
            ended = server.run("info", "m.xml", folder=folder, call="tests.scoreboard.exit_codes:with_bug")
            holds = ended.code == 70 and "a bug in mjrun" in ended.message and "--debug" in ended.message
            tally.expect(holds, f"a bug: {ended}")
            tally.expect(_closed_pipe(folder) == 141, "a reader that is gone: expected code 141")
    reached = {case.kind for case in CASES} | {"ClosedPipeError"}
    missing = sorted(classes() - reached - set(ELSEWHERE))
    tally.expect(not missing, f"classes that nothing reaches: {', '.join(missing)}")
    tally.left_out += [f"{name}: {why}" for name, why in ELSEWHERE.items() if name in classes()]
    return tally


def _closed_pipe(folder: Path) -> int:
    """The exit code of mjrun whose standard output nobody reads any more."""
    command = [sys.executable, "-m", "mjrun", "trace", "m.xml", "--duration", "1000", "--csv"]
    with subprocess.Popen(
        command, cwd=folder, env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout
        process.stdout.readline()
        process.stdout.close()
        return process.wait(120)


MEASURE = Measure(
    "every exit code and every error class",
    "reached through the command line; the message says what, where and how to fix",
    25,
    run,
)
