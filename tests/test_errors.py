"""Theorems about errors: their exit codes, their sentences, and that foreign text cannot steer a terminal."""

import inspect
import json
import math
import signal
from pathlib import Path
from traceback import format_exception_only

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mjrun import errors
from mjrun.errors import (
    FAULTS,
    LINE,
    LISTED,
    LOGGED,
    QUOTED,
    BadValueError,
    BrokenModelError,
    ClosedPipeError,
    CompiledOverrideError,
    DocumentError,
    DocumentProblem,
    EncoderError,
    EndRequestedError,
    FailedEpisodesError,
    FailedPointsError,
    FailedStepError,
    FailureReport,
    FileError,
    MjrunError,
    ModelNotFoundError,
    NoRendererError,
    PartlyDoneError,
    SoftwareRendererError,
    TerminatedError,
    UnknownNameError,
    UnmadeFilesError,
    UnstableError,
    UsageError,
    clean,
    listing,
    near,
    option,
    suggestion,
)
from tests.cases import cases

CODES = {
    "MjrunError": 70,
    "FailedAssertionError": 1,
    "UsageError": 2,
    "MissingExtraError": 2,
    "WrongVersionError": 2,
    "UnknownNameError": 2,
    "BadValueError": 2,
    "DocumentError": 2,
    "CompiledOverrideError": 2,
    "ModelError": 3,
    "ModelNotFoundError": 3,
    "BrokenModelError": 3,
    "SimulationError": 4,
    "ContactMemoryError": 4,
    "FailedStepError": 4,
    "UnstableError": 4,
    "RendererError": 5,
    "NoRendererError": 5,
    "SoftwareRendererError": 5,
    "DrawError": 5,
    "EncoderError": 6,
    "FileError": 7,
    "SystemLimitError": 7,
}
DOCUMENTED = {1, 2, 3, 4, 5, 6, 7, 8}
CLASSES = [c for _, c in inspect.getmembers(errors, inspect.isclass) if issubclass(c, MjrunError)]
CLAIMED = [c for c in CLASSES if c is not MjrunError]

EVIL = "a\x1b[31mb\nc\0d\u202ee\u2028f\x9bg"
TAME = r"a\x1b[31mb\nc\x00d\u202ee\u2028f\x9bg"
EVIL_PATH = Path("models") / EVIL


@pytest.mark.parametrize(("name", "code"), CODES.items())
def test_every_cause_has_the_exit_code_that_the_design_gives_it(name: str, code: int) -> None:
    assert getattr(errors, name).exit_code == code


@pytest.mark.parametrize("kind", CLAIMED)
def test_every_error_but_a_bug_has_a_documented_code_which_is_that_of_its_cause(
    kind: type[MjrunError],
) -> None:
    assert kind.exit_code in DOCUMENTED
    assert all(kind.exit_code == base.exit_code for base in kind.__mro__ if base in CLAIMED)


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (EndRequestedError(), 130),
        (TerminatedError(signal.SIGTERM), 143),
        (TerminatedError(signal.SIGHUP), 129),
        (ClosedPipeError(), 141),
    ],
)
def test_an_end_from_outside_exits_as_a_shell_expects_and_no_handler_of_errors_swallows_it(
    end: EndRequestedError, code: int
) -> None:
    assert end.exit_code == code
    assert not isinstance(end, Exception)


def test_a_signal_is_called_by_its_name() -> None:
    assert str(TerminatedError(signal.SIGTERM)) == "SIGTERM"


@pytest.mark.parametrize(
    ("foreign", "visible"),
    [
        ("\x1b[2J", r"\x1b[2J"),
        ("a\nb", r"a\nb"),
        ("a\rb", r"a\rb"),
        ("a\tb", r"a\tb"),
        ("a\0b", r"a\x00b"),
        ("\x7f", r"\x7f"),
        ("\x9b31m", r"\x9b31m"),
        ("\u202eexe", r"\u202eexe"),
        ("\u2066", r"\u2066"),
        ("\u200b", r"\u200b"),
        ("\ufeff", r"\ufeff"),
        ("\u2028\u2029", r"\u2028\u2029"),
        ("\ud800", r"\ud800"),
        ("\U000e0041", r"\U000e0041"),
    ],
)
def test_characters_that_steer_or_hide_are_made_visible(foreign: str, visible: str) -> None:
    assert clean(foreign) == visible


@pytest.mark.parametrize(
    "text",
    ["", "left_knee", "arm/hand.0", "café", "Ünïcödé", "e\u0301", "日本語", "🚗", "❤️", "👍🏽", "a b", "it's", "\\"],
)
def test_letters_accents_and_emoji_stay_as_they_are(text: str) -> None:
    assert clean(text) == text


