"""The numbers that MuJoCo's tutorial plots: by mjrun, and by the tutorial's own loops.

The tutorial reads after `mj_step`: the state is then at the end of the step, and what derives from it (energy,
contacts, sensors, accelerations) still at its start. So the tutorial's state number i is row i + 1 of a trace, and its
derived value number i is row i. With RK4 the derived values are of an intermediate stage, and no row's.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from mjrun.errors import UnstableError
from mjrun.outputs.trace import Trace
from mjrun.simulation.simulation import Simulation
from tests.conftest import Command
from tests.documentation import PAGES, ROOT, Execution, commands, commands_in_tables, shell_environment

pytestmark = pytest.mark.slow

Vector = NDArray[np.float64]

PAGE = PAGES[ROOT / "docs/tutorial.md"]
SECTIONS = dict(re.findall(r"^## (.*)\n((?:(?!^## ).*\n)*)", PAGE, re.MULTILINE))
MODEL = next(line for line in commands(PAGE) if line.startswith("echo "))
ELSEWHERE = commands("".join(text for text in PAGES.values() if text != PAGE))  # tests/test_readme.py runs these
# Traces run at full size. What the page says of kicks and timesteps is tested above, by the tutorial's own loops.
# Videos are planned, see tests/test_readme.py.
SMALLER = {
    "image": "--size 64x48 --quality draft",
    "eval": "--episodes 2 --jobs 1",
    "bench": "--budget 0.05",
    "plot": "--size 400x300",
    "sweep": "--jobs 1",
}
SHORTER = {
    r"--duration 10 (-o kicks|--rate 100)": r"--duration 1 \1",
    r"studies/(chaotic_kicks|energy_by_timestep).yaml": r"\g<0> duration=1",
    r"samples=16 duration=1": "samples=4 duration=0.3",
    r"=0.05..0.5:10'": "=0.05..0.5:3'",
    r"--duration 1 (.*) --engine warp": r"--duration 0.02 \1",  # with which tests/study/test_simulate.py sweeps
    r"--camera scenes/cameras/throw.yaml": r"\g<0> --timestep 0.002",  # it looks for the throw at every step
}
ACCURATE = np.power(10, np.linspace(-2, -4, 5)).tolist()  # [s]
DIVERGENT = np.power(10, np.linspace(-2, -1.5, 7)).tolist()  # [s]
SPINS = [2 * np.random.default_rng(seed).standard_normal(3) for seed in (1, 3, 4)]  # [rad/s]
GRAVITY = 9.81
BLOW = 10  # steps in which a blow of the bat is felt
CALM = 150  # steps without the bat before a new blow


def scene(name: str, timestep: float | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Loads a scene, with a timestep set as the tutorial sets it."""
    model = mujoco.MjModel.from_xml_path(str(ROOT / f"scenes/{name}.xml"))
    if timestep is not None:
        model.opt.timestep = timestep
    return model, mujoco.MjData(model)


def trace(tmp_path: Path, simulation: Simulation, *probes: str) -> dict[str, Vector]:
    """Returns every row of a simulation by column, up to its instability if there is one."""
    output = tmp_path / "trace.npz"
    with suppress(UnstableError):
        Trace(simulation, str(output), probe=probes, keep_partial=True).run()
    with np.load(output) as found:
        return dict(found)


def columns(found: dict[str, Vector], group: str, parts: str) -> Vector:
    """Returns the columns `group/part` `(rows, parts)`."""
    return np.column_stack([found[f"{group}/{part}"] for part in parts.split()])


@pytest.fixture(scope="module")
def flip(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Vector]:
    """Seven seconds of the top."""
    simulation = Simulation(ROOT / "scenes/tippe_top.xml", key="spinning", duration=7)
    return trace(tmp_path_factory.mktemp("flip"), simulation, "qvel[top]", "xpos[stem,ball]")


@pytest.fixture(scope="module")
def kicks(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Vector]]:
    """Ten seconds of the chaotic pendulum from eight starts."""
    folder, model = tmp_path_factory.mktemp("kicks"), ROOT / "scenes/chaotic_pendulum.xml"
    starts = [Simulation(model, key="kick", perturb=1e-7, seed=seed, duration=10) for seed in range(1, 9)]
    return [trace(folder, simulation, "qpos", "qvel", "energy") for simulation in starts]


