"""Many outputs of one simulation in one pass: the same as each alone."""

import fcntl
import hashlib
import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.camera.rigs.free_camera import FreeRig
from mjrun.camera.script import CameraScript, ConditionEvent, Shot
from mjrun.errors import (
    FailedAssertionError,
    FaultyRequestsError,
    FileError,
    MjrunError,
    PartlyDoneError,
    UnknownNameError,
    UnstableError,
    UsageError,
)
from mjrun.formats.ffmpeg import VideoWriter
from mjrun.formats.manifest import ManifestWriter
from mjrun.formats.output_writer import StagedFile
from mjrun.formats.table_writer import TableWriter
from mjrun.outputs.image import Image
from mjrun.outputs.perform import perform, preview
from mjrun.outputs.plot import Plot
from mjrun.outputs.recording import Recording
from mjrun.outputs.trace import Trace
from mjrun.outputs.video import Video
from mjrun.shared_status import interrupt
from mjrun.simulation.simulation import Simulation
from tests.formats.file_faults import MOST, fault

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")

SIZE = (64, 48)


def frames(folder: Path) -> list[np.ndarray]:
    return [np.array(Pillow.open(path)) for path in sorted(folder.iterdir())]


def test_one_pass_makes_what_each_job_makes_alone(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.2, qvel={"hinge": 3})

    def jobs(folder: Path) -> list[Video | Image | Trace | Plot | Recording]:
        folder.mkdir()
        return [
            Video(simulation, f"{folder}/f/", fps=20, size=SIZE, camera="side", text="{energy/kinetic:.3f}"),
            Image(simulation, f"{folder}/i.png", time=0.1, size=SIZE, view="depth"),
            Trace(simulation, f"{folder}/t.csv", probe=["qpos", "energy"], every=3, contacts=f"{folder}/c.csv"),
            Trace(simulation, f"{folder}/u.npz"),
            Plot(simulation, f"{folder}/p.png", probe=["energy", "qpos/hinge"], size=(200, 160)),
            Recording(simulation, f"{folder}/r.npz"),
        ]

    together = perform(jobs(tmp_path / "together"))
    alone = [job.run() for job in jobs(tmp_path / "alone")]
    for name in ("i.png", "p.png"):
        one, other = (np.array(Pillow.open(tmp_path / folder / name)) for folder in ("together", "alone"))
        assert np.array_equal(one, other)
    for one, other in zip(frames(tmp_path / "together/f"), frames(tmp_path / "alone/f"), strict=True):
        assert np.array_equal(one, other)
    for name in ("t.csv", "c.csv"):
        assert (tmp_path / "together" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    for name in ("u.npz", "r.npz"):
        one, other = (np.load(tmp_path / folder / name) for folder in ("together", "alone"))
        assert all(np.array_equal(one[key], other[key]) for key in one.files if one[key].dtype.kind in "fi")
    assert [type(result) for result in together] == [type(result) for result in alone]


def test_an_assertion_that_fails_keeps_all_outputs(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, steps=10)
    jobs = [Trace(simulation, f"{tmp_path}/a.csv", assert_=["time < 0"]), Recording(simulation, f"{tmp_path}/r.npz")]
    with pytest.raises(FailedAssertionError):
        perform(jobs)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "r.npz", "swing.xml"]


def test_what_fails_early_leaves_nothing_of_any_job(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, steps=10)
    good = Trace(simulation, f"{tmp_path}/a.csv")
    for bad, error in (
        (Trace(simulation, f"{tmp_path}/b.csv", probe=["nothing"]), FaultyRequestsError),
        (Plot(simulation, "/dev/null/p.png", probe=["energy"]), FileError),
        (Image(simulation, f"{tmp_path}/i.png", time=ConditionEvent("speed(nobody) > 1")), FaultyRequestsError),
    ):
        with pytest.raises(error):
            perform([good, bad])
        assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]


