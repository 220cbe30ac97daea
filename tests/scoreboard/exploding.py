"""Simulations that explode: each reported at the step that MuJoCo's own warnings name, and none published.

The reference is a bare loop of `mj_step` on the model as MuJoCo loads it. MuJoCo checks positions and velocities at the
start of a step, so a warning of step k there means that step k - 1 failed; it checks accelerations within the step.
"""

import csv
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import mujoco

from tests.scoreboard.command import QUICK_IMPORTS, CommandServer, Ended, contents
from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import IMPORTS
from tests.scoreboard.measure import Tally, measured

STEPS = 400
STEP = re.compile(r"at step (\d+)")
WARNINGS = ("BADQPOS", "BADQVEL", "BADQACC")

SLIDER = '<body name="arm"><joint name="hinge" type="slide" axis="1 0 0" {}/><geom name="bob" size=".1" {}/></body>'
DRIVEN = '<actuator><general name="motor" joint="hinge" {}/></actuator>'
START = '<keyframe><key name="start" {}/></keyframe>'


def slider(
    joint: str = "",
    option: str = "",
    actuator: str = 'gainprm="1"',
    start: str = 'qpos="0.1" qvel="1"',
    bob: str = 'mass="1"',
) -> str:
    """Returns a mass on a rail, driven by an actuator."""
    world = f"<worldbody>{SLIDER.format(joint, bob)}</worldbody>"
    return f"<mujoco><option {option}/>{world}{DRIVEN.format(actuator)}{START.format(start)}</mujoco>"


def world(bodies: str, option: str = "", more: str = "", start: str = "") -> str:
    """Returns a world with a motor on a joint called `hinge`."""
    actuators = DRIVEN.format('gainprm="1"')
    return f"<mujoco><option {option}/><worldbody>{bodies}</worldbody>{actuators}{more}{START.format(start)}</mujoco>"


INPUTS = inputs_of(__name__)
MODELS = {name: (world if "bodies" in settings else slider)(**settings) for name, settings in INPUTS["MODELS"].items()}
RUN, TASK = INPUTS["RUN"], INPUTS["TASK"]
COMMANDS: dict[str, str] = INPUTS["COMMANDS"]
# Models with a number that is not finite, and the field that the message must name.
NOT_FINITE = {name: (slider(**settings), field) for name, (settings, field) in INPUTS["NOT_FINITE"].items()}


def failing_step(text: str) -> int | None:
    """Returns the first step that fails, by MuJoCo's warnings; None if there is none."""
    log = mujoco.MjLogConfig.get()
    before = log.logto_file, log.logto_console
    log.logto_file = log.logto_console = False
    log.set()
    try:
        return _failing_step(text)
    finally:
        log.logto_file, log.logto_console = before
        log.set()


def _failing_step(text: str) -> int | None:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for step in range(STEPS + 1):
        mujoco.mj_step(model, data)
        position, velocity, acceleration = (
            data.warning[getattr(mujoco.mjtWarning, f"mjWARN_{name}")].number for name in WARNINGS
        )
        if position or velocity:
            return max(0, step - 1)
        if acceleration:
            return step
    return None


@measured(
    "exploding models",
    "reported at the step of MuJoCo's own warnings, exit 4 (a row in studies and evaluations), none published; "
    "numbers that are not finite in a model: exit 3, the field named",
    15,
)
def exploding(quick: bool) -> Tally:
    tally = Tally()
    names = list(MODELS)[::6] if quick else list(MODELS)
    commands = ["trace"] if quick else list(COMMANDS)
    imports = QUICK_IMPORTS if quick else IMPORTS
    with tempfile.TemporaryDirectory() as top, CommandServer(limit=120, imports=imports) as server:
        for number, name in enumerate(names):
            step = failing_step(MODELS[name])
            if step is None or step > STEPS - 1:
                tally.expect(False, f"{name}: does not explode in a bare loop")
                continue
            for command in commands:
                folder = Path(top, f"{number}_{command}")
                faults = _faults(server, folder, MODELS[name], command, step)
                tally.expect(not faults, f"{name}, {command}: {'; '.join(faults)}")
                shutil.rmtree(folder)
        for number, (name, (text, field)) in enumerate(NOT_FINITE.items()):
            for command in commands:
                folder = Path(top, f"nan_{number}_{command}")
                _write(folder, text)
                before = contents(folder)
                ended = server.run(*_line(command, text), folder=folder)
                faults = ended.faults_unless({3})
                faults += [] if field in ended.message else [f"does not name {field}"]
                faults += [f"left {each}" for each in contents(folder) if each not in before]
                tally.expect(not faults, f"{name} that is not finite, {command}: {'; '.join(faults)}: {ended}")
    return tally


def _write(folder: Path, text: str) -> None:
    folder.mkdir()
    (folder / "m.xml").write_text(text)
    timestep = _timestep(text)
    end = round(timestep * STEPS, 6)
    (folder / "run.yaml").write_text(RUN.format(end))
    (folder / "task.yaml").write_text(TASK.format(timestep, end))


def _timestep(text: str) -> float:
    return float((re.search(r'timestep="([^"]+)"', text) or (0, "0.002"))[1])


def _line(command: str, text: str) -> list[str]:
    return COMMANDS[command].replace("{end}", str(round(_timestep(text) * STEPS, 6))).split()


def _faults(server: CommandServer, folder: Path, text: str, command: str, step: int) -> list[str]:
    """Returns the faults of a command on a model that explodes at a step."""
    _write(folder, text)
    before = contents(folder)
    ended = server.run(*_line(command, text), folder=folder)
    after = contents(folder)
    found = [f"{each}: {ended}" for each in ended.faults]
    if command in ("sweep", "eval"):
        return [*found, *_row_faults(ended, folder, command, step)]
    if ended.code != 4:
        found.append(f"expected code 4: {ended}")
    reported = STEP.search(ended.message)
    if not reported or int(reported[1]) != step:
        found.append(f"step {reported[1] if reported else 'none'}, MuJoCo's own is {step}")
    return found + [f"left {name}" for name in after if name not in before]


def _row_faults(ended: Ended, folder: Path, command: str, step: int) -> Iterator[str]:
    """Yields the faults of the rows of a table with exploded points or episodes."""
    if command == "sweep":
        if ended.code != 8:
            yield f"expected code 8: {ended}"
        path = folder / "new" / "results.csv"
        rows = list(csv.DictReader(path.open())) if path.exists() else []
        if len(rows) != 2:
            yield f"{len(rows)} rows"
        for row in rows:
            if (row["status"], float(row["steps"])) != ("unstable", step):
                yield f"a row of status {row['status']} after {row['steps']} steps, MuJoCo's own is {step}"
        return
    if ended.code != 0:  # an episode that explodes was played, and failed
        yield f"expected code 0: {ended}"
    rows = list(csv.DictReader(ended.stdout.decode().splitlines()))
    if [(row["ending"], row["outcome"], row["steps"]) for row in rows] != [("unstable", "failure", str(step + 1))]:
        yield f"MuJoCo's own step is {step}, rows {rows}"