def test_spin_and_stem_of_the_top_are_those_of_the_tutorial_s_loop(flip: dict[str, Vector]) -> None:
    model, data = scene("tippe_top")
    stem, times, angular_velocity, stem_height, instant = model.geom("stem").id, [], [], [], []
    shown = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < 7 - model.opt.timestep / 2:  # the tutorial's own `data.time < 7` takes one step too many
        mujoco.mj_step(model, data)
        times.append(data.time)
        angular_velocity.append(data.qvel[3:6].copy())
        stem_height.append(data.geom_xpos[stem, 2])
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        instant.append(shown.geom_xpos[stem, 2])
    assert flip["time"][1:] == pytest.approx(np.array(times), abs=1e-9)
    assert np.array_equal(columns(flip, "qvel/top", "wx wy wz")[1:], angular_velocity)
    assert np.array_equal(flip["geom_xpos/stem/z"][1:], instant)
    assert flip["geom_xpos/stem/z"][1:] == pytest.approx(np.array(stem_height), abs=2e-4)


def test_the_top_turns_over_and_its_spin_turns_round(flip: dict[str, Vector]) -> None:
    time, stem, spin = flip["time"], flip["geom_xpos/stem/z"], flip["qvel/top/wz"]
    rise = stem - flip["geom_xpos/ball/z"]
    assert rise[0] == pytest.approx(0.02)
    assert (rise[time < 3.6] > 0).all()
    assert (rise[time > 4] < 0).all()
    assert stem[-1] == pytest.approx(0.008, abs=5e-4)  # half the stem's length: it stands on its end
    assert spin[0] == 200
    assert (spin[time < 3.6] > 0).all()
    assert (spin[time > 4] < 0).all()


def test_angle_and_energy_of_eight_kicks_are_those_of_the_tutorial_s_loop(kicks: list[dict[str, Vector]]) -> None:
    model, data = scene("chaotic_pendulum")
    n_steps = int(10 / model.opt.timestep)
    for found in kicks:
        angle, energy = np.zeros(n_steps), np.zeros(n_steps)
        mujoco.mj_resetData(model, data)
        data.qvel[:] = columns(found, "qvel", "root left right low")[0]
        assert 0 < np.abs(data.qvel - [10, 0, 0, 0]).max() < 5e-7
        for i in range(n_steps):
            mujoco.mj_step(model, data)
            angle[i] = data.joint(0).qpos[0]
            energy[i] = data.energy[0] + data.energy[1]
        assert np.array_equal(found["qpos/root"][1:], angle)
        assert np.array_equal(found["energy/total"][:-1], energy)


def test_eight_kicks_that_differ_by_nothing_to_speak_of_part(kicks: list[dict[str, Vector]]) -> None:
    time = kicks[0]["time"]
    spread = np.ptp([found["qpos/root"] for found in kicks], axis=0)
    assert len({found["qvel/root"][0] for found in kicks}) == 8
    assert spread[time <= 2].max() < 1e-4
    assert 1e-4 < spread[time <= 4].max() < 0.1
    assert spread[-1] > 1
    for found in kicks:
        assert np.abs(found["energy/drift"]).max() < 0.5


@pytest.fixture(scope="module")
def energies(tmp_path_factory: pytest.TempPathFactory) -> dict[float, dict[str, Vector]]:
    """Ten seconds of energy by timestep."""
    folder = tmp_path_factory.mktemp("energies")
    models = {dt: scene("chaotic_pendulum", dt)[0] for dt in ACCURATE}
    return {dt: trace(folder, Simulation(models[dt], qvel={"root": 9}, duration=10), "energy") for dt in ACCURATE}


@pytest.mark.parametrize("timestep", ACCURATE)
def test_energy_at_each_timestep_is_that_of_the_tutorial_s_loop(
    timestep: float, energies: dict[float, dict[str, Vector]]
) -> None:
    model, data = scene("chaotic_pendulum", timestep)
    n_steps = int(10 / model.opt.timestep)
    energy = np.zeros(n_steps)
    data.qvel[0] = 9
    for i in range(n_steps):
        mujoco.mj_step(model, data)
        energy[i] = data.energy[0] + data.energy[1]
    assert np.array_equal(energies[timestep]["energy/total"][:n_steps], energy)


@pytest.mark.parametrize("timestep", ACCURATE)
def test_time_at_each_timestep_is_its_multiple_rounded_once(
    timestep: float, energies: dict[float, dict[str, Vector]]
) -> None:
    time, exact = energies[timestep]["time"], Fraction(repr(timestep))
    assert time.tolist() == [float(step * exact) for step in range(len(time))]


def test_energy_drifts_in_proportion_to_the_timestep(energies: dict[float, dict[str, Vector]]) -> None:
    """Euler is of first order: seen before chaos takes over; afterwards within a bound, and decade by decade."""
    drift = {dt: np.abs(found["energy/drift"]) for dt, found in energies.items()}
    early = [drift[dt][: round(2 / dt)].max() / dt for dt in ACCURATE]
    assert early == pytest.approx([early[-1]] * 5, rel=0.2)
    assert all(drift[dt].max() < 300 * dt for dt in ACCURATE)
    ten, one, tenth = (drift[dt].max() for dt in ACCURATE[::2])
    assert ten > 4 * one > 16 * tenth


