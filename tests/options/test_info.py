"""Options of `mjrun info`."""

from mjrun.options.info import InfoOptions
from mjrun.options.option import FrontEnd, options_of


def test_a_list_of_columns_is_asked_for_on_the_command_line_alone() -> None:
    (columns,) = options_of(InfoOptions)
    assert (columns.name, columns.places, columns.default) == ("columns", FrontEnd.COMMAND, False)
