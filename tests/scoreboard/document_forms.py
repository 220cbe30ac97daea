"""Hostile documents: YAML that is none, that explodes, that asks for code or other files, of wrong types everywhere."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import BETWEEN, Content, Form

RUN = "model: m.xml\nduration: 0.05\ntraces:\n  - {output: new.csv, probe: qpos}\n"
STUDY = "model: m.xml\nsteps: 2\nvary: {qpos/hinge: [0.1, 0.2]}\nmetrics: {x: last(qpos/hinge)}\n"
FIT = "model: m.xml\ndata: [good.csv]\nfree: {joint/hinge.damping: 0.01..1}\nstarts: 1\n"
INPUTS = inputs_of(__name__)
TASK = INPUTS["TASK"]
# Of each kind: a good one, the command that reads d.yaml, and a key of text, of a number, of a list, of a mapping.
KINDS: Mapping[str, tuple[str, tuple[str, ...]]] = INPUTS["KINDS"]
LAUGHS = "a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)
TAGS = INPUTS["TAGS"]


def texts() -> Iterator[tuple[str, bytes | str]]:
    """What no document of any kind may hold, in place of, or after, a good one; `{good}` is that."""
    yield "empty", ""
    yield "only comments", "# nothing\n"
    yield "null", "null\n"
    yield "a list", "- model: m.xml\n"
    yield "a text", "model m.xml\n"
    yield "two documents", "{good}---\nmodel: m.xml\n"
    yield "aliases that explode", f"{LAUGHS}{{good}}"
    yield "an alias of itself", "{good}self: &self [*self]\n"
    yield "merge keys", "base: {model: m.xml}\n<<: {seed: 1}\n{good}"
    for tag in TAGS:
        yield f"the tag {tag.split()[0]}", f"{{good}}seed: {tag}\n"
    yield "a directive", "%YAML 1.1\n---\n{good}"
    yield "a key twice", "{good}model: other.xml\n"
    yield "1,000 lists in each other", "{good}seed: " + "[" * 1000 + "]" * 1000 + "\n"
    yield "100,000 open brackets", "{good}seed: " + "[" * 100_000
    yield "100,000 dashes", "{good}seed:\n" + "- " * 100_000 + "1\n"
    yield "20,000 unknown keys", "{good}" + "".join(f"unknown_{i}: 1\n" for i in range(20_000))
    yield "a key of half a megabyte", "{good}" + "k" * 500_000 + ": 1\n"
    yield "a value of half a megabyte", "{good}seed: " + "v" * 500_000 + "\n"
    yield "two megabytes", "{good}# " + "c" * 2_000_000 + "\n"
    yield "tabs", "{good}push:\n\t- arm=0/0/1@0+1\n"
    yield "a NUL", "{good}seed: 1\0\n"
    yield "an escaped NUL in the model", 'model: "m\\0.xml"\n'
    yield "escape sequences", "{good}seed: \x1b[2J\n"
    yield "escape sequences that are escaped", '{good}"\\e[2J\\e]0;owned\\a": "\\e[2J"\n'
    yield "marks of direction", "{good}# \u202e\nse\u202eed: 1\n"
    yield "half a character", '{good}seed: "\\ud800"\n'
    yield "no character", '{good}seed: "\\UFFFFFFFF"\n'
    yield "UTF-16", "model: m.xml\n".encode("utf-16")
    yield "Latin-1", "model: gr\xf6\xdfe.xml\n".encode("latin-1")
    yield "binary", bytes(range(256)) * 4
    yield "a number where a text is due", "{good}key: [1, 2]\n"
    yield "truth in words", "{good}seed: yes\n"
    yield "an integer in words", "{good}seed: seven\n"
    yield "a date", "{good}seed: 2001-01-01\n"
    yield "sixty seconds", "{good}seed: 1:30:00\n"
    yield "an integer of 5,000 digits", f"{{good}}seed: {'9' * 5000}\n"
    yield "a seed of 31 digits", f"{{good}}seed: {'9' * 31}\n"
    yield "a negative seed", "{good}seed: -1\n"
    yield "a seed that is not whole", "{good}seed: 1.5\n"
    yield "an infinite timestep", "{good}timestep: .inf\n"
    yield "no number for a timestep", "{good}timestep: .nan\n"
    yield "a mapping for a number", "{good}timestep: {a: 1}\n"
    yield "nothing for a number", "{good}timestep:\n"
    yield "code", "{good}controller: evil.py:act\n"
    yield "a dollar that is no variable", "{good}seed: ${HOME}\n"
    yield "format fields", "{good}seed: '{0.__class__}'\n"
    yield "an unknown key that is near", "{good}timstep: 0.01\n"
    yield "an unclosed quote", "{good}seed: '1\n"
    yield "an unclosed bracket", "{good}set: {a: 1\n"
    yield "an emoji for a key", "{good}\U0001f600: 1\n"
    yield "a key of a list", "{good}? [a, b]\n: 1\n"
    yield "set that is a list", "{good}set: [opt.gravity]\n"
    yield "a path of 2,000 parts", "{good}set: {" + ".".join(["a"] * 2000) + ": 1}\n"
    yield "10,000 assignments", "{good}set: {" + ", ".join(f"geom/bob.x{i}: 1" for i in range(10_000)) + "}\n"


def forms() -> Iterator[Form]:
    kinds = list(KINDS)
    for index, (what, text) in enumerate(texts()):
        names = kinds if index % 7 == 2 else ["run", kinds[1 + index % (len(kinds) - 1)]]
        for name in names:
            good, line = KINDS[name]
            content = text.replace("{good}", good) if isinstance(text, str) else text
            codes = _codes(name, what)
            yield Form(
                f"{name} document, {what}", line, codes, {"d.yaml": content}, quick=name == "run" and index % 3 == 0
            )
    yield from _files()
    yield from _values()
    yield from _assignments()


def _codes(name: str, what: str) -> tuple[int, ...]:
    """What such a document ends with: a task is told from a model by what it holds, and what holds none is a model."""
    if what == "a seed of 31 digits":
        return (0, 1, 2, 3)  # any whole number may be one
    if name == "task, checked":
        return (1, 2, 3)
    return (2, 3) if name.startswith("task") else (2,)


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _files() -> Iterator[Form]:
    """Documents that are no files, or that name what they must not."""
    for name, (_, line) in KINDS.items():
        kinds: dict[str, Content] = {
            "a pipe": _fifo,
            "an endless device": lambda path: path.symlink_to("/dev/zero"),
            "a folder": lambda path: path.mkdir(),
            "a link to nothing": lambda path: path.symlink_to("nowhere.yaml"),
            "a link to itself": lambda path: path.symlink_to("d.yaml"),
        }
        for what, make in kinds.items():
            yield Form(f"{name} document that is {what}", line, (2, 3, 7), {"d.yaml": make}, quick=name == "run")
    outside = f"../{BETWEEN}"
    secrets = {
        "defaults outside": (f"defaults: {outside}\n{RUN}", (2,)),
        "defaults that are a link outside": (f"defaults: link.yaml\n{RUN}", (2,)),
        "defaults of /etc/passwd": (f"defaults: /etc/passwd\n{RUN}", (2,)),
        "defaults of themselves": (f"defaults: d.yaml\n{RUN}", (2,)),
        "a model outside": (RUN.replace("m.xml", outside, 1), (3,)),
        "a model that is no model": (RUN.replace("m.xml", "link.xml", 1), (3,)),
        "controls outside": (f"{RUN}ctrl_from: {outside}\n", (2, 7)),
        "controls that are a link outside": (f"{RUN}ctrl_from: link.csv\n", (2, 7)),
        "a recording outside": (f"{RUN}replay: {outside}\n", (2, 7)),
        "a recording that is a link outside": (f"{RUN}replay: link.npz\n", (2, 7)),
        "a policy outside": (f"{RUN}policy: {outside}\n", (2, 7)),
        "a policy that is a link outside": (f"{RUN}policy: link.onnx\n", (2, 7)),
        "an output above": (RUN.replace("new.csv", "../../new.csv"), (2,)),
        "an output at the root": (RUN.replace("new.csv", "/tmp/mjrun-new.csv"), (2,)),
        "an output over the model": (RUN.replace("new.csv", "m.xml"), (2,)),
        "an output over the document": (RUN.replace("new.csv", "d.yaml"), (2,)),
        "an output to a device": (RUN.replace("new.csv", "/dev/null"), (2,)),
        "an output without a name": (RUN.replace("new.csv", "''"), (2,)),
        "an output of 300 characters": (RUN.replace("new.csv", "n" * 300 + ".csv"), (2, 7)),
        "an output with a NUL": (RUN.replace("new.csv", '"n\\0.csv"'), (2, 7)),
        "two outputs of one name": (RUN + "recordings: [new.npz, ./new.npz]\n", (2,)),
        "a model of variables": (f"vars: {{name: ../{BETWEEN}}}\n" + RUN.replace("m.xml", "${name}", 1), (3,)),
        "variables of variables": ("vars: {a: '${b}', b: '${a}'}\n" + RUN.replace("0.05", "${a}"), (2,)),
        "a camera script outside": (f"model: m.xml\nvideos: [{{output: new.mp4, camera: {outside}}}]\n", (2, 7)),
        "a camera script that is a link": ("model: m.xml\nvideos: [{output: new.mp4, camera: link.yaml}]\n", (2, 7)),
        "a picture outside": (f"model: m.xml\nvideos: [{{output: new.mp4, logo: {outside}}}]\n", (2, 7)),
        "a map outside": (f"{RUN}replay: good.csv\nmap: ['@{outside}']\n", (2, 7)),
        "a golden table outside": (RUN.replace("probe: qpos", f"probe: qpos, golden: {outside}"), (2, 7)),
        "points outside": (STUDY.replace("vary: {qpos/hinge: [0.1, 0.2]}", f"points: {outside}"), (2, 7)),
    }
    links = {
        f"link.{suffix}": lambda path: path.symlink_to(f"../{BETWEEN}")
        for suffix in ("yaml", "xml", "csv", "npz", "onnx")
    }
    for what, (text, codes) in secrets.items():
        line = KINDS["study" if "points" in what else "run"][1]
        yield Form(f"document with {what}", line, codes, {**links, "d.yaml": text}, quick="link" in what)


# Values that no key takes, in place of a good one.
WRONG = INPUTS["WRONG"]
KEYS = INPUTS["KEYS"]


def _values() -> Iterator[Form]:
    """Values of wrong types and sizes."""
    for kind, keys in KEYS.items():
        good, line = KINDS[kind]
        for number, key in enumerate(keys):
            for step in range(0, len(WRONG), 3):
                value = WRONG[(number + step) % len(WRONG)]
                lines = _without(good, key)
                names_file = value == "../../x" or key == "points"
                codes = (2, 3) if kind == "task" else (2, 7) if names_file else (2,)
                if value in ("null", "[[[]]]", "''"):
                    codes = (0, *codes)  # as if it were not there, where it need not be
                if (key, value) == ("every", "999999999999999999999999"):
                    codes = (0,)  # of which there is none
                yield Form(f"{kind} document, {key}: {value}", line, codes, {"d.yaml": f"{lines}{key}: {value}\n"})


def _without(text: str, key: str) -> str:
    """A document without one of its keys and what stands below it."""
    kept, skipping = [], False
    for line in text.splitlines(keepends=True):
        skipping = line.startswith(f"{key}:") or (skipping and line.startswith(" "))
        if not skipping:
            kept.append(line)
    return "".join(kept)


def _assignments() -> Iterator[Form]:
    """Hostile assignments on the command line over a good document."""
    wrong = (
        "duration",
        "=1",
        "duration=",
        "duration=[",
        "duration={a: ",
        "duration=!!python/name:os.system",
        "traces[99].output=x.csv",
        "traces[-1].output=x.csv",
        "traces[99999999999999999999].output=x.csv",
        "traces[0].__class__=1",
        "__proto__.x=1",
        f"set.{'a.' * 2000}b=1",
        "duration=&a 1",
        "duration=*a",
        "duration=1e999",
        "d\x1b[2J=1",
        "duration=" + "[" * 5000,
        "vars.x=1\n---\nmodel: y",
    )
    for number, text in enumerate(wrong):
        yield Form(f"assignment {text[:40]!a}", ("run", "d.yaml", text), (2,), {"d.yaml": RUN}, quick=number % 4 == 0)
