"""Simulations that explode: each reported at the step that MuJoCo's own warnings name, and none published.

The oracle is a bare loop of `mj_step` on a model as MuJoCo loads it. MuJoCo looks at positions and velocities at the
start of a step, so that a warning of step k there means that step k - 1 went wrong; at accelerations within it.
"""

import csv
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import mujoco

from tests.scoreboard.command import CommandServer, Ended
from tests.scoreboard.input_forms import IMPORTS, contents
from tests.scoreboard.measure import Measure, Tally

STEPS = 400
STEP = re.compile(r"at step (\d+)")
WARNINGS = ("BADQPOS", "BADQVEL", "BADQACC")

SLIDER = (
    '<body name="arm"><joint name="hinge" type="slide" axis="1 0 0" {}/><geom name="bob" size=".1" mass="1"/></body>'
)
DRIVEN = '<actuator><general name="motor" joint="hinge" {}/></actuator>'
START = '<keyframe><key name="start" {}/></keyframe>'


def slider(joint: str = "", option: str = "", actuator: str = 'gainprm="1"', start: str = 'qpos="0.1" qvel="1"') -> str:
    """A mass on a rail, driven by an actuator."""
    world = f"<worldbody>{SLIDER.format(joint)}</worldbody>"
    return f"<mujoco><option {option}/>{world}{DRIVEN.format(actuator)}{START.format(start)}</mujoco>"


def world(bodies: str, option: str = "", more: str = "", start: str = "") -> str:
    """A world with a motor on a joint that is called `hinge`."""
    actuators = DRIVEN.format('gainprm="1"')
    return f"<mujoco><option {option}/><worldbody>{bodies}</worldbody>{actuators}{more}{START.format(start)}</mujoco>"


FREE = '<body name="arm"><joint name="hinge" type="free"/><geom name="bob" size=".1" mass="1"/></body>'.replace(
    'type="free"', 'type="slide" axis="0 0 1"'
)
MODELS = {
    "a spring too stiff for its timestep": slider('stiffness="1e6"', 'timestep="0.02" integrator="Euler"'),
    "the same with RK4": slider('stiffness="1e7"', 'timestep="0.02" integrator="RK4"'),
    "a spring that pushes": slider(
        option='timestep="0.01"', actuator='gainprm="0" biastype="affine" biasprm="0 1e5 0"'
    ),
    "a damper that drives": slider('damping="-300"', 'timestep="0.01" integrator="RK4"'),
    "the same, implicit": slider(
        option='timestep="0.01" integrator="implicitfast"', actuator='gainprm="0" biastype="affine" biasprm="0 1e6 0"'
    ),
    "a servo of late answers": slider(
        option='timestep="0.05"', actuator='gainprm="1e7" biastype="affine" biasprm="0 -1e7 0"'
    ),
    "gravity of 1e13": slider(option='gravity="1e13 0 0"'),
    "gravity of 1e11": slider(option='gravity="1e11 0 0"'),
    "wind of 1e8": slider(option='density="1e5" wind="1e8 0 0" timestep="0.01"'),
    "drag too stiff for its timestep": slider(option='density="1e7" timestep="0.1"', start='qvel="1e4"'),
    "a start near the limit": slider(start='qvel="9.9e9"', actuator='gainprm="1" biastype="affine" biasprm="1e9 0 0"'),
    "a position near the limit": slider(start='qpos="9.99e9" qvel="1e8"'),
    "a force of 1e8 that grows": slider(
        actuator='gainprm="0" biastype="affine" biasprm="1e8 1e3 0"', option='timestep="0.01" integrator="Euler"'
    ),
    "an actuator of second thoughts": slider(
        actuator='dyntype="filter" dynprm="0.01" gainprm="1e9" biastype="affine" biasprm="1e6 0 10"', start='act="1"'
    ),
    "contacts as stiff as can be": world(
        f'<geom type="plane" size="9 9 1"/>{FREE}'.replace("<geom name", '<geom solref="-1e15 0" name'),
        'timestep="0.02"',
        start='qpos="0.05"',
    ),
    "a limit as stiff as can be": slider(
        'range="-0.01 0.01" limited="true" solreflimit="-1e14 0"', 'timestep="0.02"', start='qpos="0.02"'
    ),
    "a tendon too stiff": world(
        SLIDER.format(""),
        'timestep="0.05"',
        '<tendon><fixed name="wire" stiffness="1e6" springlength="0"><joint joint="hinge" coef="1"/></fixed></tendon>',
        'qpos="0.1"',
    ),
    "a mass of 1e-9 under a motor": slider(
        actuator='gainprm="0" biastype="affine" biasprm="1 1 0"', option='timestep="0.01"'
    ).replace('mass="1"', 'mass="1e-9"'),
    "a chain that whips": world(
        '<body name="arm"><joint name="hinge" axis="0 1 0" stiffness="1e5"/><geom name="bob" size=".1" pos="1 0 0"/>'
        '<body pos="1 0 0"><joint axis="0 1 0" stiffness="1e5"/><geom size=".01" pos=".1 0 0"/></body></body>',
        'timestep="0.05"',
        start='qpos="0.1 -0.2"',
    ),
    "a gyroscope of 1e9 rad/s": world(
        '<body name="arm"><joint name="hinge" axis="0 1 0"/><joint axis="1 0 0"/><joint axis="0 0 1"/>'
        '<geom name="bob" type="box" size=".1 .2 .3"/></body>',
        'timestep="0.05"',
        start='qvel="1e8 1e9 1e7"',
    ),
}
RUN = "model: m.xml\nkey: start\nsteps: 400\ntraces: [new.csv]\nimages: [{{output: new.png, time: {}, size: 32x32}}]\n"
TASK = """model: m.xml
control_dt: {}
duration: {}
reset: {{key: start}}
observations: [{{name: place, probe: qpos/hinge}}]
actions: [{{actuators: motor}}]
rewards: {{one: 0*qpos/hinge + 1}}
"""
SIZE = ("--size", "32x32")
COMMANDS = {
    "trace": ("trace", "m.xml", "--key", "start", "--steps", str(STEPS), "-o", "new.csv", "--recording", "new.npz"),
    "video": ("video", "m.xml", "--key", "start", "--steps", str(STEPS), "-o", "new.mp4", *SIZE),
    "image": ("image", "m.xml", "--key", "start", "--time", "{}", "-o", "new.png", *SIZE),
    "run": ("run", "run.yaml"),
}
# Numbers in a model's physics that are not finite: the field that the message must name.
NOT_FINITE = {
    "gravity": (slider(option='gravity="0 0 nan"'), "opt.gravity"),
    "wind": (slider(option='wind="nan 0 0"'), "opt.wind"),
    "density": (slider(option='density="inf"'), "opt.density"),
    "viscosity": (slider(option='viscosity="nan"'), "opt.viscosity"),
    "damping": (slider('damping="nan"'), "dof_damping"),
    "stiffness": (slider('stiffness="inf"'), "jnt_stiffness"),
    "armature": (slider('armature="nan"'), "dof_armature"),
    "friction loss": (slider('frictionloss="nan"'), "dof_frictionloss"),
    "mass": (slider().replace('mass="1"', 'mass="inf"'), "body_"),
    "friction": (slider().replace('mass="1"', 'mass="1" friction="nan"'), "geom_friction"),
    "gain": (slider(actuator='gainprm="nan"'), "actuator_gainprm"),
    "gear": (slider(actuator='gainprm="1" gear="inf"'), "actuator_gear"),
}