@given(st.text(st.characters()))
def test_cleaned_text_is_one_line_that_any_terminal_takes_and_cleaning_again_changes_nothing(text: str) -> None:
    cleaned = clean(text)
    assert len(cleaned.splitlines()) <= 1
    assert cleaned.encode("utf-8").decode("utf-8") == cleaned
    assert clean(cleaned) == cleaned
    assert (cleaned == text) or not text.isprintable()


@cases("name, valid, found")
def test_near_names_come_best_first_whatever_their_case(name: str, valid: list[str], found: list[str]) -> None:
    assert near(name, valid) == found


def test_names_that_differ_only_in_case_are_both_near() -> None:
    assert sorted(near("arn", ["arm", "Arm", "torso"])) == ["Arm", "arm"]


def test_at_most_three_near_names_are_given() -> None:
    assert len(near("knee0", [f"knee{i}" for i in range(1, 9)])) == 3


def test_a_suggestion_is_a_question_in_brackets_or_nothing() -> None:
    assert suggestion("flor", ["floor", "ball"]) == " (did you mean 'floor'?)"
    assert suggestion("qpso/*", ["time", "qpos/knee", "qpos/hip", "energy/total"]) == " (did you mean 'qpos/*'?)"
    assert suggestion("knee", ["knee_12", "knee1"]) == " (did you mean 'knee1' or 'knee_12'?)"
    assert suggestion("xyz", ["floor"]) == ""
    columns = ["cvel/top/wx", "cvel/top/wy", "cvel/top/wz", "qvel/joint:0/vx", "qvel/joint:0/wx"]
    alike = " (did you mean 'cvel/top/wx' or 'qvel/joint:0/wx' or 'cvel/top/wz'?)"  # also one of the same group
    assert suggestion("qvel/top/wx", columns) == alike


def test_a_name_of_any_length_makes_a_message_of_few_lines_that_says_what_and_where() -> None:
    name = "x" * 500_000
    assert near(name, [name]) == []
    assert str(UnknownNameError("key", name, [name[:-1]])).startswith("no key 'xxx")
    for error in (UnknownNameError("key", name, ["a"]), FileError(name, "no such file", "look elsewhere")):
        assert all(len(line) <= LINE for line in error.spelled(str).splitlines())
    assert str(error).endswith("xxx: no such file\nlook elsewhere")
    assert str(UnknownNameError("key", name, ["a"])) == f"no key '{'x' * (QUOTED - 1)}…'\nkeys: a"


def test_a_list_is_cut_only_when_it_is_long_and_then_says_how_long() -> None:
    names = [f"n{i}" for i in range(LISTED + 1)]
    assert listing(names[:LISTED]) == ", ".join(names[:LISTED])
    assert listing(names) == f"{', '.join(names[:LISTED])}, … ({LISTED + 1} in all)"


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (
            UnknownNameError("geom", "flor", ["floor", "ball"]),
            "no geom 'flor' (did you mean 'floor'?)\ngeoms: floor, ball",
        ),
        (
            UnknownNameError("body", "x", ["world"], where="track:", plural="bodies"),
            "no body 'x' in track:\nbodies: world",
        ),
        (UnknownNameError("keyframe", "home", []), "no keyframe 'home'\nthere are no keyframes"),
        (BadValueError("--fps", -3, "a positive number"), "--fps: '-3' is not a positive number"),
        (
            DocumentError(
                [DocumentProblem("a.yaml:1:2", "shots[0]", "is bad"), DocumentProblem("a.yaml", "", "is worse")]
            ),
            "a.yaml:1:2: shots[0]: is bad\na.yaml: is worse",
        ),
        (
            ModelNotFoundError(Path("d/flor.xml"), "no such file", ["floor.xml"], "models in d"),
            "d/flor.xml: no such file (did you mean 'floor.xml'?)\nmodels in d: floor.xml",
        ),
        (ModelNotFoundError(Path("d"), "is a folder"), "d: is a folder"),
        (BrokenModelError(Path("m.xml"), "bad\n\nElement 'geom'", 3, "with x"), "m.xml:3: bad\nElement 'geom'\nwith x"),
        (BrokenModelError(Path("m.xml"), ""), "m.xml: cannot be read"),
        (FileError("o.mp4", "is a folder"), "o.mp4: is a folder"),
        (FileError(Path("o.mp4"), "is a folder", "name a file"), "o.mp4: is a folder\nname a file"),
        (FileError(f"{Path('s3://b/t.csv')}:3", "no number"), "s3://b/t.csv:3: no number"),
        (FileError(Path("file:///b/t.csv"), "no number"), "file:///b/t.csv: no number"),
        (EncoderError("ffmpeg failed", "one\n\ntwo\n"), "ffmpeg failed\n  one\n  two"),
        (
            NoRendererError({"egl": "no device", "osmesa": "no library"}, "install one"),
            "no working renderer was found\n  egl: no device\n  osmesa: no library\ninstall one",
        ),
    ],
)
def test_the_first_line_says_what_and_where_and_further_lines_what_is_valid_and_what_to_do(
    error: MjrunError, message: str
) -> None:
    assert str(error) == message


