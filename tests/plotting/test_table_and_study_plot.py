"""Plots of tables and of studies, as images and pages."""

import io
import json
import re
import xml.etree.ElementTree as ElementTree
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import mjrun
from mjrun.errors import FailedAssertionError, FileError, MjrunError, UnknownNameError, UsageError
from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column
from mjrun.options.plot import FigureOptions
from mjrun.options.trace import UNIT_PLACES
from mjrun.plotting.table_and_study_plot import StudyPlot, TablePlot
from mjrun.plotting.table_figure import TableFigure, table_names
from mjrun.plotting.table_statistics import TableSummarizer
from mjrun.simulation.simulation import Simulation
from mjrun.study.study import Study
from tests.cases import cases
from tests.plotting.test_html_page import external_references
from tests.reporters import RecordingReporter

COLUMNS = [Column("time", "s"), Column("qpos/knee", "rad"), Column("qpos/hip", "rad"), Column("energy/total", "J")]
TIME = np.arange(500) / 100
ROWS = np.column_stack([TIME, np.sin(TIME), np.cos(TIME), TIME**2])


def table(path: Path, rows: np.ndarray = ROWS, columns: list[Column] = COLUMNS) -> str:
    with TableWriter(str(path), path.suffix[1:], columns, {}) as writer:
        writer.write(rows)
        writer.publish()
    return str(path)


def texts(svg: str) -> list[str]:
    return [str(each.text) for each in ElementTree.fromstring(svg).iter() if each.tag.endswith("text")]


def svg_figure(tables: list[str], options: FigureOptions) -> tuple[str, list[str]]:
    """The figure as it stands in a page, and notes about it."""
    with ExitStack() as stack:
        figure = TableFigure(tables, options, stack)
        figure.read()
        page = figure.for_page()
        return page.svg, list(page.notes)


@pytest.mark.parametrize("place", UNIT_PLACES)
def test_axes_have_the_units_that_csv_states(tmp_path: Path, place: str) -> None:
    path = tmp_path / "t.csv"
    with TableWriter(str(path), "csv", [Column("time", "s"), Column("load", "kN")], units=place) as writer:
        writer.write(ROWS[:, :2])
        writer.publish()
    assert "load [kN]" in texts(svg_figure([str(path)], FigureOptions())[0])


def test_units_of_untrusted_files_are_cleaned(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"time,a\n# units: s,\xff\x1b[31m" + 100 * b"m" + b"\n0,1\n1,2\n")
    (unit,) = [text for text in texts(svg_figure([str(path)], FigureOptions())[0]) if text.startswith("a [")]
    assert unit.startswith(r"a [\udcff\x1b[31mm")
    assert unit.endswith("…]")
    assert len(unit) < 100


@pytest.mark.parametrize("suffix", ["csv", "parquet", "npz"])
def test_every_table_that_can_be_read_is_plotted(tmp_path: Path, suffix: str) -> None:
    result = TablePlot([table(tmp_path / f"run.{suffix}")], str(tmp_path / "run.svg"), size=(400, 300)).run()
    unit = "" if suffix == "csv" else " [rad]"
    assert (result.rows, result.curves, result.size, result.notes) == ([500], 3, (400, 300), [])
    assert result.panels == [f"qpos{unit}", "energy/total [J]"]
    assert {f"qpos{unit}", "knee", "hip", "time [s]"} <= set(texts((tmp_path / "run.svg").read_text("utf-8")))


def test_standard_input_is_read_once_and_standard_output_holds_the_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = table(tmp_path / "run.csv")
    options = FigureOptions(y=["knee=qpos/knee"], size=(300, 200))
    expected, _ = svg_figure([file], options)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(Path(file).read_bytes())))
    assert svg_figure(["-"], options)[0] == expected
    with pytest.raises(UsageError, match="read only once"):
        svg_figure(["-", "-"], options)


def test_tables_are_overlaid_by_what_differs_in_their_names(tmp_path: Path) -> None:
    paths = [table(tmp_path / f"kick_{i}.csv", ROWS + i) for i in (1, 2, 3)]
    svg, notes = svg_figure(paths, FigureOptions(y=["qpos/knee"], size=(400, 300)))
    assert {"1", "2", "3", "qpos/knee"} <= set(texts(svg))
    assert notes == []


def test_identical_curves_of_tables_alternate_and_are_named(tmp_path: Path) -> None:
    for name, end in (("one", 2), ("two", 2), ("three", 3)):
        (tmp_path / f"{name}.csv").write_text(f"time,a,b,c\n0,1,nan,{end}\n1,{end},nan,2\n")
    result = TablePlot([tmp_path / f"{name}.csv" for name in ("one", "two", "three")], tmp_path / "p.svg").run()
    assert result.notes[0] == "a, c: curves coincide, and their dashes alternate: one, two"
    assert not [note for note in result.notes[1:] if "coincide" in note]
    assert (tmp_path / "p.svg").read_text().count("stroke-dasharray") == 4


