"""Files that a model cannot be read from: circles and chains of models, pipes, sockets, devices, links and folders."""

import itertools
from collections.abc import Iterator, Mapping

from tests.scoreboard.data import inputs_of
from tests.scoreboard.forms.file_contents import archive
from tests.scoreboard.forms.form import EITHER, LOADED, REFUSED, Content, Fifo, Folder, Form, Link, Socket, mjcf

INPUTS = inputs_of(__name__)
GEOM = '<worldbody><geom type="mesh" mesh="a"/></worldbody>'
BALL = '<worldbody><body name="b"><geom size=".1"/></body></worldbody>'
BALL_MODEL = mjcf(BALL)
KINDS: Mapping[str, Content] = {
    "a pipe": Fifo(),
    "a socket": Socket(),
    "a folder": Folder(),
    "an endless device": Link("/dev/zero"),
    "an empty device": Link("/dev/null"),
    "a terminal": Link("/dev/tty"),
    "a link to nothing": Link("nowhere"),
    "a link to itself": Link("{itself}"),
    "the memory of the process": Link("/proc/self/mem"),
}


def attaching(file: str, prefix: str = "p", more: str = "") -> str:
    """Returns a model that attaches the body of another."""
    asset = f'<asset><model name="other" file="{file}"/></asset>'
    body = f'<body name="b"><geom size=".1"/><attach model="other" body="b" prefix="{prefix}_"/></body>'
    return mjcf(f"{asset}<worldbody>{body}</worldbody>{more}")


def including(file: str) -> str:
    """Returns a model that includes another."""
    return mjcf(f'<include file="{file}"/>')


def chain(link: str, length: int) -> dict[str, Content]:
    """Returns models each of which includes or attaches the next, with a ball at the end."""
    make = including if link == "include" else attaching
    names = ["model.xml", *(f"m{i}.xml" for i in range(1, length))]
    files: dict[str, Content] = {name: make(after) for name, after in itertools.pairwise(names)}
    return {**files, names[-1]: BALL_MODEL}


def circle(link: str, length: int) -> dict[str, Content]:
    """Returns models each of which includes or attaches the next, and the last the first."""
    make = including if link == "include" else attaching
    names = ["model.xml", *(f"m{i}.xml" for i in range(1, length))]
    return {name: make(names[(i + 1) % length]) for i, name in enumerate(names)}


