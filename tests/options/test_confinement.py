"""Options of work on files nobody vouches for."""

from mjrun.options.confinement import ConfinementOptions
from mjrun.options.option import FrontEnd, options_of


def test_no_document_and_no_program_chooses_what_is_trusted() -> None:
    assert {each.places for each in options_of(ConfinementOptions)} == {FrontEnd.COMMAND}


def test_limits_are_numbers_by_name() -> None:
    made = ConfinementOptions(untrusted=True, limit={"time": 60, "memory": 512})
    assert made.limit == {"time": (60.0,), "memory": (512.0,)}
