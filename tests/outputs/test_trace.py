"""Whole traces, against bare loops and closed forms."""

import csv
import json
import warnings
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjrun.errors import ContactMemoryError, FailedAssertionError, MjrunError, UnstableError, UsageError, spelled
from mjrun.outputs.trace import Trace, columns
from mjrun.outputs.trace_rows import TIME
from mjrun.simulation.simulation import Simulation
from tests.cases import cases
from tests.reporters import RecordingReporter

SCENES = Path(__file__).parents[2] / "scenes"
FALL = '<mujoco><worldbody><body name="b" pos="0 0 9"><freejoint/><geom size=".1"/></body></worldbody></mujoco>'


def trace(tmp_path: Path, simulation: Simulation, **how: object) -> dict[str, np.ndarray]:
    """A trace to CSV, read back by the csv module: columns by name."""
    output = tmp_path / "t.csv"
    Trace(simulation, str(output), **how).run()  # type: ignore[arg-type]
    with output.open(newline="") as file:
        header, *rows = csv.reader(file)
    return dict(zip(header, np.array(rows, float).T, strict=True))


def test_a_pendulum_s_trace_is_a_bare_loop_to_the_last_bit(tmp_path: Path) -> None:
    found = trace(tmp_path, Simulation(SCENES / "pendulum.xml", key="level", duration=2, ctrl={"*": 0.5}))
    model = mujoco.MjModel.from_xml_path(str(SCENES / "pendulum.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("level").id)
    data.ctrl[:] = 0.5
    steps = round(2 / model.opt.timestep)
    joint = model.joint(0).name
    for step in range(steps + 1):
        shown = mujoco.MjData(model)
        mujoco.mj_copyData(shown, model, data)
        mujoco.mj_forward(model, shown)
        assert found[f"qpos/{joint}"][step] == shown.qpos[0]
        assert found[f"qvel/{joint}"][step] == shown.qvel[0]
        assert found["energy/potential"][step] == shown.energy[0]
        assert found["energy/kinetic"][step] == shown.energy[1]
        mujoco.mj_step(model, data)
    assert len(found["time"]) == steps + 1


@pytest.mark.parametrize(
    ("how", "steps"),
    [
        ({}, list(range(101))),
        ({"every": 7}, [*range(0, 101, 7), 100]),
        ({"every": 50}, [0, 50, 100]),
        ({"rate": 100}, list(range(0, 101, 5))),
        ({"rate": 60}, [0, 8, 17, 25, 33, 42, 50, 58, 67, 75, 83, 92, 100]),
        ({"probe": ["qpos", "contact_force"], "every": 7}, [*range(0, 101, 7), 100]),
    ],
)
def test_rows_fall_on_their_steps_whatever_reads_them(tmp_path: Path, how: dict, steps: list[int]) -> None:
    simulation = Simulation(SCENES / "free_body.xml", key="tumble", steps=100)
    dense = trace(tmp_path, simulation, probe=["qpos"])
    found = trace(tmp_path, simulation, **{"probe": ["qpos"], **how})
    assert [round(t / 0.002) for t in found["time"]] == steps
    for name, values in dense.items():
        assert np.array_equal(found[name], values[steps])


def test_tracing_does_not_change_the_motion(tmp_path: Path) -> None:
    simulation = Simulation(SCENES / "humanoid.xml", key="jump", steps=300)
    few = trace(tmp_path, simulation, probe=["qpos"], every=300)
    many = trace(tmp_path, simulation, probe=["qpos", "energy", "contact_force", "momentum"])
    for name in few:
        assert few[name][-1] == many[name][-1]


def test_a_controller_that_senses_kinetic_energy_does_not_depend_on_what_is_measured(tmp_path: Path) -> None:
    sensed = SLIDE.replace("</mujoco>", '<sensor><e_kinetic name="all"/></sensor></mujoco>')
    model = mujoco.MjModel.from_xml_string(sensed)

    def act(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
        return [data.sensor("all").data[0] + 0.5, 0.1]

    simulation = Simulation(model, steps=60, controller=act)
    plain = trace(tmp_path, simulation, probe=["qpos", "ctrl"])
    for probes in (["energy"], ["sensor"], ["energy", "cacc"]):
        found = trace(tmp_path, simulation, probe=["qpos", "ctrl", *probes])
        assert all(np.array_equal(found[name], plain[name]) for name in plain)


LAZY = {
    "cfrc_ext": mujoco.mj_rnePostConstraint,
    "cfrc_int": mujoco.mj_rnePostConstraint,
    "cacc": mujoco.mj_rnePostConstraint,
    "subtree_linvel": mujoco.mj_subtreeVel,
    "subtree_angmom": mujoco.mj_subtreeVel,
    "qfrc_inverse": mujoco.mj_inverse,
}


def push(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
    data.xfrc_applied[2] = [0, 1, 2, 3, 4, 5 * np.sin(9 * data.time)]
    return [0.5 - data.qvel[6], data.time]


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast", "discrete"])
def test_fields_that_a_step_leaves_out_are_those_of_a_bare_loop_and_the_motion_is_the_same(
    tmp_path: Path, integrator: str
) -> None:
    model = mujoco.MjModel.from_xml_string(
        SLIDE.replace("<worldbody>", f'<option integrator="{integrator}"/><worldbody>')
    )
    simulation = Simulation(model, steps=60, controller=push, control_dt="0.004")
    plain = trace(tmp_path, simulation, probe=["qpos", "qvel", "ctrl"])
    found = trace(tmp_path, simulation, probe=["qpos", "qvel", "ctrl", *LAZY])
    assert all(np.array_equal(found[name], plain[name]) for name in plain)
    columns = {field: [name for name in found if name.startswith(f"{field}/")] for field in LAZY}
    data, shown = mujoco.MjData(model), mujoco.MjData(model)
    for step in range(61):
        mujoco.mj_copyData(shown, model, data)
        if step % 2 == 0:
            mujoco.mj_forward(model, shown)
            data.ctrl[:] = push(model, shown)
            data.xfrc_applied[:] = shown.xfrc_applied
        for field, complete in LAZY.items():
            mujoco.mj_copyData(shown, model, data)
            mujoco.mj_forward(model, shown)
            complete(model, shown)
            assert [found[name][step] for name in columns[field]] == list(getattr(shown, field).ravel()), field
        mujoco.mj_step(model, data)
    assert all(any(found[name].any() for name in names) for names in columns.values())


def test_time_may_be_asked_for_and_is_there_once(tmp_path: Path) -> None:
    simulation = Simulation(SLIDE_MODEL, steps=3)
    assert list(trace(tmp_path, simulation, probe=["time", "qpos[h]"])) == ["time", "qpos/h"]
    alone = trace(tmp_path, simulation, probe=["time"])
    assert {name: list(values) for name, values in alone.items()} == {"time": [0, 0.002, 0.004, 0.006]}


@pytest.mark.parametrize(("timestep", "last"), [("0.03", 0.09), ("2", 0.0)])
def test_the_simulated_time_is_that_of_the_last_row(tmp_path: Path, timestep: str, last: float) -> None:
    result = Trace(
        Simulation(SCENES / "pendulum.xml", duration="0.1", timestep=timestep), str(tmp_path / "t.csv")
    ).run()
    *_, row = (tmp_path / "t.csv").read_text().splitlines()
    assert (result.simulated, float(row.split(",")[0])) == (last, last)


@pytest.mark.parametrize(("rate", "told"), [(3000, True), ("500.1", True), (500, False), (60, False), (None, False)])
def test_a_rate_above_that_of_the_steps_is_reported(tmp_path: Path, rate: float | None, told: bool) -> None:
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        found = trace(tmp_path, Simulation(SLIDE_MODEL, steps=10), probe=["qpos"], rate=rate)
    said = f"rate {rate} exceeds the 500 steps of a simulated second: each step gives one row"
    assert [said in str(warning.message) for warning in heard] == [True] * told
    if told:
        assert len(found["time"]) == 11


def test_an_assertion_speaks_of_columns_as_events_do(tmp_path: Path) -> None:
    simulation, output = Simulation(SLIDE_MODEL, steps=3), str(tmp_path / "t.csv")
    Trace(simulation, output, probe=["speed[bob]"], assert_=["max(speed(bob)) < 1"]).run()
    with pytest.raises(UsageError, match="add probe speed/bob"):
        Trace(simulation, output, assert_=["max(speed(bob)) < 1"]).run()


def test_the_same_trace_has_the_same_bytes(tmp_path: Path) -> None:
    simulation = Simulation(SCENES / "chaotic_pendulum.xml", key="kick", duration=1, perturb=1e-7, seed=3)
    for name in ("a.csv", "b.csv"):
        Trace(simulation, str(tmp_path / name)).run()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@pytest.mark.parametrize("probes", [("qpos",), ("qpos", "contact_force")])
def test_an_unstable_trace_leaves_nothing_unless_it_is_asked_to(
    exploding: Path, tmp_path: Path, probes: tuple[str, ...]
) -> None:
    simulation, output = Simulation(exploding, key="fast", duration=3), tmp_path / "t.csv"
    output.write_text("old")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(UnstableError) as caught:
        Trace(simulation, str(output), probe=probes, units="metadata").run()
    assert sorted(tmp_path.iterdir()) == before
    assert output.read_text() == "old"
    with pytest.raises(UnstableError):
        Trace(simulation, str(output), probe=probes, keep_partial=True).run()
    rows = output.read_text().splitlines()[1:]
    assert len(rows) >= caught.value.step
    assert all(abs(float(number)) < 1e10 for row in rows for number in row.split(","))


def test_the_files_of_units_are_outputs(tmp_path: Path) -> None:
    simulation, output = Simulation(SCENES / "pendulum.xml", duration=0.01), tmp_path / "t.csv"
    job = Trace(simulation, str(output), contacts=str(tmp_path / "c.csv"), units="metadata", manifest=f"{output}.json")
    job.run()
    written = {Path(each["path"]).name for each in json.loads((tmp_path / "t.csv.json").read_text())["outputs"]}
    assert written == {"t.csv", "c.csv", "t.csv-metadata.json", "c.csv-metadata.json"}
    assert {Path(path) for _, path in job.files} == set(tmp_path.iterdir())


def test_an_assertion_that_holds_passes_and_one_that_does_not_fails_with_its_row(tmp_path: Path) -> None:
    simulation = Simulation(SCENES / "pendulum.xml", key="level", duration=1)
    result = Trace(simulation, str(tmp_path / "t.csv"), assert_=["last(time) == 1", "max(abs(energy/drift)) < 1"]).run()
    assert len(result.assertions) == 2
    with pytest.raises(FailedAssertionError, match="row 0") as caught:
        Trace(simulation, str(tmp_path / "t.csv"), assert_=["first(time) > 0"]).run()
    assert caught.value.exit_code == 1


@cases("wrong")
def test_what_is_wrong_is_refused_before_the_first_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: dict
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MjrunError) as caught:
        Trace(**{"simulation": Simulation(SCENES / "swing.xml"), "output": "t.csv", **wrong}).run()
    assert caught.value.exit_code in (2, 7)
    assert list(tmp_path.iterdir()) == []


def test_warnings_of_mujoco_are_reported_and_no_log_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = """<mujoco><worldbody><body><joint name="j"/><geom size=".1" pos=".2 0 0"/></body></worldbody>
<actuator><motor joint="j"/></actuator></mujoco>"""
    (tmp_path / "wild.xml").write_text(text)
    with pytest.warns(UserWarning, match="MuJoCo: .* CTRL"):
        result = Trace(Simulation("wild.xml", controller=lambda model, data: 1e11, steps=5), "t.csv").run()
    assert result.warnings
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.csv", "wild.xml"]


@pytest.mark.parametrize("probe", ["qpos", "contact_force"])  # stepped in C, and read instant by instant
def test_a_trace_without_some_of_its_contacts_fails(tmp_path: Path, probe: str) -> None:
    spheres = "".join(f'<body pos="{x / 8} 0 .04"><freejoint/><geom size=".05"/></body>' for x in range(6))
    text = f'<mujoco><size memory="12K"/><worldbody><geom type="plane" size="1 1 1"/>{spheres}</worldbody></mujoco>'
    simulation = Simulation(mujoco.MjModel.from_xml_string(text), steps=5)
    with pytest.raises(ContactMemoryError, match=r"size\.memory"):
        Trace(simulation, str(tmp_path / "t.csv"), probe=[probe]).run()
    assert list(tmp_path.iterdir()) == []


def test_the_list_of_columns_begins_with_time() -> None:
    found = columns(Simulation(SCENES / "pinata.xml"))
    assert found[0] == TIME
    assert "sensor/accelerometer/x" in {column.name for column in found}
    few = columns(Simulation(SCENES / "pinata.xml"), ["energy/drift", "time", "sensor[accelerometer]"])
    names = ["time", "energy/drift", *(f"sensor/accelerometer/{axis}" for axis in "xyz")]
    assert [column.name for column in few] == names
    assert set(few) < set(found)


SLIDE = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="box" pos="0 0 .0999"><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body>
    <body><joint name="h" axis="0 1 0" damping=".1"/><geom name="bob" size=".05" pos=".3 0 2"/></body>
  </worldbody>
  <actuator><motor name="m" joint="h"/><position name="p" joint="h" kp="3"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "parquet", "feather", "npz", "mat", "h5"])
def test_a_trace_drives_again_what_it_was_taken_from(tmp_path: Path, suffix: str) -> None:
    model = mujoco.MjModel.from_xml_string(SLIDE)
    noisy = Simulation(model, duration=0.4, ctrl_noise=0.7, ctrl_noise_time=0.01, seed=3)
    Trace(noisy, str(tmp_path / f"drive.{suffix}")).run()
    once = trace(tmp_path, noisy)
    again = trace(tmp_path, Simulation(model, duration=0.4, ctrl_from=tmp_path / f"drive.{suffix}"))
    assert once.keys() == again.keys()
    assert all(np.array_equal(once[name], again[name]) for name in once)
    assert len(set(once["ctrl/m"])) == 201


def test_a_video_and_a_trace_are_driven_alike(tmp_path: Path) -> None:
    def act(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
        return [data.qvel[6], np.cos(data.time)]

    simulation = Simulation(SLIDE_MODEL, duration=0.3, controller=act, control_dt="0.01", ctrl_noise=0.1)
    found = trace(tmp_path, simulation, probe=["qpos", "ctrl"])
    stepper = simulation.stepper(SLIDE_MODEL)
    for step in (0, 3, 50, 149, 150):
        stepper.advance(step)
        assert found["qpos/h"][step] == stepper.instant().qpos[7]
        assert found["ctrl/m"][step] == stepper.instant().ctrl[0]


SLIDE_MODEL = mujoco.MjModel.from_xml_string(SLIDE)


@pytest.mark.parametrize(
    ("given", "is_cut"), [({}, True), ({"duration": 5}, False), ({"steps": 2}, False), ({"until": "time > 0.1"}, False)]
)
def test_a_table_of_controls_that_outlasts_the_default_duration_is_reported(
    tmp_path: Path, given: dict[str, object], is_cut: bool
) -> None:
    table = tmp_path / "long.csv"
    table.write_text("time,ctrl/m,ctrl/p\n0,1,0\n5.5,0,0\n")
    simulation = Simulation(SLIDE_MODEL, ctrl_from=str(table), **given)  # type: ignore[arg-type]
    reporter = RecordingReporter()
    Trace(simulation, str(tmp_path / "t.csv")).run(reporter)
    text = f"{table} has controls until 5.5 s, of which 5 s are simulated; duration 5.5 simulates all"
    assert [spelled(each) for each in reporter.warnings if "controls" in each] == [text] * is_cut


@cases("text, code, said")
def test_a_control_table_that_does_not_fit_is_refused_before_the_first_step(
    tmp_path: Path, text: str | None, code: int, said: str
) -> None:
    path, output = tmp_path / "c.csv", tmp_path / "o.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(MjrunError, match=said) as caught:
        Trace(Simulation(SLIDE_MODEL, ctrl_from=path), str(output), manifest=str(tmp_path / "m.json")).run()
    assert caught.value.exit_code == code
    assert not output.exists()
    assert not (tmp_path / "m.json").exists()


def test_a_constant_control_stands_in_for_a_column(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("time,ctrl/m\n0,1\n.05,2\n")
    found = trace(tmp_path, Simulation(SLIDE_MODEL, duration=0.1, ctrl={"p": 0.5}, ctrl_from=tmp_path / "c.csv"))
    assert set(found["ctrl/p"]) == {0.5}
    assert list(found["ctrl/m"]) == [1.0] * 25 + [2.0] * 26


def test_the_contact_table_has_every_contact_of_every_row(tmp_path: Path) -> None:
    with_contacts = str(tmp_path / "c.csv")
    found = trace(tmp_path, Simulation(SLIDE_MODEL, duration=0.5), every=5, contacts=with_contacts)
    plain = trace(tmp_path, Simulation(SLIDE_MODEL, duration=0.5), every=5)
    assert all(np.array_equal(found[name], plain[name]) for name in plain)
    with Path(with_contacts).open(newline="") as file:
        rows = list(csv.DictReader(file))
    count = dict.fromkeys(found["time"], 0)
    for row in rows:
        assert float(row["contact"]) == count[float(row["time"])]
        count[float(row["time"])] += 1
        assert (row["geom1"], row["geom2"], row["body1"], row["body2"]) == ("floor", "box", "world", "box")
    assert list(count.values()) == list(found["contact/ncon"])
    last = sum(float(row["world_force/z"]) for row in rows if float(row["time"]) == 0.5)
    assert last == pytest.approx(8 * 9.81, rel=1e-4)


def test_two_outputs_need_two_files(tmp_path: Path) -> None:
    same = str(tmp_path / "t.csv")
    with pytest.raises(MjrunError, match="clashes with the output; each output needs"):
        Trace(Simulation(SLIDE_MODEL), same, contacts=str(tmp_path / "." / "t.csv")).run()


def test_the_time_of_a_row_is_exact_for_any_timestep(tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(FALL)
    model.opt.timestep = 1 / 240
    exact = Fraction(repr(1 / 240))
    found = trace(tmp_path, Simulation(model, steps=3000), probe=["qpos"], every=100)
    assert list(found["time"]) == [float(step * exact) for step in range(0, 3001, 100)]
