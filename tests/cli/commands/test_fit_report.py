"""What people read of a fit."""

from mjrun.cli.commands.fit import excitation_report, fit_report
from mjrun.fitting.excitation import ExcitationResult, ExpectedParameterInterval, MotionExtent
from mjrun.fitting.result import FitResult, FittedInertia, FittedParameter, FittedSignal, InertiaQuantity

PARAMETERS = [
    FittedParameter("joint/a.damping", 0.1, 0.25, 0.2, 0.3, 900.0, ""),
    FittedParameter("joint/a.armature", 0.1, 0.5, 0.4, 0.5, 900.0, "high"),
]
SIGNALS = [FittedSignal("qpos/a", "rad", 0.002, 1.0, 0.5, 0.01, None, None)]


def report(**changes: object) -> str:
    values = {
        "parameters": PARAMETERS,
        "inertias": [],
        "signals": SIGNALS,
        "reduced_chi2": 1.0,
        "ways": ["whole segments"],
        "correlation": [[1.0, -0.97], [-0.97, 1.0]],
        "confidence": 0.95,
        "condition": 10.0,
        "rows": 1200,
        "segments": 1,
        "rollouts": 5000,
        "changes": ["a.xml:3: damping = 0.25"],
        "remarks": [],
        "files": ["fitted.xml"],
        "wall": 1.5,
    }
    return fit_report(FitResult(**{**values, **changes}))  # type: ignore[arg-type]


def test_it_says_what_was_found_and_how_well_it_is_known() -> None:
    text = report()
    for part in ("95 % interval", "0.2 … 0.3", "at its high bound", "-0.970", "a.xml:3: damping = 0.25", "1,200 rows"):
        assert part in text
    assert "held out" not in text


def test_errors_on_what_was_held_out_are_shown_if_something_was() -> None:
    text = report(signals=[FittedSignal("qpos/a", "rad", 0.002, 1.0, 0.5, 0.01, 0.6, 0.0123)])
    assert "held out, before" in text
    assert "1.23 %" in text


def test_inertias_are_shown_in_their_units() -> None:
    mass = InertiaQuantity("mass", "kg", 0.7, 1.4, 1.39, 1.42)
    moment = InertiaQuantity("moment/1", "kg m²", 0.0028, 0.0028, 0.0028, 0.0028)
    text = report(inertias=[FittedInertia("payload", [mass, moment])])
    assert "1.39 … 1.42" in text
    assert "0.0028 … 0.0028" not in text  # it was not looked for
    assert "kg m²" in text


def test_an_input_is_reported_with_what_to_expect_of_it() -> None:
    parameter = ExpectedParameterInterval("joint/a.damping", 0.1, 0.09, 0.12, 80.0)
    motion = [MotionExtent("qpos/a", "rad", -0.5, 0.7, -1.0, 1.0), MotionExtent("qpos/b", "m", 0.0, 0.1, None, None)]
    text = excitation_report(
        ExcitationResult([parameter], motion, 0.9, 0.001, 2.0, 10.0, 12, 4, [], ["chirp.csv"], 1.5),
    )
    for part in (
        "expected 90 % interval",
        "0.09 … 0.12",
        "-1 … 1",
        "chirp.csv",
        "the best of 12 inputs",
        "at 4 corners",
    ):
        assert part in text