def cycles() -> Iterator[Form]:
    """Yields models that include or attach themselves or each other, in circles and in long chains."""
    for link in ("include", "attach"):
        for length in (1, 2, 3, 10):
            yield Form(f"{link} in a circle of {length}", circle(link, length), loads=REFUSED)
            members = {name: str(text) for name, text in circle(link, length).items()}
            for ending in ("zip", "mjz"):
                what = f"{link} in a circle of {length} in a .{ending}"
                yield Form(what, {f"model.{ending}": archive(members)}, f"model.{ending}", REFUSED)
        for length in (3, 30, 400) if link == "include" else (3, 30):
            yield Form(f"{link} in a chain of {length}", chain(link, length))
        for length in (2000, 3000):  # near the end of MuJoCo's stack, or beyond it
            yield Form(f"{link} in a chain of {length}", chain(link, length), loads=REFUSED)
        for length in (10, 3000):
            members = {name: str(text) for name, text in chain(link, length).items()}
            yield Form(f"{link} in a chain of {length} in a .zip", {"model.zip": archive(members)}, "model.zip")
        make = including if link == "include" else attaching
        for spelling in ("./model.xml", "sub/../model.xml", ".\\model.xml", "././/model.xml"):
            files: dict[str, Content] = {"model.xml": make(spelling), "sub": Folder()}
            yield Form(f"{link} of itself as {spelling}", files, loads=REFUSED)
        for name, files in {
            "itself by a link": {"model.xml": make("other.xml"), "other.xml": Link("model.xml")},
            "a folder": {"model.xml": make("other.xml"), "other.xml": Folder()},
            "nothing": {"model.xml": make("")},
            "a missing file": {"model.xml": make("missing.xml")},
            "an empty file": {"model.xml": make("other.xml"), "other.xml": ""},
            "a text": {"model.xml": make("other.xml"), "other.xml": "hello\n"},
            "an unclosed file": {"model.xml": make("other.xml"), "other.xml": "<mujoco><worldbody>"},
            "bytes": {"model.xml": make("other.xml"), "other.xml": bytes(range(256))},
            "an archive": {"model.xml": make("other.zip"), "other.zip": archive({"model.xml": BALL_MODEL})},
            "a link to nothing": {"model.xml": make("other.xml"), "other.xml": Link("nowhere")},
            "a link to itself": {"model.xml": make("other.xml"), "other.xml": Link("other.xml")},
            "a name of 5,000 characters": {"model.xml": make("x" * 5000 + ".xml")},
        }.items():
            yield Form(f"{link} of {name}", files, loads=None if "archive" in name else REFUSED)
    yield Form("include and attach in a circle", {"model.xml": including("a.xml"), "a.xml": attaching("model.xml")})
    yield Form("attach and include in a circle", {"model.xml": attaching("a.xml"), "a.xml": including("model.xml")})
    twice = mjcf('<include file="a.xml"/><include file="a.xml"/>')
    yield Form("include of one file twice", {"model.xml": twice, "a.xml": BALL_MODEL})
    yield Form(
        "include in a folder", {"model.xml": including("a/b.xml"), "a/b.xml": including("c.xml"), "a/c.xml": BALL_MODEL}
    )
    yield Form("include without a file", {"model.xml": mjcf("<include/>")}, loads=REFUSED)
    yield Form(
        "attach of a missing body",
        {"model.xml": attaching("a.xml").replace('body="b"', 'body="c"'), "a.xml": BALL_MODEL},
        loads=REFUSED,
    )
    yield Form(
        "attach without a prefix", {"model.xml": attaching("a.xml").replace(' prefix="p_"', ""), "a.xml": BALL_MODEL}
    )
    both = attaching("a.xml").replace("</body>", '<attach model="other" body="b" prefix="p_"/></body>')
    yield Form("attach twice with one prefix", {"model.xml": both, "a.xml": BALL_MODEL})
    yield Form(
        "attach of a whole model", {"model.xml": attaching("a.xml").replace(' body="b"', ""), "a.xml": BALL_MODEL}
    )
    yield Form("an honest attach", {"model.xml": attaching("a.xml"), "a.xml": BALL_MODEL}, loads=LOADED)
    diamond = mjcf(
        '<asset><model name="l" file="l.xml"/><model name="r" file="r.xml"/></asset>'
        '<worldbody><body><geom size=".1"/><attach model="l" body="b" prefix="l_"/>'
        '<attach model="r" body="b" prefix="r_"/></body></worldbody>'
    )
    yield Form(
        "attach of one model by two",
        {"model.xml": diamond, "l.xml": attaching("a.xml"), "r.xml": attaching("a.xml"), "a.xml": BALL_MODEL},
    )
    files: dict[str, Content] = {"m0.xml": BALL_MODEL}
    for i in range(1, 26):
        names = "".join(f'<model name="{side}" file="m{i - 1}.xml"/>' for side in "ab")
        bodies = "".join(f'<attach model="{side}" body="b" prefix="{side}"/>' for side in "ab")
        text = f'<asset>{names}</asset><worldbody><body name="b"><geom size=".1"/>{bodies}</body></worldbody>'
        files["model.xml" if i == 25 else f"m{i}.xml"] = mjcf(text)
    yield Form("attach that doubles 25 times", files, loads=REFUSED)


def _written(content: Content, name: str) -> Content:
    """Returns the content of a file of this name, to which `{itself}` refers."""
    return Link(name) if content == Link("{itself}") else content


def _file_name(naming: str) -> str:
    return naming.split("file", 1)[1].split('"')[1].format("file")


def special_files() -> Iterator[Form]:
    """Yields pipes, sockets, devices, links and folders in place of a model or one of its files."""
    for kind, content in KINDS.items():
        for role, naming in INPUTS["NAMING"].items():
            name = _file_name(naming)
            files = {"model.xml": mjcf(naming.format("file")), name: _written(content, name)}
            yield Form(f"{kind} as {role}", files, loads=REFUSED)
        for model in ("model.xml", "model.urdf", "model.zip", "model.mjz", "model.mjb"):
            yield Form(f"{kind} as {model}", {model: _written(content, model)}, model, REFUSED)
        robot = '<robot name="r"><link name="l"><visual><geometry><mesh filename="package://r/file.stl"/>'
        robot += "</geometry></visual></link></robot>"
        files = {"model.urdf": robot, "file.stl": _written(content, "file.stl")}
        yield Form(f"{kind} as a mesh of URDF", files, "model.urdf", EITHER)
    for path in ("/dev/zero", "/dev/null", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0", "/dev/ptmx"):
        yield Form(f"{path} as an include", {"model.xml": mjcf(f'<include file="{path}"/>')}, loads=REFUSED)
        mesh = f'<asset><mesh name="a" file="{path}" content_type="model/stl"/></asset>' + GEOM
        yield Form(f"{path} as a mesh", {"model.xml": mjcf(mesh)}, loads=REFUSED)