def failing_step(text: str) -> int | None:
    """The first step that cannot be taken, as MuJoCo's warnings say."""
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


def run(quick: bool) -> Tally:
    tally = Tally()
    names = list(MODELS)[::6] if quick else list(MODELS)
    with tempfile.TemporaryDirectory() as top, CommandServer(limit=120, imports=IMPORTS) as server:
        for number, name in enumerate(names):
            step = failing_step(MODELS[name])
            if step is None or step > STEPS - 1:
                tally.expect(False, f"{name}: does not explode in a bare loop")
                continue
            commands = ["trace"] if quick else [*COMMANDS, "sweep", "eval"]
            for command in commands:
                folder = Path(top, f"{number}_{command}")
                found = _faults(server, folder, MODELS[name], command, step)
                tally.expect(not found, f"{name}, {command}: {'; '.join(found)}")
                shutil.rmtree(folder)
        for number, (name, (text, field)) in enumerate(NOT_FINITE.items()):
            for command in ["trace"] if quick else [*COMMANDS, "sweep", "eval"]:
                folder = Path(top, f"nan_{number}_{command}")
                _write(folder, text)
                before = contents(folder)
                ended = server.run(*_line(command, text), folder=folder)
                found = [*ended.faults, *([] if ended.code == 3 else ["expected code 3"])]
                found += [] if field in ended.message else [f"does not say {field}"]
                found += [f"left {each}" for each in contents(folder) if each not in before]
                tally.expect(not found, f"{name} that is not finite, {command}: {'; '.join(found)}: {ended}")
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


def _line(command: str, text: str) -> tuple[str, ...]:
    if command == "sweep":
        line = (
            "sweep",
            "m.xml",
            "--key",
            "start",
            "--steps",
            str(STEPS),
            "--vary",
            "seed=1,2",
            "--jobs",
            "1",
            "--chunk",
            "1",
        )
        return (*line, "--metric", "x=last(qpos/hinge)", "-o", "new")
    if command == "eval":
        return ("eval", "task.yaml", "--policy", "zero", "--episodes", "1", "--jobs", "1", "-o", "new", "--csv")
    return tuple(word.format(round(_timestep(text) * STEPS, 6)) for word in COMMANDS[command])


def _faults(server: CommandServer, folder: Path, text: str, command: str, step: int) -> list[str]:
    """What a command does wrong with a model that explodes at a step."""
    _write(folder, text)
    before = contents(folder)
    ended = server.run(*_line(command, text), folder=folder)
    after = contents(folder)
    found = [f"{each}: {ended}" for each in ended.faults]
    if command in ("sweep", "eval"):
        return [*found, *_row_faults(ended, folder, command, step)]
    if ended.code != 4:
        found.append(f"expected code 4: {ended}")
    told = STEP.search(ended.message)
    if not told or int(told[1]) != step:
        found.append(f"step {told[1] if told else 'none'}, MuJoCo's own is {step}")
    return found + [f"left {name}" for name in after if name not in before]


def _row_faults(ended: Ended, folder: Path, command: str, step: int) -> Iterator[str]:
    """What is wrong with the rows of a table that holds what has exploded."""
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
    if ended.code != 0:  # an episode that explodes is one that was played, and failed
        yield f"expected code 0: {ended}"
    rows = list(csv.DictReader(ended.stdout.decode().splitlines()))
    if [(row["ending"], row["outcome"], row["steps"]) for row in rows] != [("unstable", "failure", str(step + 1))]:
        yield f"MuJoCo's own step is {step}, rows {rows}"


MEASURE = Measure(
    "exploding models",
    "reported at the step of MuJoCo's own warnings, exit 4 (a row in studies and evaluations), none published; "
    "numbers that are not finite in a model: exit 3, the field named",
    15,
    run,
)
