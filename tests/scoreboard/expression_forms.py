"""Hostile expressions: deep, huge, of code, of look-alikes; wherever an expression is taken."""

from collections.abc import Iterator

from tests.scoreboard.data import inputs_of
from tests.scoreboard.document_forms import STUDY, TASK
from tests.scoreboard.input_forms import Form

# Where a number is taken, and where a condition is; {} is the expression.
INPUTS = inputs_of(__name__)
NUMBERS = INPUTS["NUMBERS"]
X = "qpos/hinge"
CODE = INPUTS["CODE"]
BAD = (
    "",
    " ",
    "(" * 5000,
    "(" * 200 + X + ")" * 200,
    "-" * 5000 + X,
    "not " * 2000 + X,
    f"{X} +",
    f"+ * {X}",
    f"{X} {X}",
    f"{X} = 1",
    f"{X} & 1",
    f"{X} ≤ 1",
    "qpos/hіnge",  # a Cyrillic і
    "ｑpos/hinge",
    "qpos∕hinge",
    f"{X} − 1",
    f"{X} × 2",
    f"{X}²",
    f"\u202e{X}",
    f"\x1b[2J{X}",
    f"{X}\u200b",
    f"'{X}",
    '"qpos/hinge',
    "qpos/nothing",
    "xpos/nothing/x",
    "nothing()",
    f"sin({X}, {X})",
    "sin()",
    f"clip({X})",
    f"where({X}, 1, 2)",
    f"where({X} > 0)",
    "1e999 + qpos/hinge",
    "9" * 400 + f" + {X}",
    f"1 < {X} < 2 + (1 < 2)",
    f"{X} > 1 > ",
    f"max(max({X}) > 1)",
    f"quantile({X})",
    f"quantile({X}, 2)",
    "0x10 + qpos/hinge",
    "1_000 + qpos/hinge",
    "1j * qpos/hinge",
    " + ".join([X] * 3000),
    f"norm({', '.join([X] * 2500)})",
    "\n" * 500 + f"{X} )",
    "qpos/" + "h" * 9000,
    "'" + "*?" * 2000 + "x'",
)
GOOD = (
    f"9^9^9 * {X}",
    f"9**9**9**9**9**9 + {X}",
    f"{X} / 0",
    f"0 / 0 * {X}",
    f"(-1)^0.5 + {X}",
    f"log(-1) + sqrt(-1) + {X}",
    f"exp(exp(exp(exp(9)))) + {X}",
    f"1e308 * 10 * {X}",
    f"inf - inf + {X}",
    "(" * 80 + X + ")" * 80,
    " + ".join([X] * 700),
    f"{X}" + " " * 5000,
    "tan(" * 40 + X + ")" * 40,
    f"sin(9^{'9' * 300}) + {X}",
    "norm('" + "*" * 5000 + "')",
)


def _line(form: tuple[str, ...], text: str) -> tuple[str, ...]:
    return tuple(word.replace("{}", text) for word in form)


def forms() -> Iterator[Form]:
    places = list(NUMBERS)
    for index, text in enumerate((*CODE, *BAD)):
        for place in {"assert", places[index % len(places)]}:
            yield Form(
                f"expression {text[:40]!a}, {place}",
                _line(NUMBERS[place], text),
                _refused(text, place),
                quick=place == "assert",
            )
    for index, text in enumerate(GOOD):
        for place in {"assert", places[index % len(places)]}:
            yield Form(
                f"expression {text[:40]!a}, {place}", _line(NUMBERS[place], text), _taken(place), quick=index % 3 == 0
            )
    yield from _elsewhere()


def _refused(text: str, place: str) -> tuple[int, ...]:
    if place == "map" and text.startswith("@"):
        return (2, 7)
    return (2,)


def _taken(place: str) -> tuple[int, ...]:
    """Numbers may be infinite or none: an assertion fails then, a position cannot be so, an instant never comes."""
    return {"assert": (0, 1), "map": (0, 2, 7), "still": (0, 1, 2), "metric": (0,)}.get(place, (0,))


def _elsewhere() -> Iterator[Form]:
    hostile = (CODE[0], CODE[3], "(" * 5000, "qpos/hіnge > 0", f"\x1b[2J{X} > 0", "", f"{X} > ", "9" * 400 + " > 1")
    for text in hostile:
        name = ascii(text[:30])
        point = {"sweep where": "--where", "sweep require": "--require", "sweep keep where": "--keep-where"}
        for what, flag in point.items():
            line = (
                "sweep",
                "m.xml",
                "--steps",
                "2",
                "--vary",
                "seed=1,2",
                "--metric",
                "x=max(qpos/hinge)",
                "--keep",
                "trace",
            )
            yield Form(f"{what} {name}", (*line, flag, text, "--dry-run"), (2,))
        quoted = "'" + text.replace("'", "''").replace("\x1b", "") + "'"
        study = STUDY.replace("last(qpos/hinge)", quoted)
        yield Form(f"metric of a document {name}", ("sweep", "d.yaml", "--dry-run"), (2,), {"d.yaml": study})
        for key in ("rewards: {upright: cos(qpos/hinge)}", "probe: qpos/hinge"):
            new = f"rewards: {{upright: {quoted}}}" if key.startswith("rewards") else f"value: {quoted}"
            task = TASK.replace(key, new)
            line = ("trace", "d.yaml", "--policy", "zero", "-o", "new.csv")
            yield Form(f"task's {key.split(':')[0]} {name}", line, (2,), {"d.yaml": task})
        task = f"{TASK}terminations: {{fallen: {{when: {quoted}}}}}\n"
        yield Form(f"task's termination {name}", ("check", "d.yaml"), (1, 2, 3), {"d.yaml": task})
        line = ("eval", "d.yaml", "--policy", "zero", "--episodes", "1", "--jobs", "1", "-o", "new")
        for flag, value in (("--metric", f"x={text}"), ("--require", text)):
            yield Form(f"eval {flag} {name}", (*line, flag, value), (2,), {"d.yaml": TASK})
        for value in (f"joint/hinge.damping={text}", f"{text}=0..1", f"joint/hinge.damping=0.1..1~{text}"):
            yield Form(f"fit --free {value[:40]!a}", ("fit", "m.xml", "good.csv", "--free", value), (2,))
        for value in (f"qpos/hinge={text}", f"{text}=1", f"joint/hinge.damping=uniform({text})"):
            line = ("sweep", "m.xml", "--steps", "2", "--metric", "x=max(qpos/hinge)", "--dry-run", "--vary", value)
            yield Form(f"sweep --vary {value[:40]!a}", line, (2,))
    for value in (
        "seed=1..1e300:40",
        "seed=1..2:1e15",
        "qpos/hinge=0..1:999999999999",
        "seed=1..40:-1",
        "qpos/hinge=nan,inf",
    ):
        line = ("sweep", "m.xml", "--steps", "2", "--metric", "x=max(qpos/hinge)", "--dry-run", "--vary", value)
        yield Form(f"sweep --vary {value}", line, (2,))
    for samples in ("1e300", "99999999999999", "-1", "0", "nan"):
        line = ("sweep", "m.xml", "--steps", "2", "--vary", "qpos/hinge=uniform(0,1)", "--metric", "x=max(qpos/hinge)")
        yield Form(f"sweep --samples {samples}", (*line, "--samples", samples, "--dry-run"), (2,))
