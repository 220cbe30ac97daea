"""Values over frames and live plots beside them, measured at the instants that the frames show."""

from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image as Pillow

from mjrun.dataclass import dataclass
from mjrun.errors import UnknownNameError, UsageError
from mjrun.outputs.frame_drawing import empty_overlay, overlay_probes
from mjrun.outputs.video import Video
from mjrun.physics.stepper import PhysicsStepper
from mjrun.rendering.compositor import TextAndLivePlots
from mjrun.rendering.live_plot import LivePlot, aligned, live_plot_size
from mjrun.rendering.text import BUILTIN, DEFAULT_FORMAT, parse_template
from mjrun.simulation.simulation import Simulation
from mjrun.timeline import Timeline

pytestmark = pytest.mark.filterwarnings("ignore:software rendering")

SIZE = (160, 120)


@pytest.mark.parametrize("side", ["under", "beside"])
def test_graphs_stand_beside_the_video_and_leave_it_as_it_is(swing: Path, tmp_path: Path, side: str) -> None:
    simulation = Simulation(swing, duration=0.1)
    plots = ["energy", "qpos[hinge]"]
    Video(simulation, f"{tmp_path}/p/", size=SIZE).run()
    result = Video(simulation, f"{tmp_path}/g/", size=SIZE, plot=plots, plot_side=side).run()
    width, height = live_plot_size(SIZE, side)
    assert result.size == ((SIZE[0], SIZE[1] + 2 * height) if side == "under" else (SIZE[0] + 2 * width, SIZE[1]))
    for frame in sorted((tmp_path / "p").iterdir()):
        found = np.array(Pillow.open(tmp_path / "g" / frame.name))
        assert np.array_equal(found[: SIZE[1], : SIZE[0]], np.array(Pillow.open(frame)))


def test_a_plot_of_nothing_and_separate_plots_are_refused(swing: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="this model has no such values"):
        Video(Simulation(swing), f"{tmp_path}/a.mp4", plot=["act"], size=SIZE).run()
    with pytest.raises(UsageError, match="plot and separate exclude each other"):
        Video(Simulation(swing), f"{tmp_path}/a.mp4", plot=["energy"], separate=True)