@pytest.mark.parametrize(("hidden", "last"), [(1, "… and 1 more problem"), (7, "… and 7 more problems")])
def test_of_a_document_with_very_many_problems_the_first_are_shown_and_the_others_counted(
    hidden: int, last: str
) -> None:
    problems = [DocumentProblem("a.yaml", "", f"problem {i}") for i in range(FAULTS + hidden)]
    assert str(DocumentError(problems[:FAULTS])).splitlines() == [f"a.yaml: problem {i}" for i in range(FAULTS)]
    assert str(DocumentError(problems)).splitlines() == [f"a.yaml: problem {i}" for i in range(FAULTS)] + [last]


def test_a_compiled_model_names_the_overrides_that_it_cannot_take_and_the_way_out() -> None:
    overrides = [("timestep", "0.1"), ("set", "opt.cone=elliptic")]
    first, second = str(CompiledOverrideError(Path("m.mjb"), overrides)).splitlines()
    assert first.startswith("m.mjb is compiled: timestep 0.1, set opt.cone=elliptic ")
    assert ".xml" in second


def test_an_unstable_simulation_names_the_step_the_time_the_joint_and_two_cures() -> None:
    error = UnstableError(7, 0.014, "the velocity", "joint 'knee'", 0.002)
    assert (error.step, error.time, error.joint) == (7, 0.014, "joint 'knee'")
    first, second = str(error).splitlines()
    assert first.endswith("at step 7, time 0.014 s: the velocity of joint 'knee' is not finite or too large")
    assert "timestep smaller than 0.002 s" in second
    assert "integrator" in second


def test_of_a_long_log_the_beginning_is_shown_where_the_cause_is_and_the_last_line() -> None:
    log = [f"line {i}" for i in range(LOGGED + 1)]
    assert str(EncoderError("failed", "\n".join(log[:LOGGED]))) == "\n  ".join(["failed", *log[:LOGGED]])
    assert str(EncoderError("failed", "\n".join(log))) == "\n  ".join(["failed", *log[: LOGGED - 2], "…", log[-1]])


def test_a_step_that_mujoco_could_not_finish_is_told_with_its_reason() -> None:
    error = FailedStepError(7, 0.014, "mj_stackAlloc: out of memory\n  max = 19200")
    assert (error.step, error.time) == (7, 0.014)
    assert str(error) == "MuJoCo failed at step 7, time 0.014 s: mj_stackAlloc: out of memory\nmax = 19200"


def test_where_the_memory_that_a_model_sets_apart_is_too_small_the_message_says_what_to_set() -> None:
    error = FailedStepError(0, 0.0, "mj_stackAlloc: out of memory\n  max = 1, narena = 1")
    assert str(error).endswith("\nthe memory that the model reserves is too small; increase it by set size.memory=100M")


@pytest.mark.parametrize(
    ("error", "lines"),
    [
        (UnknownNameError("geom", EVIL, ["floor"]), 2),
        (UnknownNameError("geom", "floor", [EVIL]), 2),
        (UnknownNameError("geom", EVIL, [EVIL + "x"]), 2),
        (BadValueError("size", EVIL, "a number"), 1),
        (DocumentError([DocumentProblem(EVIL, EVIL, EVIL), DocumentProblem(EVIL, "", "is bad")]), 2),
        (CompiledOverrideError(EVIL_PATH, [("set", EVIL)]), 2),
        (ModelNotFoundError(EVIL_PATH, "no such file", [EVIL, EVIL + "x"], EVIL), 2),
        (BrokenModelError(EVIL_PATH, EVIL.replace("\n", "").replace("\u2028", "")), 1),
        (UnstableError(1, 0.1, "the velocity", EVIL, 0.1), 2),
        (FailedStepError(1, 0.1, EVIL.replace("\n", "").replace("\u2028", "")), 1),
        (NoRendererError({"egl": EVIL}, "install one"), 3),
        (SoftwareRendererError(EVIL), 2),
        (EncoderError("failed", EVIL.replace("\n", "").replace("\u2028", "")), 2),
        (FileError(EVIL_PATH, "is a folder"), 1),
    ],
)
def test_foreign_text_adds_no_line_and_no_control_character_to_a_message(error: MjrunError, lines: int) -> None:
    found = str(error).splitlines()
    assert len(found) == lines
    assert [clean(line) for line in found] == found


