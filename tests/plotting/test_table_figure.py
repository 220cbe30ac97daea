"""A table in memory is plotted as its file is."""

import re
from pathlib import Path

import numpy as np
import pytest

from mjrun.errors import UnknownNameError, UsageError
from mjrun.plotting.table_and_study_plot import TablePlot
from mjrun.plotting.table_figure import Figure, Table, read_table

TIME = np.linspace(0, 1, 50)
TABLE = Table({"time": TIME, "qpos/a": np.sin(9 * TIME), "qpos/b": TIME**2}, {"time": "s", "qpos/a": "rad"})


def curves(svg: str) -> list[str]:
    """Returns the paths of a figure that are long enough to be curves."""
    return [path for path in re.findall(r' d="([^"]+)"', svg) if path.count("L") > 10]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "t.csv"
    rows = [
        ",".join(TABLE.names),
        *(",".join(map(repr, map(float, row))) for row in zip(*TABLE.columns.values(), strict=True)),
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_curves_are_those_of_the_file(file: Path, tmp_path: Path) -> None:
    TablePlot(file, tmp_path / "p.svg", y=["qpos/*"]).run()
    figure = read_table(file).plot(y=["qpos/*"])
    assert curves(figure.svg) == curves((tmp_path / "p.svg").read_text())
    assert len(curves(figure.svg)) == 2
    assert curves(figure._repr_svg_()) == curves(figure.svg)
    assert figure._repr_svg_().startswith('<svg style="max-width: 100%; height: auto"')
    assert repr(figure).startswith("Figure of 1280x720 pixels: qpos")
    for suffix in ("svg", "png", "pdf"):
        figure.save(tmp_path / f"saved.{suffix}")
        assert (tmp_path / f"saved.{suffix}").stat().st_size > 1000
    assert curves((tmp_path / "saved.svg").read_text()) == curves(figure.svg)


def test_wrong_names_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="qpos/c"):
        TABLE.plot(y="qpos/c")
    with pytest.raises(TypeError, match=re.escape("plot: unknown option 'titel' (did you mean 'title'?)")):
        TABLE.plot(titel="x")
    assert isinstance(TABLE.plot(title="x", size=(640, 480)), Figure)


@pytest.mark.parametrize(
    ("options", "axis"), [({}, "ylim"), ({"ylim": "-1.7e308..1.7e308"}, "ylim"), ({"x": "a"}, "xlim")]
)
def test_values_too_far_apart_for_an_axis_are_refused_with_the_option_that_limits_it(
    options: dict[str, str], axis: str
) -> None:
    values = {"time": np.arange(3.0), "a": np.array([-1.7e308, 1.7e308, 0]), "b": np.arange(3.0)}
    chosen = {"y": "b" if "x" in options else "a", **options}
    with pytest.raises(UsageError, match=f"too far apart.*\n.*{axis}"):
        _ = Table(values, dict.fromkeys(values, "")).plot(**chosen).svg