def test_texts_and_graphs_hold_the_values_of_a_bare_loop(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    timeline = Timeline.of_steps(Fraction(1, 500), 100)
    text = "{time:.17g} {step} {frame} {speed} {energy/kinetic:.17g}"
    probes = overlay_probes(model, timeline, text, ["qpos[hinge], qvel[hinge]", "qpos[ball]"])
    assert not probes.idle
    data = mujoco.MjData(probes.model)
    data.qvel[0] = 3
    stepper = PhysicsStepper(probes.model, data)
    rows, texts, curves = [], [], []
    for frame, step in enumerate((0, 40, 100)):
        stepper.advance(step)
        rows.append(probes.read(stepper))
        mujoco.mj_step(probes.model, data, nstep=step - round(data.time * 500))
        shown = mujoco.MjData(probes.model)
        mujoco.mj_copyData(shown, probes.model, data)
        mujoco.mj_forward(probes.model, shown)
        texts.append(f"{step / 500:.17g} {step} {frame} 0.5 {shown.energy[1]:.17g}")
        curves.append([shown.qpos[0], shown.qvel[0], *shown.qpos[1:]])
    empty = empty_overlay(SIZE, "top", ["", ""], "beside")
    overlay = probes.overlay(empty, np.array(rows), [0, 40, 100], [0.5] * 3, timeline)
    assert overlay.texts == texts
    assert (overlay.corner, overlay.side, overlay.times) == ("top", "beside", [0.0, 0.08, 0.2])
    times, size, live_plots = np.array(overlay.times), live_plot_size(SIZE, "beside"), []
    for table, values in zip(probes.tables[1:], np.split(np.array(curves), [2], axis=1), strict=True):
        columns = table.columns[1:]
        names, units = [column.name for column in columns], [column.unit for column in columns]
        live_plots.append(LivePlot(times, values, names, units, size))
    for live_plot, expected in zip(overlay.live_plots, aligned(live_plots), strict=True):
        assert np.array_equal(live_plot.draw(0.08), expected.draw(0.08))


def test_what_an_overlay_has_besides_texts_and_graphs_stays(swing: Path) -> None:
    @dataclass(frozen=True)
    class WiderOverlay(TextAndLivePlots):
        margin: int = 0

    model = mujoco.MjModel.from_xml_path(str(swing))
    timeline = Timeline.of_steps(Fraction(1, 500), 100)
    empty = WiderOverlay(corner="bottom", side="beside", margin=3)
    overlay = overlay_probes(model, timeline, "{step}").overlay(empty, np.empty((0, 0)), [0, 5], [1.0, 1.0], timeline)
    assert overlay == WiderOverlay(
        texts=["0", "5"], corner="bottom", side="beside", times=[0.0, 0.01], live_plots=[], margin=3
    )


def test_texts_count_the_contacts_of_two_objects() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody>
        <geom name="floor" type="plane" size="1 1 .1"/>
        <body name="box" pos="0 0 .1"><freejoint/><geom name="b:1" type="box" size=".1 .1 .1"/></body>
        <body name="ball" pos="1 0 .05"><freejoint/><geom size=".06"/></body>
      </worldbody></mujoco>""")
    timeline = Timeline.of_steps(Fraction(1, 500), 1)
    text = "{contact/box/floor} {contact/geom:b:1/geom:floor:.1f} {contact/ball/box:g} {contact/ncon:g}"
    probes = overlay_probes(model, timeline, text)
    row = probes.read(PhysicsStepper(probes.model, mujoco.MjData(probes.model)))
    overlay = probes.overlay(empty_overlay(SIZE, "top"), np.array([row]), [0], [1.0], timeline)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    floor, box = (np.array(data.contact.geom) == index for index in (0, 1))
    count = int((floor.any(axis=1) & box.any(axis=1)).sum())
    assert count == 4
    assert overlay.texts == [f"{count} {count}.0 0 {data.ncon}"]

    for wrong in ("contact/box/flor", "contact/box", "contact/box/floor/x"):
        with pytest.raises(UnknownNameError, match="no value"):
            overlay_probes(model, timeline, f"{{{wrong}}}")


def test_nothing_is_measured_for_a_text_of_time_alone(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    timeline = Timeline.of_steps(Fraction(1, 500), 100)
    probes = overlay_probes(model, timeline, "{time:.1f} s")
    assert probes.idle
    overlay = probes.overlay(empty_overlay(SIZE, "top"), np.empty((0, 0)), [0, 50], [1.0, 1.0], timeline)
    assert overlay.texts == ["0.0 s", "0.1 s"]
    assert overlay_probes(model, timeline, None).idle
    assert not overlay_probes(model, timeline, None).text.parts


def test_an_unknown_value_is_named_where_it_was_asked_for(swing: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(swing))
    timeline = Timeline.of_steps(Fraction(1, 500), 100)
    with pytest.raises(UnknownNameError, match="energy") as caught:
        overlay_probes(model, timeline, None, ["energy", "enrgy"])
    assert caught.value.path == ("plot", 1)
    with pytest.raises(UnknownNameError) as caught:
        overlay_probes(model, timeline, "{enrgy/kinetic}")
    assert caught.value.path == ("text",)


COLUMNS = ["qpos/knee", "qpos/joint:0", "energy/kinetic"]
VALUES = {"qpos/knee": 0.123456, "qpos/joint:0": -2.5, "energy/kinetic": 1e6, "time": 1.25, "frame": 30, "speed": 0.5}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        ("{{literal}}", "{literal}"),
        ("{time:.3f} s", f"{1.25:.3f} s"),
        ("{frame:04d} at {speed:%}", f"{30:04d} at {0.5:%}"),
        ("{qpos/knee:+10.2e}|{qpos/knee:.1f}", f"{0.123456:+10.2e}|{0.123456:.1f}"),
        ("{time} {frame} {speed} {qpos/knee}", f"{1.25:.2f} {30:d} {0.5:g} {0.123456:.4g}"),
        ("{qpos/joint:0} {qpos/joint:0:.2f}", f"{-2.5:.4g} {-2.5:.2f}"),
        (r"one\ntwo {energy/kinetic}", f"one\ntwo {1e6:.4g}"),
    ],
)
def test_a_template_is_filled_as_python_formats(text: str, expected: str) -> None:
    assert parse_template(text, COLUMNS).filled(VALUES) == expected


@pytest.mark.parametrize("name", [*BUILTIN, "qpos/knee"])
def test_a_value_without_a_format_has_that_of_its_kind(name: str) -> None:
    form = BUILTIN.get(name, DEFAULT_FORMAT)
    plain, formatted = (parse_template(f"{{{text}}}", COLUMNS) for text in (name, f"{name}:{form}"))
    assert plain == formatted


def test_a_template_names_each_column_once_and_no_value_of_its_own() -> None:
    template = parse_template("{qpos/knee} {time} {energy/kinetic} {qpos/knee:.1f} {step}", COLUMNS)
    assert template.columns == ["qpos/knee", "energy/kinetic"]


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("{qpos/nee}", UnknownNameError, "no value 'qpos/nee'.*did you mean 'qpos/knee'"),
        ("{}", UnknownNameError, "no value ''"),
        ("{time!r}", UnknownNameError, "no value 'time!r'"),
        ("{time", UsageError, "write a value as {time:.2f} and a brace as {{"),
        ("time}", UsageError, "a brace as {{"),
        ("{time:d}", UsageError, "'d' cannot format 'time'"),
        ("{frame:q}", UsageError, "'q' cannot format 'frame'"),
        ("{step:c}", UsageError, "'c' cannot format 'step': it is a number, not a character"),
        ("{time:99999999999}", UsageError, "'99999999999' cannot format 'time': a value has at most 999 characters"),
        ("{time:.1000f}", UsageError, "'.1000f' cannot format 'time': a value has at most 999 characters"),
    ],
)
def test_a_template_that_cannot_be_filled_is_refused(text: str, kind: type, message: str) -> None:
    with pytest.raises(kind, match=f"(?s){message}"):
        parse_template(text, COLUMNS)