@pytest.fixture
def warned() -> Iterator[list[str]]:
    """MuJoCo's warnings, caught before they reach its log file."""
    said: list[str] = []
    mujoco.set_mju_user_warning(said.append)
    yield said
    mujoco.set_mju_user_warning(None)


def diverging(timestep: float) -> tuple[int, str, Vector]:
    """Runs the tutorial's loop; returns the step of the warning, its joint, and the speeds before."""
    model, data = scene("chaotic_pendulum", timestep)
    data.qvel[0] = 11
    speed = []
    for i in range(int(10 / timestep)):
        mujoco.mj_step(model, data)
        if data.warning.number.any():
            warning = data.warning[np.flatnonzero(data.warning.number)[0]]
            return i, model.joint(model.dof_jntid[warning.lastinfo]).name, np.array(speed)
        speed.append(np.abs(data.qvel).sum())
    raise AssertionError(f"stable at {timestep} s")


@pytest.mark.filterwarnings("ignore:MuJoCo. Nan, Inf or huge value")
@pytest.mark.parametrize("timestep", DIVERGENT)
def test_divergence_is_reported_where_the_tutorial_s_loop_meets_it(
    timestep: float, tmp_path: Path, warned: list[str]
) -> None:
    step, joint, speed = diverging(timestep)
    simulation = Simulation(scene("chaotic_pendulum", timestep)[0], qvel={"root": 11}, duration=10)
    with pytest.raises(UnstableError, match=f"step {step}, .* acceleration of joint '{joint}'") as caught:
        Trace(simulation, str(tmp_path / "none.npz"), probe=["qvel"]).run()
    assert caught.value.step == step
    assert caught.value.time == pytest.approx(step * timestep)
    assert "QACC" in warned[0]
    assert not (tmp_path / "none.npz").exists()
    kept = columns(trace(tmp_path, simulation, "qvel"), "qvel", "root left right low")
    assert np.array_equal(np.abs(kept[1:]).sum(axis=1), speed)


def test_the_longer_the_timestep_the_fewer_steps_until_divergence(warned: list[str]) -> None:
    steps = [diverging(timestep)[0] for timestep in DIVERGENT]
    assert all(fewer < more for more, fewer in pairwise(steps))
    assert len(warned) == len(steps)


@pytest.mark.parametrize("spin", SPINS)
def test_contacts_of_the_free_body_are_those_of_the_tutorial_s_loop(spin: Vector, tmp_path: Path) -> None:
    n_steps = 499
    model, data = scene("free_body")
    ncon, penetration, force = np.zeros(n_steps), np.zeros(n_steps), np.zeros((n_steps, 3))
    velocity, acceleration, forcetorque = np.zeros((n_steps, model.nv)), np.zeros((n_steps, model.nv)), np.zeros(6)
    data.qvel[3:6] = spin
    for i in range(n_steps):
        mujoco.mj_step(model, data)
        ncon[i] = data.ncon
        velocity[i] = data.qvel[:]
        acceleration[i] = data.qacc[:]
        for j, c in enumerate(data.contact):
            mujoco.mj_contactForce(model, data, j, forcetorque)
            force[i] += forcetorque[0:3]
            penetration[i] = min(penetration[i], c.dist)
    simulation = Simulation(ROOT / "scenes/free_body.xml", qvel={"free": [0, 0, 0, *spin.tolist()]}, steps=n_steps)
    found = trace(tmp_path, simulation, "contact", "contact_force", "penetration", "qvel", "qacc")
    parts = "vx vy vz wx wy wz"
    assert ncon.max() >= 3
    assert np.array_equal(found["contact/ncon"][:-1], ncon)
    assert np.array_equal(found["penetration/deepest"][:-1], -penetration)
    assert np.array_equal(columns(found, "qvel/free", parts)[1:], velocity)
    assert np.array_equal(columns(found, "qacc/free", parts)[:-1], acceleration)
    assert np.array_equal(found["contact_force/normal/z"][:-1], force[:, 0])
    # The tutorial's friction is in the contacts' frame, a trace's in the world: their lengths agree.
    friction = np.linalg.norm(columns(found, "contact_force/friction", "x y z"), axis=1)
    assert friction[:-1] == pytest.approx(np.linalg.norm(force[:, 1:], axis=1), rel=1e-9)


