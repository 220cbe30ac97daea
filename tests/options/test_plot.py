"""Options of plots."""

import pytest

from mjrun.errors import BadValueError
from mjrun.options.option import options_of
from mjrun.options.plot import FigureOptions, PlotOptions, TablePlotOptions


def test_plots_of_tables_and_of_simulations_look_alike() -> None:
    shared = {each.name for each in options_of(FigureOptions)}
    for cls in (PlotOptions, TablePlotOptions):
        assert shared < {each.name for each in options_of(cls)}


def test_a_panel_keeps_its_commas_and_axes_are_separated_by_them() -> None:
    options = FigureOptions(y=["max(a, b), c", "d"], log="x,2:y")
    assert (options.y, options.log) == (("max(a, b), c", "d"), ("x", "2:y"))


def test_one_value_alone_will_do() -> None:
    options = FigureOptions(y="qpos", mark="m·g=87.356", mark_event="contact(a, b)")
    assert (options.y, options.mark, options.mark_event) == (("qpos",), ("m·g=87.356",), ("contact(a, b)",))


@pytest.mark.parametrize("how", [{"style": "pink"}, {"columns": 0}, {"columns": 9}, {"size": (0, 5)}, {"log": ""}])
def test_what_no_figure_has_is_refused(how: dict[str, object]) -> None:
    with pytest.raises(BadValueError):
        FigureOptions(**how)  # type: ignore[arg-type]
