"""What once ended in an exception that is not ours, as small as it could be made; each is tried for ever.

A crasher is the file to write, its text, the command line, and the exit codes that it must have.
"""

from collections.abc import Sequence

Crasher = tuple[str, str | bytes, Sequence[str], frozenset[int]]

TRACE = ("trace", "model.xml", "--steps", "1")
CRASHERS: Sequence[Crasher] = (
    # An encoding that Python knows, and that is none of text.
    ("model.xml", '<?xml version="1.0" encoding="rot13"?><mujoco/>', TRACE, frozenset({0, 3})),
    # A timestep whose times are no numbers.
    ("model.xml", '<mujoco><option timestep="1e308"/></mujoco>', TRACE, frozenset({3})),
)