def test_the_foreign_name_of_a_file_is_still_recognisable() -> None:
    assert str(FileError(EVIL, "is a folder")) == f"{TAME}: is a folder"


def test_a_failure_is_plain_json_with_the_facts_of_its_error() -> None:
    unknown = FailureReport.of(UnknownNameError("joint", "knee", ("hip", "toe")))
    assert unknown.document() == {
        "name": "knee",
        "valid": ["hip", "toe"],
        "kind": "UnknownNameError",
        "message": "no joint 'knee'\njoints: hip, toe",
        "exit_code": 2,
    }
    invalid = FailureReport.of(DocumentError([DocumentProblem("a.yaml:1:2", "fps", "expected a number")]))
    assert invalid.document()["problems"] == [{"place": "a.yaml:1:2", "path": "fps", "message": "expected a number"}]
    diverged = UnstableError(6, math.inf, "qacc", "hinge", 0.01)
    assert json.loads(json.dumps(FailureReport.of(diverged).document(), allow_nan=False))["time"] == "inf"
    assert FailureReport.of(UsageError(f"{option('trail_span')}: wrong")).message == "--trail-span: wrong"


FOREIGN = "a\x1b[31m\x07\u202e\r\x9b2Kz"


@pytest.mark.parametrize(
    "error",
    [
        PartlyDoneError([f"made {FOREIGN}"], [(f"out {FOREIGN}", FileError(FOREIGN, FOREIGN, FOREIGN))]),
        PartlyDoneError([FOREIGN], [(f"out {FOREIGN}", MjrunError(FOREIGN)), (f"out {FOREIGN}", UsageError(FOREIGN))]),
        UnmadeFilesError({3: f"out {FOREIGN}: cannot be written"}),
        FailedPointsError({f"out {FOREIGN}": 1, "ok": 2}),
        FailedEpisodesError({f"seed {FOREIGN}": f"out {FOREIGN}"}, 2, "table"),
    ],
)
def test_messages_of_what_is_partly_done_name_the_outputs_and_steer_no_terminal(error: MjrunError) -> None:
    error.add_note(FOREIGN)
    for text in (str(error), error.spelled(str.upper)):
        assert all(clean(line) == line for line in text.split("\n"))
        assert f"out {clean(FOREIGN)}" in text
    assert error.exit_code == 8


def test_a_message_keeps_its_lines_and_options_when_it_is_cleaned() -> None:
    error = FileError("a.csv", f"is wrong\n{option('trail_span')} \x1bhelps", "so does this")
    error.add_note(f"or {option('fps')} \x1bhelps")
    assert error.spelled(str.upper) == "a.csv: is wrong\nTRAIL_SPAN \\x1bhelps\nso does this\nor FPS \\x1bhelps"
    assert "".join(format_exception_only(error)).endswith("\nso does this\nor fps \\x1bhelps\n")


def test_long_texts_are_cut() -> None:
    assert errors.shortened("x" * 80) == "x" * 80
    assert errors.shortened("x" * 81) == "x" * 79 + "…"


def test_the_unit_of_a_column_does_not_matter_for_suggestions() -> None:
    assert near("vel", ["time [s]", "vel [m/s]"]) == ["vel [m/s]"]
    assert near("velo [m/s]", ["vel [km/h]", "acc [m/s]"]) == ["vel [km/h]"]
    assert near("qpos[1]", ["qpos[0]"]) == ["qpos[0]"]


def test_of_many_names_their_groups_are_listed_or_those_of_the_same_group() -> None:
    names = ["time", *(f"qpos/{i}" for i in range(1500)), "contact/ncon"]
    assert str(UnknownNameError("column", "foo", names)).endswith(
        "\ncolumns: time, qpos/*, contact/ncon (1,502 in all)"
    )
    assert "columns: qpos/0, qpos/1, " in str(UnknownNameError("column", "qpos/x", names))
    assert str(UnknownNameError("column", "foo", [f"n{i}" for i in range(1500)])).endswith("… (1,500 in all)")