def test_an_instability_keeps_partial_traces_only(exploding: Path, tmp_path: Path) -> None:
    simulation = Simulation(exploding, key="fast", duration=5)
    kept = Trace(simulation, f"{tmp_path}/a.csv", keep_partial=True, manifest=f"{tmp_path}/m.json")
    with pytest.raises(UnstableError) as caught:
        perform([kept, Recording(simulation, f"{tmp_path}/r.npz")])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "exploding.xml", "m.json"]
    assert len((tmp_path / "a.csv").read_text().splitlines()) == caught.value.step + 2
    assert json.loads((tmp_path / "m.json").read_text())["failure"] == str(caught.value)


def test_jobs_of_two_simulations_or_none_are_no_pass(swing: Path) -> None:
    with pytest.raises(UsageError, match="share one simulation"):
        perform([Trace(Simulation(swing)), Trace(Simulation(swing))])
    with pytest.raises(UsageError, match="no output"):
        perform([])


def test_a_plan_counts_what_is_then_made(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1)
    event = CameraScript("hit", [Shot(FreeRig(), until=ConditionEvent("time > 0.05")), Shot(FreeRig())])
    jobs = [
        Video(simulation, f"{tmp_path}/f.mp4", fps=20, size=(64, 48)),
        Video(simulation, f"{tmp_path}/g.mp4", fps=20, size=(64, 48), camera=event),
        Trace(simulation, f"{tmp_path}/t.csv", every=7),
        Recording(simulation, f"{tmp_path}/r.npz"),
    ]
    plan = preview(jobs)
    assert [path.name for path in tmp_path.iterdir()] == ["swing.xml"]
    made = perform(jobs)
    assert [part.count for part in plan.outputs] == [made[0].frames, None, made[2].rows, made[3].states]
    assert (plan.steps, plan.duration) == (50, 0.1)


def test_all_that_is_wrong_with_jobs_is_reported_at_once(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1, qpos={"hing": 1})
    video = Video(simulation, f"{tmp_path}/f.mp4", camera="sde", size=SIZE)
    trace = Trace(simulation, f"{tmp_path}/t.csv", probe=["qpos"])
    plot = Plot(simulation, f"{tmp_path}/p.png", probe=["enrgy"])
    with pytest.raises(FaultyRequestsError) as caught:
        perform([video, trace, plot])
    assert [index for index, _ in caught.value.faults] == [0, 2, None]
    assert [getattr(error, "name", None) for _, error in caught.value.faults] == ["sde", "enrgy", "hing"]
    assert [line for line in str(caught.value).splitlines() if line.startswith("no ")] == [
        "no camera 'sde' (did you mean 'side'?)",
        "no probe 'enrgy' (did you mean 'energy'?)",
        "no joint 'hing' (did you mean 'hinge'?)",
    ]
    called = Simulation(swing, control_dt=0.01)
    with pytest.raises(FaultyRequestsError) as caught:  # each front end spells options in its own way
        preview([Trace(called, f"{tmp_path}/t.csv"), Recording(called, f"{tmp_path}/r.npz")])
    assert "--control-dt" in caught.value.spelled(lambda name: f"--{name.replace('_', '-')}")
    with pytest.raises(UnknownNameError, match="no probe 'enrgy'"):
        preview([replace(plot, simulation=replace(simulation, qpos={}))])
    assert [*tmp_path.iterdir()] == [swing]


def test_an_error_brings_what_was_made_in_spite_of_it(exploding: Path, tmp_path: Path) -> None:
    simulation = Simulation(exploding, key="fast", duration=5)
    table, recording = f"{tmp_path}/t.csv", f"{tmp_path}/r.npz"
    with pytest.raises(UnstableError) as caught:
        perform([Trace(simulation, table, keep_partial=True), Recording(simulation, recording, keep_partial=True)])
    trace, record = caught.value.results
    assert (trace.path, record.path) == (table, recording)
    assert caught.value.__notes__ == [f"kept, up to there: {table}, {recording}"]
    assert trace.rows == record.states == caught.value.step + 1
    assert record.simulated == pytest.approx(caught.value.time)
    again = Trace(Simulation(exploding, replay=recording), f"{tmp_path}/u.csv").run()
    assert again.rows == trace.rows
    assert (tmp_path / "u.csv").read_bytes() == (tmp_path / "t.csv").read_bytes()