def test_columns_that_are_not_shown_may_hold_anything(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,who,v\n0,me,1\n1,you,\n2,me,3\n")
    result = TablePlot([path], tmp_path / "a.png", y="v", size=(300, 200)).run()
    assert result.rows == [3]
    with pytest.raises(FileError, match="'me' is not a number") as refused:
        TablePlot([path], tmp_path / "b.png").run()
    advice = "chooses columns; others may hold anything"
    assert refused.value.spelled(str).endswith(f"y {advice}")
    frame = {"time": np.arange(3.0), "who": np.array(["me", "you", "me"]), "v": np.ones(3)}
    np.savez(tmp_path / "a.npz", **frame)
    assert TablePlot([tmp_path / "a.npz"], tmp_path / "a.png", y="v", size=(300, 200)).run().rows == [3]
    with pytest.raises(FileError, match="column 'who' holds text, not numbers") as refused:
        TablePlot([tmp_path / "a.npz"], tmp_path / "b.png").run()
    assert refused.value.spelled(str).endswith(f"y {advice}")
    for table_path in (path, tmp_path / "a.npz"):
        with pytest.raises(FileError) as refused:
            mjrun.read_table(table_path)
        assert refused.value.spelled(str).endswith(f"columns {advice}")
    assert not (tmp_path / "b.png").exists()
    path.write_text("time,v\n0,1\n1\n")
    with pytest.raises(FileError, match=r"expected 2 cells, as in the header, got 1$"):
        TablePlot([path], tmp_path / "b.png").run()


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("time,a\n", FileError, "has no rows"),
        ("", FileError, "is empty"),
        ("time,a,a\n0,1,2\n", FileError, "two columns are called 'a'"),
        ("time,a\n0,1\n1\n", FileError, "expected 2 cells"),
        ("time,b\n0,1\n", UnknownNameError, "no column 'a'"),
        ("time\n0\n", UnknownNameError, "no column 'a'"),
    ],
)
def test_a_table_that_cannot_be_plotted_leaves_nothing(tmp_path: Path, text: str, kind: type, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(kind, match=message):
        TablePlot(path, tmp_path / "t.png", y=["a"]).run()
    assert [*tmp_path.iterdir()] == [path]


def test_a_table_that_does_not_exist_and_no_table_at_all_are_reported(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        TablePlot(tmp_path / "none.csv", tmp_path / "t.png").run()
    with pytest.raises(MjrunError, match="nothing to plot: give a table"):
        TablePlot([], tmp_path / "t.png").run()


def test_notes_are_in_the_result_and_reported(tmp_path: Path) -> None:
    reporter = RecordingReporter()
    path = tmp_path / "a.csv"
    path.write_text("u,v\n1,-1\n2,2\n3,nan\n")
    result = TablePlot(path, tmp_path / "a.png", log="y").run(reporter)
    assert reporter == RecordingReporter([*result.notes])
    assert "row" in result.notes[0]
    assert "v: 1 value at or below zero is" in result.notes[1]


def test_a_page_holds_the_plot_the_columns_assertions_and_what_is_included(tmp_path: Path) -> None:
    file, page = table(tmp_path / "run.parquet"), tmp_path / "page.html"
    Image.new("RGB", (4, 3)).save(tmp_path / "a.png")
    plot = TablePlot(file, tmp_path / "p.svg", html=page, include=[tmp_path / "a.png"], assert_=["max(time) >= 0"])
    result = plot.run()
    html = page.read_text()
    assert (result.path, result.html) == (str(tmp_path / "p.svg"), str(page))
    assert [verdict.passed for verdict in result.assertions] == [True]
    assert external_references(html) == []
    for part in ("qpos/knee", "1 assertion passed", "data:image/png;base64,", "<svg"):
        assert part in html
    assert (tmp_path / "p.svg").exists()
    plot.run()
    assert page.read_text() == html


def test_an_assertion_that_fails_publishes_the_page_and_says_of_which_table(tmp_path: Path) -> None:
    files = [table(tmp_path / f"{name}.csv") for name in "ab"]
    with pytest.raises(FailedAssertionError, match=r"a\.csv: .*\n.*b\.csv: ") as failure:
        TablePlot(files, html=tmp_path / "page.html", assert_=["max(time) < 0"]).run()
    assert [result.format for result in failure.value.results] == ["html"]
    assert "2 of 2 assertions failed" in (tmp_path / "page.html").read_text()


def test_a_page_that_cannot_be_written_leaves_the_plot_unpublished(tmp_path: Path) -> None:
    file = table(tmp_path / "run.csv")
    with pytest.raises(FileError):
        TablePlot(file, tmp_path / "p.png", html=Path(file) / "page.html").run()
    with pytest.raises(FileError, match=r"none\.mp4"):
        TablePlot(file, tmp_path / "p.png", html=tmp_path / "page.html", include=[tmp_path / "none.mp4"]).run()
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]


def test_with_neither_picture_nor_page_there_is_nothing_to_make(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="output, html or both"):
        TablePlot(table(tmp_path / "run.csv")).run()
    with pytest.raises(UsageError, match="include requires html"):
        TablePlot(table(tmp_path / "run.csv"), tmp_path / "p.png", include=["run.json"]).run()


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = str(tmp_path_factory.mktemp("study"))
    simulation = Simulation("scene:pendulum", duration="0.2", qvel={"hinge": 1.0})
    drift = ("drift", "max(abs(energy/drift))")
    Study(simulation, folder, vary=(("opt.timestep", "log:1e-3..1e-2:3"),), metric=(drift,), jobs=1).run()
    return folder


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_a_study_is_a_picture_and_the_same_bytes_again(study: str, suffix: str, tmp_path: Path) -> None:
    results = [StudyPlot(study, str(tmp_path / f"{i}.{suffix}"), size=(640, 480)).run() for i in range(2)]
    assert (tmp_path / f"0.{suffix}").read_bytes() == (tmp_path / f"1.{suffix}").read_bytes()
    assert (results[0].panels, results[0].rows, results[0].curves) == (["drift [J]"], [3], 1)
    if suffix == "png":
        with Image.open(tmp_path / "0.png") as image:
            assert image.size == (640, 480)


def test_a_study_has_a_page(study: str, tmp_path: Path) -> None:
    result = StudyPlot(study, html=str(tmp_path / "page.html")).run()
    assert (result.path, result.format) == (str(tmp_path / "page.html"), "html")
    assert "drift" in (tmp_path / "page.html").read_text("utf-8")


def test_what_a_study_cannot_have_is_reported(study: str) -> None:
    with pytest.raises(UsageError, match="applies to tables only"):
        StudyPlot(study, "a.png", label=("a",)).run()
    with pytest.raises(UsageError, match="one study"):
        StudyPlot([study, "b.csv"], "a.png").run()
    with pytest.raises(UsageError, match="include requires html"):
        StudyPlot(study, "a.png", include=("b.png",)).run()
    with pytest.raises(UsageError, match="nothing to make"):
        StudyPlot(study).run()


def test_columns_that_nobody_asks_for_may_hold_anything(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("time,a,b,name\n0,1,2,x\n1,3,4,y\n")
    with ExitStack() as stack:
        figure = TableFigure([str(file)], FigureOptions(y=["a"]), stack)
        summary = TableSummarizer(str(file), figure.units[str(file)], ["a"], ["max(b) == 4"])
        figure.read([summary])
        assert figure.rows == [2]
    assert [verdict.passed for verdict in summary.verdicts()] == [True]
    assert [column.name for column in summary.statistics()] == ["a", "b"]
    with ExitStack() as stack, pytest.raises(FileError, match="is not a number"):
        TableFigure([str(file)], FigureOptions(), stack).read()


def test_panels_stand_under_each_other_in_a_page(tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("time,a,b,c,d,e,f\n0,1,2,3,4,5,6\n1,3,4,5,6,7,8\n")
    with ExitStack() as stack:
        figure = TableFigure([str(file)], FigureOptions(y=list("abcdef")), stack)
        assert (figure.plan.grid.columns, figure.plan.page_grid().columns) == (2, 1)
        chosen = TableFigure([str(file)], FigureOptions(y=list("abcdef"), columns=3), stack)
        assert chosen.plan.page_grid().columns == 3


@pytest.mark.parametrize(("style", "follows"), [("light", True), ("dark", False), ("print", False)])
def test_a_figure_follows_its_page_unless_a_style_was_chosen(style: str, follows: bool, tmp_path: Path) -> None:
    file = tmp_path / "run.csv"
    file.write_text("time,a\n0,1\n1,3\n")
    with ExitStack() as stack:
        figure = TableFigure([str(file)], FigureOptions(style=style), stack)
        figure.read()
        assert ("var(--figure-ground)" in figure.for_page().svg) == follows


@cases("paths, names")
def test_names_are_short_and_tell_tables_apart(paths: list[str], names: list[str]) -> None:
    assert table_names(paths) == names


def test_files_of_points_are_called_by_the_values_in_which_they_differ(tmp_path: Path) -> None:
    paths = []
    for index, step in enumerate(["0.01", "0.02"]):
        folder = tmp_path / f"{index:06}"
        folder.mkdir()
        (folder / "point.json").write_text(json.dumps({"values": {"opt.timestep": step, "seed": "1"}}))
        paths.append(str(folder / "trace.parquet"))
    assert table_names(paths) == ["timestep 0.01", "timestep 0.02"]
    assert table_names([*paths, "other/trace.parquet"])[2] == "other"


def test_figures_have_sizes_and_letters_of_paper(tmp_path: Path) -> None:
    plot = TablePlot(table(tmp_path / "a.csv"), str(tmp_path / "a.svg"), size=(321, 227), font_size=8)
    plot.run()
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    sides = [float(str(root.get(name)).removesuffix("pt")) * 25.4 / 72 for name in ("width", "height")]
    np.testing.assert_allclose(sides, (85, 60), atol=25.4 / 96 / 2)
    letters = re.findall(r"font-size: ([0-9.]+)px", (tmp_path / "a.svg").read_text("utf-8"))
    assert max(map(float, letters)) == 8
    assert min(map(float, letters)) > 6
