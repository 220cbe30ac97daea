"""Options of `mjrun run`: what a document leaves to the command line."""

from mjrun.options.option import FrontEnd, options_of
from mjrun.options.run import RunOptions
from mjrun.options.video import VideoOptions


def test_no_document_knows_them() -> None:
    assert all(FrontEnd.DOCUMENT not in each.places for each in options_of(RunOptions))


def test_left_out_they_change_nothing() -> None:
    options = RunOptions()
    assert (options.output, options.quality, options.jobs, options.gl, options.controller) == (".", *[None] * 4)


def test_quality_and_jobs_take_what_those_of_a_video_take() -> None:
    of_video = {each.name: each for each in options_of(VideoOptions)}
    for each in options_of(RunOptions):
        if each.name in ("quality", "jobs"):
            assert each.kind.metavar == of_video[each.name].kind.metavar