def test_a_failed_assertion_brings_every_verdict(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1)
    asserts = ["last(time) == 0.1", "max(time) < 0"]
    with pytest.raises(FailedAssertionError) as caught:
        perform([Trace(simulation, f"{tmp_path}/t.csv", assert_=asserts)])
    (result,) = caught.value.results
    found = [(verdict.text, verdict.passed) for verdict in result.assertions]
    assert found == [(asserts[0], True), (asserts[1], False)]
    assert caught.value.messages == (result.assertions[1].message,)


def test_a_lone_text_is_a_list_of_one(swing: Path, tmp_path: Path) -> None:
    simulation, out = Simulation(swing, duration=0.1), f"{tmp_path}/out"
    trace = Trace(simulation, f"{out}.csv", probe="energy", assert_="max(time) < 1")
    assert (trace.probe, trace.assert_) == (("energy",), ("max(time) < 1",))
    assert len(trace.run().assertions) == 1
    assert Plot(simulation, f"{out}.png", probe="energy").probe == ("energy",)
    video = Video(simulation, f"{out}.mp4", plot="energy", trail="box", ghost="opacity=.5", size=SIZE)
    assert (video.plot, video.trail, video.ghost) == (("energy",), ("box",), ("opacity=.5",))


@pytest.mark.parametrize("size", ["64x48", (64,), (64, 0), (64, 48.5), (64, "48")])
def test_a_size_that_is_none_is_reported_at_once(swing: Path, size: Any) -> None:
    with pytest.raises(UsageError, match=r"size: .* is not a width and a height in pixels"):
        Image(Simulation(swing), "a.png", size=size)


MEETING = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="cart"><joint name="slide" type="slide" axis="1 0 0"/><geom size=".1"/></body>
  </worldbody>
  <keyframe><key name="start" qpos="0"/></keyframe>