@pytest.mark.parametrize("spin", SPINS)
def test_contact_forces_of_the_free_body_are_all_that_holds_it_and_settle_at_its_weight(
    spin: Vector, tmp_path: Path
) -> None:
    simulation = Simulation(ROOT / "scenes/free_body.xml", qvel={"free": [0, 0, 0, *spin.tolist()]}, duration=3)
    found = trace(tmp_path, simulation, "contact_force", "qfrc_constraint")
    force = columns(found, "contact_force/normal", "x y z") + columns(found, "contact_force/friction", "x y z")
    assert force == pytest.approx(columns(found, "qfrc_constraint/free", "vx vy vz"), rel=1e-9, abs=1e-9)
    weight = scene("free_body")[0].body("box_and_sphere").mass.item() * GRAVITY
    assert found["contact_force/normal/z"].max() > 10 * weight
    assert force[-1] == pytest.approx(np.array([0, 0, weight]), abs=1e-6)


def test_the_mean_contact_force_from_rest_to_rest_is_the_weight(tmp_path: Path) -> None:
    """The impulse theorem, summed step by step."""
    found = trace(tmp_path, Simulation(ROOT / "scenes/free_body.xml", duration=3), "contact_force")
    weight = scene("free_body")[0].body("box_and_sphere").mass.item() * GRAVITY
    assert found["contact_force/normal/z"][:-1].mean() == pytest.approx(weight, rel=1e-6)


def test_the_pinata_s_accelerometer_reads_as_in_the_tutorial_s_loop_and_feels_each_blow(tmp_path: Path) -> None:
    fps = 60.0
    model, data = scene("pinata")
    bat, pinata = model.body("bat").id, model.body("box_and_sphere").id
    times, sensordata, struck = [], [], []
    data.ctrl = 20
    for i in range(180):
        while data.time < i / fps:
            mujoco.mj_step(model, data)
            times.append(data.time)
            sensordata.append(data.sensor("accelerometer").data.copy())
            touching = [{model.geom_bodyid[c.geom1], model.geom_bodyid[c.geom2]} for c in data.contact]
            struck.append({bat, pinata} in touching)
    simulation = Simulation(ROOT / "scenes/pinata.xml", ctrl={"my_motor": 20}, steps=len(times))
    found = trace(tmp_path, simulation, "sensor")
    assert found["time"][1:] == pytest.approx(np.array(times), abs=1e-9)
    assert np.array_equal(columns(found, "sensor/accelerometer", "x y z")[:-1], sensordata)
    felt = np.linalg.norm(sensordata, axis=1)
    blows = [i for i in np.flatnonzero(struck) if not any(struck[i - CALM : i])]
    assert len(blows) >= 2
    for i in blows:
        assert felt[i : i + BLOW].max() > max(1.5 * felt[i - 1], 3 * GRAVITY)
    assert np.median(felt) < 2 * GRAVITY


@pytest.mark.gl
@pytest.mark.parametrize("title", SECTIONS)
def test_commands_of_a_section_do_what_it_states(
    title: str, mjrun_here: Command, tmp_path: Path, plain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    execute = Execution(tmp_path, mjrun_here, shell_environment(tmp_path, SMALLER, plain), SMALLER)
    assert execute.in_shell(MODEL).returncode == 0
    text = " ".join(SECTIONS[title].split())
    shorter = SECTIONS[title]
    for long, short in SHORTER.items():
        shorter = re.sub(long, short, shorter)

    for command in (*commands(shorter), *commands_in_tables(shorter)):
        if command in ELSEWHERE or command.startswith(("mjrun view", "mjrun fit scenes/pendulum_fit.yaml -o ")):
            continue  # tests/test_readme.py opens the view, tests/test_gallery.py fits this document
        command, _, expected_to_fail = command.partition("||")
        done = execute.planned(command) if command.startswith("mjrun video") else execute(command)

        if expected_to_fail:
            assert f"the exit code is {done.returncode}" in text
        else:
            assert (done.returncode, "error" in done.stderr) == (0, False), f"{command}\n{done.stderr}"
        if done.returncode == 4:
            ((step, time, joint),) = re.findall(
                r"step (\d+), time ([\d.]+) s: the acceleration of joint '(\w+)'", done.stderr
            )
            assert f"the acceleration of `{joint}` becomes invalid at step {step} ({time} s)" in text
        for output in re.findall(r" (?:-o|--calibration|--pointcloud) ([^\s;]+)", command):
            assert (tmp_path / output).exists() or expected_to_fail or command.startswith("mjrun video"), command


def test_the_page_has_a_command_for_every_scene_of_the_notebook() -> None:
    shown = {name for command in commands(PAGE) for name in re.findall(r"scenes/(\w+)\.xml", command)}
    plotted = {"tippe_top", "chaotic_pendulum", "free_body", "pinata"}
    assert shown == {*plotted, "swing", "friction_ramp", "humanoid", "dominos"}