</mujoco>
"""


@pytest.fixture
def meeting(tmp_path: Path) -> Path:
    """A cart that stands still at the origin: a camera there cannot look at it."""
    path = tmp_path / "meeting.xml"
    path.write_text(MEETING)
    return path


def manifest_of(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


def test_a_camera_that_meets_its_target_does_not_cost_the_other_outputs(meeting: Path, tmp_path: Path) -> None:
    simulation = Simulation(meeting, duration=0.1)
    bad = Video(
        simulation, f"{tmp_path}/v.mp4", camera="look:from=0/0/0,at=cart", size=SIZE, manifest=f"{tmp_path}/v.json"
    )
    with pytest.raises(PartlyDoneError) as caught:
        perform(
            [
                Trace(simulation, f"{tmp_path}/t.csv", manifest=f"{tmp_path}/t.json"),
                bad,
                Image(simulation, f"{tmp_path}/i.png", size=SIZE, manifest=f"{tmp_path}/i.json"),
            ]
        )
    error = caught.value
    assert error.exit_code == 8
    assert [result.path for result in error.results] == [f"{tmp_path}/t.csv", f"{tmp_path}/i.png"]
    assert [(f["output"], f["kind"], f["exit_code"]) for f in error.failures] == [(bad.output, "UsageError", 2)]
    assert f"{bad.output} could not be made: " in str(error)
    assert error.made == [f"{tmp_path}/{name}" for name in ("t.csv", "t.json", "i.png", "i.json")]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["i.json", "i.png", "meeting.xml", "t.csv", "t.json"]
    assert manifest_of(tmp_path / "t.json")["outputs"][0]["sha256"] == sha256(tmp_path / "t.csv")

    with pytest.raises(UsageError) as alone:  # nothing was made: the failure as it is
        perform([bad])
    assert (alone.value.exit_code, alone.value.results) == (2, [])
    assert str(alone.value) == error.failures[0]["message"]


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_an_encoder_that_dies_does_not_cost_the_other_outputs(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, written = VideoWriter.write, []

    def dying(writer: VideoWriter, frame: np.ndarray) -> None:
        if Path(writer.destination.shown).name == "bad.mp4" and len(written) == 2:
            os.kill(writer._child.pid, signal.SIGKILL)
            writer._child.wait()
        written.append(frame.shape)
        write(writer, frame)

    monkeypatch.setattr(VideoWriter, "write", dying)
    simulation = Simulation(swing, duration=0.2)
    with pytest.raises(PartlyDoneError) as caught:
        perform([Video(simulation, f"{tmp_path}/{name}.mp4", size=SIZE) for name in ("bad", "good")])
    assert [(f["output"], f["kind"], f["exit_code"]) for f in caught.value.failures] == [
        (f"{tmp_path}/bad.mp4", "EncoderError", 6)
    ]
    assert [result.frames for result in caught.value.results] == [6]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["good.mp4", "swing.xml"]


def full_disk(monkeypatch: pytest.MonkeyPatch, name: str, rows: int = 0) -> None:
    """A disk that is full once the table of this name has so many rows."""
    write = TableWriter.write

    def failing(writer: TableWriter, block: np.ndarray) -> None:
        if Path(writer.destination.shown).name == name and writer.rows >= rows:
            raise FileError(name, "cannot be written: the disk is full")
        write(writer, block)

    monkeypatch.setattr(TableWriter, "write", failing)


def test_a_writer_that_fails_does_not_cost_the_other_outputs(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full_disk(monkeypatch, "bad.csv", rows=256)
    simulation = Simulation(swing, steps=600)
    with pytest.raises(PartlyDoneError, match=r"bad.csv could not be made: .*disk is full\nmade: .*good.csv"):
        perform([Trace(simulation, f"{tmp_path}/{name}.csv") for name in ("bad", "good")])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["good.csv", "swing.xml"]
    Trace(simulation, f"{tmp_path}/alone.csv").run()
    assert (tmp_path / "good.csv").read_bytes() == (tmp_path / "alone.csv").read_bytes()


def test_a_table_that_is_edited_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, table = tmp_path / "pushed.xml", tmp_path / "controls.csv"
    body = '<body><joint name="slide" type="slide"/><geom size=".1"/></body>'
    motor = '<actuator><motor name="push" joint="slide"/></actuator>'
    model.write_text(f"<mujoco><worldbody>{body}</worldbody>{motor}</mujoco>")
    table.write_text("time,ctrl/push\n0,1\n")
    stepper = Simulation.stepper

    def read_and_edit(*arguments: Any) -> Any:
        read = stepper(*arguments)
        table.write_text("time,ctrl/push\n0,2\n")
        return read

    monkeypatch.setattr("mjrun.simulation.simulation.Simulation.stepper", read_and_edit)
    with pytest.raises(FileError) as caught:
        perform([Trace(Simulation(model, ctrl_from=str(table)), f"{tmp_path}/t.csv")])
    assert str(caught.value) == f"{table}: has changed while it was read\nrun the command again"
    assert not (tmp_path / "t.csv").exists()


def test_an_output_and_its_manifest_are_published_together_or_not_at_all(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(writer: ManifestWriter, *facts: object) -> None:
        raise FileError(writer.destination.shown, "cannot be written: the disk is full")

    monkeypatch.setattr(ManifestWriter, "write", failing)
    with pytest.raises(FileError, match=r"m\.json"):
        perform([Trace(Simulation(swing, steps=5), f"{tmp_path}/t.csv", manifest=f"{tmp_path}/m.json")])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["swing.xml"]


@pytest.mark.parametrize("kind", ["once", "from then on"])
def test_a_table_and_its_contacts_are_both_new_or_both_old_or_the_message_says_which(
    swing: Path, tmp_path: Path, kind: str
) -> None:
    table, contacts = tmp_path / "t.csv", tmp_path / "c.csv"

    def trace(steps: int) -> Trace:
        return Trace(Simulation(swing, steps=steps), str(table), contacts=str(contacts))

    number = 0
    while True:
        number += 1
        assert number < MOST
        for path in (table, contacts):
            path.write_text("old")
        made, message = [str(table), str(contacts)], ""
        with fault(number, kind) as tried:
            try:
                perform([trace(5)])
            except MjrunError as error:
                made, message = error.made if isinstance(error, PartlyDoneError) else [], str(error)
        assert not message or all(path in message for path in made)
        assert [str(path) for path in (table, contacts) if path.read_text() != "old"] == made
        perform([trace(5)])
        assert sorted(path.name for path in tmp_path.iterdir()) == ["c.csv", "swing.xml", "t.csv"]
        if len(tried) < number:
            break
    assert number > 4


@pytest.mark.parametrize("probes", [["qpos"], ["qpos", "contact/ncon"]])
def test_a_writer_that_fails_before_an_instability_publishes_nothing(
    exploding: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, probes: list[str]
) -> None:
    full_disk(monkeypatch, "bad.csv")
    simulation = Simulation(exploding, key="fast", duration=5)
    bad = Trace(simulation, f"{tmp_path}/bad.csv", probe=probes, keep_partial=True)
    with pytest.raises(FileError, match="the disk is full"):
        perform([bad])
    assert [*tmp_path.iterdir()] == [exploding]

    good = replace(bad, output=f"{tmp_path}/good.csv")
    with pytest.raises(UnstableError) as caught:
        perform([bad, good])
    assert [result.path for result in caught.value.results] == [good.output]
    assert any("the disk is full" in note for note in caught.value.__notes__)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["exploding.xml", "good.csv"]


def test_an_event_that_never_happens_costs_its_own_output_only(swing: Path, tmp_path: Path) -> None:
    simulation = Simulation(swing, duration=0.1)
    never = Image(simulation, f"{tmp_path}/i.png", time=ConditionEvent("time > 9"), size=SIZE)
    with pytest.raises(PartlyDoneError, match="never happens") as caught:
        perform([never, Recording(simulation, f"{tmp_path}/r.npz")])
    assert [result.path for result in caught.value.results] == [f"{tmp_path}/r.npz"]
    with pytest.raises(UsageError, match="never happens"):
        perform([never])


def test_nobody_else_publishes_between_two_outputs_of_one_pass(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else two runs at once could each leave one of the files."""
    simulation, refused = Simulation(swing, steps=2), list[bool]()

    def remark(_: StagedFile) -> str:  # of a published output
        descriptor = os.open(tmp_path, os.O_RDONLY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(descriptor)
        refused.append(True)
        return ""

    monkeypatch.setattr(StagedFile, "remark", property(remark))
    perform([Trace(simulation, str(tmp_path / name)) for name in ("a.csv", "b.npz")])
    assert refused == [True, True]


def test_a_signal_between_two_outputs_of_one_pass_waits_for_both(
    swing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def remark(_: StagedFile) -> str:  # of a published output
        interrupt(KeyboardInterrupt())
        return ""

    monkeypatch.setattr(StagedFile, "remark", property(remark))
    simulation = Simulation(swing, steps=2)
    with pytest.raises(KeyboardInterrupt):
        perform([Trace(simulation, str(tmp_path / name)) for name in ("a.csv", "b.npz")])
    assert (tmp_path / "a.csv").exists()
    assert (tmp_path / "b.npz").exists()
