"""Reading outside the model's folder with `--untrusted`: every way to name a file there, and every command."""

import os
import shutil
import struct
import sys
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from mjrun.confinement import landlock
from tests.scoreboard.command import CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Measure, Tally
from tests.scoreboard.open_watch import OpenWatch

SECRET = "hunter2"  # in every file outside that holds text: no message may have it
LIMIT = 240.0  # [s] for a run on a busy machine
BODY = '<worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>'
MODEL = f'<mujoco>{BODY}<actuator><motor name="a" joint="j"/></actuator></mujoco>'
PART = f'<mujoco model="{SECRET}"><worldbody><body name="{SECRET}"><geom size=".1"/></body></worldbody></mujoco>'
OBJ = f"# {SECRET}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
MESH = '<asset><mesh name="m" file="{}"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody>'


@dataclass(frozen=True)
class Form:
    """A way to name a file outside.

    Attributes:
      write: writes a model into the first folder that names files in the second, and returns its path.
      works: whether MuJoCo opens the file if it may: then a run without `--untrusted` must.
    """

    name: str
    write: Callable[[Path, Path], Path]
    works: bool = True


def mjcf(name: str, content: str, *, works: bool = True) -> Form:
    """A form whose model is one file; OUT in its content is the folder outside, ABS the same, absolute."""

    def write(folder: Path, outside: Path) -> Path:
        text = content.replace("OUT", f"../{outside.name}").replace("ABS", str(outside))
        (folder / "model.xml").write_text(f"<mujoco>{text}</mujoco>")
        return folder / "model.xml"

    return Form(name, write, works)


def linked(name: str, link: str, target: str, content: str) -> Form:
    """A form with a symbolic link in the model's folder to `target` outside."""

    def write(folder: Path, outside: Path) -> Path:
        (folder / link).parent.mkdir(exist_ok=True)
        (folder / link).symlink_to(outside / target)
        (folder / "model.xml").write_text(f"<mujoco>{content}</mujoco>")
        return folder / "model.xml"

    return Form(name, write)


def written(name: str, works: bool = True) -> Callable[[Callable[[Path, Path], Path]], Form]:
    return lambda write: Form(name, write, works)


@written("include in an include")
def nested_include(folder: Path, outside: Path) -> Path:
    (folder / "sub").mkdir()
    (folder / "sub/inner.xml").write_text(f'<mujoco><include file="../../{outside.name}/part.xml"/></mujoco>')
    (folder / "inner.xml").write_text(f'<mujoco><include file="../{outside.name}/part.xml"/></mujoco>')
    (folder / "model.xml").write_text('<mujoco><include file="inner.xml"/></mujoco>')
    return folder / "model.xml"


@written("mesh of an attached model")
def attached_mesh(folder: Path, outside: Path) -> Path:
    (folder / "child.xml").write_text(
        f'<mujoco><asset><mesh name="m" file="../{outside.name}/mesh.obj"/></asset><worldbody><body name="b">'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    (folder / "model.xml").write_text(
        '<mujoco><asset><model name="c" file="child.xml"/></asset><worldbody><frame>'
        '<attach model="c" body="b" prefix="p"/></frame></worldbody></mujoco>'
    )
    return folder / "model.xml"


@written("chain of links")
def chain(folder: Path, outside: Path) -> Path:
    (folder / "one.xml").symlink_to("two.xml")
    (folder / "two.xml").symlink_to("three.xml")
    (folder / "three.xml").symlink_to(outside / "part.xml")
    (folder / "model.xml").write_text('<mujoco><include file="one.xml"/></mujoco>')
    return folder / "model.xml"


@written("link to a folder, and .. behind it")
def through_link(folder: Path, outside: Path) -> Path:
    (folder / "link").symlink_to(outside / "sub")
    (folder / "model.xml").write_text('<mujoco><include file="link/../part.xml"/></mujoco>')
    return folder / "model.xml"


@written("URDF, absolute")
def urdf(folder: Path, outside: Path) -> Path:
    return _urdf(folder, str(outside / "mesh.obj"), "<mujoco><compiler strippath='false'/></mujoco>")


@written("URDF, relative")
def urdf_relative(folder: Path, outside: Path) -> Path:
    return _urdf(folder, f"../{outside.name}/mesh.obj", "<mujoco><compiler strippath='false'/></mujoco>")


@written("URDF, meshdir", works=False)
def urdf_meshdir(folder: Path, outside: Path) -> Path:
    return _urdf(folder, "package://x/mesh.obj", f"<mujoco><compiler meshdir='../{outside.name}'/></mujoco>")


def _urdf(folder: Path, name: str, settings: str) -> Path:
    (folder / "model.urdf").write_text(
        f'<robot name="r">{settings}<link name="l"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        f'ixz="0" iyz="0"/></inertial><collision><geometry><mesh filename="{name}"/></geometry></collision></link>'
        "</robot>"
    )
    return folder / "model.urdf"


def archive(name: str, content: str, suffix: str = ".zip", *, members: dict[str, str] | None = None) -> Form:
    """A form whose model lies in an archive."""

    def write(folder: Path, outside: Path) -> Path:
        path = folder / f"model{suffix}"
        with zipfile.ZipFile(path, "w") as file:
            text = content.replace("OUT", f"../{outside.name}").replace("ABS", str(outside))
            file.writestr("model.xml", f"<mujoco>{text}</mujoco>")
            for member, inner in (members or {}).items():
                file.writestr(member.replace("OUT", f"../{outside.name}"), inner)
        return path

    return Form(name, write, works=False)


@written("archive with a link", works=False)
def archived_link(folder: Path, outside: Path) -> Path:
    path = folder / "model.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("model.xml", '<mujoco><include file="part.xml"/></mujoco>')
        link = zipfile.ZipInfo("part.xml")
        link.external_attr = 0o120777 << 16
        file.writestr(link, str(outside / "part.xml"))
    return path


@written("a named pipe outside", works=False)
def pipe(folder: Path, outside: Path) -> Path:
    if not (outside / "pipe").exists():
        os.mkfifo(outside / "pipe")
    (folder / "model.xml").write_text(f'<mujoco><include file="../{outside.name}/pipe"/></mujoco>')
    return folder / "model.xml"


ATTACH = '<worldbody><frame><attach model="c" body="hunter2" prefix="p"/></frame></worldbody>'
HFIELD = '<worldbody><geom type="hfield" hfield="h"/></worldbody>'
TEXTURED = '<material name="m" texture="t"/></asset><worldbody><geom size=".1" material="m"/></worldbody>'
CUBE = " ".join(f'file{side}="OUT/image.png"' for side in ("right", "left", "up", "down", "front", "back"))
FLEX = '<worldbody><flexcomp name="f" type="{}" dim="2" file="{}" radius=".01"/></worldbody>'

FORMS: tuple[Form, ...] = (
    mjcf("include", '<include file="OUT/part.xml"/>'),
    mjcf("include, absolute", '<include file="ABS/part.xml"/>'),
    mjcf("include, dots within", '<include file="./.././OUT/../model/OUT/part.xml"/>'.replace("./../.", ".")),
    mjcf("include, entities", '<include file="&#46;&#x2e;/outside/part.xml"/>'),
    mjcf("include, backslashes", '<include file="..\\outside\\part.xml"/>', works=False),
    mjcf("include, single quotes", "<include file = 'OUT/part.xml' />"),
    mjcf("include, slashes", '<include file="..//outside///part.xml"/>'),
    mjcf("include, by way of /proc", '<include file="/proc/self/rootABS/part.xml"/>'),
    mjcf("include of text", '<include file="OUT/text.txt"/>'),
    mjcf("include of what is not there", '<include file="OUT/nothing.xml"/>', works=False),
    nested_include,
    chain,
    through_link,
    linked("link to a file", "part.xml", "part.xml", '<include file="part.xml"/>'),
    linked("link to a folder", "link", "", '<include file="link/part.xml"/>'),
    linked("link in a subfolder", "sub/part.xml", "part.xml", '<include file="sub/part.xml"/>'),
    linked("link to a mesh", "m.obj", "mesh.obj", MESH.format("m.obj")),
    linked("link to the mesh folder", "meshes", "", '<compiler meshdir="meshes"/>' + MESH.format("mesh.obj")),
    mjcf("attach", f'<asset><model name="c" file="OUT/part.xml"/></asset>{ATTACH}'),
    mjcf("attach, absolute", f'<asset><model name="c" file="ABS/part.xml"/></asset>{ATTACH}'),
    linked("attach a link", "part.xml", "part.xml", f'<asset><model name="c" file="part.xml"/></asset>{ATTACH}'),
    attached_mesh,
    mjcf("mesh, obj", MESH.format("OUT/mesh.obj")),
    mjcf("mesh, absolute", MESH.format("ABS/mesh.obj")),
    mjcf("mesh, stl", MESH.format("OUT/mesh.stl")),
    mjcf("mesh, msh", MESH.format("OUT/mesh.msh"), works=False),
    mjcf("mesh, content type", MESH.format('OUT/mesh.obj" content_type="model/obj')),
    mjcf("meshdir", '<compiler meshdir="OUT"/>' + MESH.format("mesh.obj")),
    mjcf("meshdir, absolute", '<compiler meshdir="ABS"/>' + MESH.format("mesh.obj")),
    mjcf("meshdir and ..", '<compiler meshdir="meshes"/>' + MESH.format("../OUT/mesh.obj")),
    mjcf("assetdir", '<compiler assetdir="OUT"/>' + MESH.format("mesh.obj")),
    mjcf("mesh library of an obj", MESH.format("own.obj"), works=False),
    mjcf("texturedir", f'<compiler texturedir="OUT"/><asset><texture name="t" type="2d" file="image.png"/>{TEXTURED}'),
    mjcf("texture", f'<asset><texture name="t" type="2d" file="OUT/image.png"/>{TEXTURED}'),
    mjcf("texture, absolute", f'<asset><texture name="t" type="2d" file="ABS/image.png"/>{TEXTURED}'),
    mjcf("texture, ktx", f'<asset><texture name="t" type="2d" file="OUT/image.ktx"/>{TEXTURED}', works=False),
    mjcf("texture of a cube", f'<asset><texture name="t" type="cube" {CUBE}/>{TEXTURED}'),
    linked(
        "link to a texture",
        "t.png",
        "image.png",
        f'<asset><texture name="t" type="2d" file="t.png"/>{TEXTURED}',
    ),
    mjcf("heightfield, png", f'<asset><hfield name="h" file="OUT/image.png" size="1 1 1 1"/></asset>{HFIELD}'),
    mjcf("heightfield, bin", f'<asset><hfield name="h" file="OUT/field.bin" size="1 1 1 1"/></asset>{HFIELD}'),
    mjcf("heightfield, absolute", f'<asset><hfield name="h" file="ABS/field.bin" size="1 1 1 1"/></asset>{HFIELD}'),
    mjcf("skin", '<asset><skin name="s" file="OUT/skin.skn"/></asset>' + BODY),
    mjcf("flex, mesh", FLEX.format("mesh", "OUT/mesh.obj")),
    mjcf("flex, gmsh", FLEX.format("gmsh", "OUT/mesh.gmsh")),
    mjcf("flex, absolute", FLEX.format("mesh", "ABS/mesh.obj")),
    urdf,
    urdf_relative,
    urdf_meshdir,
    archive("archive, include", '<include file="OUT/part.xml"/>'),
    archive("archive, include, absolute", '<include file="ABS/part.xml"/>'),
    archive("archive, mesh", MESH.format("OUT/mesh.obj")),
    archive("archive, mesh, absolute", MESH.format("ABS/mesh.obj")),
    archive("archive, meshdir", '<compiler meshdir="ABS"/>' + MESH.format("mesh.obj")),
    archive("archive, member outside", '<include file="OUT/part.xml"/>', members={"OUT/part.txt": "x"}),
    archive("mjz, include, absolute", '<include file="ABS/part.xml"/>', ".mjz"),
    archived_link,
    pipe,
)

# Commands that load a model, each after its name, with the model in place of MODEL; the simplest first.
INPUTS = inputs_of(__name__)
COMMANDS: tuple[tuple[str, ...], ...] = INPUTS["COMMANDS"]
EVERYWHERE = ("include", "mesh, absolute", "link to a file", "archive, include", "attach")  # with every command

TASK = INPUTS["TASK"]
# Documents beside a harmless model that name files outside, and the command for each.
DOCUMENTS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("model", "model: OUT/good.xml\ntraces: [{output: t.csv}]\nsimulation: {steps: 2}\n", ("run", "DOC")),
    ("model, absolute", "model: ABS/good.xml\ntraces: [{output: t.csv}]\n", ("run", "DOC")),
    ("defaults", "defaults: OUT/defaults.yaml\nmodel: good.xml\ntraces: [{output: t.csv}]\n", ("run", "DOC")),
    ("defaults, absolute", "defaults: ABS/defaults.yaml\nmodel: good.xml\n", ("run", "DOC")),
    ("controls", "model: good.xml\nctrl_from: OUT/data.csv\ntraces: [{output: t.csv}]\n", ("run", "DOC")),
    ("replay", "model: good.xml\nreplay: OUT/data.csv\ntraces: [{output: t.csv}]\n", ("run", "DOC")),
    (
        "camera",
        "model: good.xml\nvideos: [{output: v.mp4, camera: OUT/camera.yaml, size: 16x16}]\nsteps: 2\n",
        ("run", "DOC"),
    ),
    ("golden", "model: good.xml\nsteps: 2\ntraces: [{output: t.csv, golden: OUT/data.csv}]\n", ("run", "DOC")),
    ("task", TASK.format(model="OUT/good.xml"), ("info", "DOC")),
    ("played task", TASK.format(model="OUT/good.xml"), ("eval", "DOC", "--policy", "zero", "--episodes", "1")),
    ("points", "model: good.xml\npoints: OUT/data.csv\nmetric: {t: max(time)}\nsteps: 2\n", ("sweep", "DOC")),
    ("study", "model: OUT/good.xml\nvary: {opt.timestep: '.001,.002'}\nmetric: {t: max(time)}\n", ("sweep", "DOC")),
    ("fit", "model: good.xml\ndata: [OUT/data.csv]\nfree: {joint/j.damping: 0..1}\n", ("fit", "DOC")),
    ("model of a fit", "model: OUT/good.xml\ndata: [data.csv]\nfree: {joint/j.damping: 0..1}\n", ("fit", "DOC")),
    ("output", "model: good.xml\nsteps: 2\ntraces: [{output: OUT/stolen.csv}]\n", ("run", "DOC")),
)


def measure(quick: bool) -> Tally:
    tally = Tally()
    if sys.platform != "linux":
        tally.left_out.append("all of it: inotify, which sees what is opened, is Linux's")
        return tally
    forms = FORMS[:1] + FORMS[16:17] if quick else FORMS
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        servers = {}
        if landlock.version():
            servers["Landlock"] = stack.enter_context(CommandServer(LIMIT))
        elif not quick:
            tally.left_out.append("confinement by Landlock: this kernel does not know it")
        if not quick or not servers:
            prefix = (sys.executable, "-m", "tests.scoreboard.without_landlock")
            servers["checks of paths"] = stack.enter_context(CommandServer(LIMIT, prefix=prefix))
        outside = folder / "outside"
        write_outside(outside)
        watch = stack.enter_context(OpenWatch(outside))
        for means, server in servers.items():
            case = Cases(tally, means, server, watch, folder)
            for form in forms:
                case.try_form(form, COMMANDS[:1] if quick else COMMANDS if form.name in EVERYWHERE else COMMANDS[:3])
            if not quick:
                case.try_documents()
                case.try_commands_on_a_harmless_model()
                case.try_what_is_named()
                case.try_to_ask_what_there_is()
    return tally


@dataclass
class Cases:
    """The cases of one way of confinement."""

    tally: Tally
    means: str
    server: CommandServer
    watch: OpenWatch
    folder: Path

    @property
    def outside(self) -> Path:
        return self.folder / "outside"

    def try_form(self, form: Form, commands: tuple[tuple[str, ...], ...]) -> None:
        """A form with several commands; without `--untrusted` the file must be opened, or the form shows nothing."""
        folder = self._clean_folder()
        model = form.write(folder, self.outside)
        (folder / "own.obj").write_text(f"mtllib ../outside/colours.mtl\n{OBJ}".replace(SECRET, ""))
        _write_documents(folder, model.name)
        for command in commands:
            arguments = [model.name if word == "MODEL" else word for word in command]
            run = self.server.run(*arguments, "--untrusted", folder=folder)
            expected = {0} if form.name == "mesh library of an obj" else {3}
            differs = {1} if command[0] == "diff" and 0 in expected else set()
            self._judge(run, f"{form.name}: {run}", expected | differs)
        if form.works:
            run = self.server.run("info", model.name, folder=folder)
            opened = self.watch.opened()
            self.tally.expect(bool(opened), f"{form.name}: without --untrusted nothing is opened outside: {run}")

    def try_documents(self) -> None:
        for name, text, command in DOCUMENTS:
            folder = self._clean_folder()
            _write_documents(folder, "good.xml")
            (folder / "doc.yaml").write_text(text.replace("OUT", "../outside").replace("ABS", str(self.outside)))
            arguments = ["doc.yaml" if word == "DOC" else word for word in command]
            run = self.server.run(*arguments, "--untrusted", folder=folder)
            self._judge(run, f"document, {name}: {run}", {2, 3, 7})
            written = (self.outside / "stolen.csv").exists()
            self.tally.expect(not written, f"document, {name}: wrote a file outside")
            (self.outside / "stolen.csv").unlink(missing_ok=True)

    def try_commands_on_a_harmless_model(self) -> None:
        """Every command does its work on a model that names nothing outside."""
        folder = self._clean_folder()
        _write_documents(folder, "good.xml")
        for command in COMMANDS:
            if command[0] == "view":
                self.tally.left_out.append(f"view on a harmless model, {self.means}: it waits for its user")
                continue
            arguments = ["good.xml" if word == "MODEL" else word for word in command]
            run = self.server.run(*arguments, "--untrusted", folder=folder)
            self._judge(run, f"harmless: {run}", {0, 1} if command[0] in ("fit", "check") else {0})

    def try_what_is_named(self) -> None:
        """What the command line names is read, wherever it is; with `--root`, so is what lies below that."""
        folder = self._clean_folder()
        _write_documents(folder, "good.xml")
        run = self.server.run("trace", "good.xml", "--ctrl-from", "../outside/data.csv", "--untrusted", folder=folder)
        opened = self.watch.opened()
        named = [str(self.outside / "data.csv")]
        self.tally.expect(opened in ([], named), f"named table: opened {opened}: {run}")
        (folder / "model.xml").write_text('<mujoco><include file="../outside/part.xml"/></mujoco>')
        run = self.server.run("info", "model.xml", "--untrusted", "--root", "..", folder=folder)
        self.tally.expect(run.code == 0 and bool(self.watch.opened()), f"--root ..: {run}")

    def try_to_ask_what_there_is(self) -> None:
        """A file that is not there is refused in the same words as one that is."""
        for name in ("include", "mesh", "texture"):
            folder, messages = self._clean_folder(), []
            for file in ("text.txt", "nowhere"):
                text = {
                    "include": f'<include file="../outside/{file}"/>',
                    "mesh": MESH.format(f"../outside/{file}"),
                    "texture": f'<asset><texture name="t" type="2d" file="../outside/{file}"/>{TEXTURED}',
                }[name]
                (folder / "model.xml").write_text(f"<mujoco>{text}</mujoco>")
                run = self.server.run("info", "model.xml", "--untrusted", folder=folder)
                messages.append(run.message.replace(file, "FILE"))
            self.tally.expect(messages[0] == messages[1], f"{name}: a file that is there is told from none: {messages}")

    def _judge(self, run: Ended, case: str, codes: set[int]) -> None:
        opened = self.watch.opened()
        case = f"{self.means}: {case}"
        self.tally.expect(not opened, f"{case}: opened {', '.join(opened)}")
        self.tally.expect(run.code in codes, f"{case}: expected {sorted(codes)}")
        said = run.message + run.stdout.decode("utf-8", "replace")
        faults = [*run.faults, *(["discloses what is in a file"] if SECRET in said else [])]
        self.tally.expect(not faults, f"{case}: {', '.join(faults)}")

    def _clean_folder(self) -> Path:
        folder = self.folder / "model"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / "good.xml").write_text(MODEL)
        self.watch.opened()
        return folder


def write_outside(folder: Path) -> None:
    """Files of every kind that a model can name."""
    (folder / "sub").mkdir(parents=True)
    texts = {
        "part.xml": PART,
        "good.xml": MODEL.replace("slide", "hinge").replace('"j"', f'"{SECRET}"'),
        "text.txt": f"{SECRET}:x:0:0\n",
        "mesh.obj": OBJ,
        "colours.mtl": f"newmtl {SECRET}\n",
        "defaults.yaml": f"simulation: {{{SECRET}: 1}}\n",
        "camera.yaml": f"{SECRET}: 1\n",
        "data.csv": f"time,{SECRET}\n0,0\n1,1\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    Image.new("L", (8, 8), 128).save(folder / "image.png")
    (folder / "image.ktx").write_bytes(b"\xabKTX 11\xbb\r\n\x1a\n" + bytes(64))
    (folder / "field.bin").write_bytes(struct.pack("2i", 2, 2) + np.zeros(4, np.float32).tobytes())
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    triangles = b"".join(bytes(12) + vertices[face].tobytes() + bytes(2) for face in faces)
    (folder / "mesh.stl").write_bytes(bytes(80) + struct.pack("I", 4) + triangles)
    (folder / "mesh.msh").write_bytes(struct.pack("4i", 4, 0, 0, 4) + vertices.tobytes() + faces.astype("i4").tobytes())
    nodes = "".join(f"{i + 1}\n{x} {y} {z}\n" for i, (x, y, z) in enumerate(vertices))
    (folder / "mesh.gmsh").write_text(f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n{nodes}$EndNodes\n")
    (folder / "skin.skn").write_bytes(struct.pack("4i", 4, 0, 4, 0) + vertices.tobytes() + faces.astype("i4").tobytes())


def _write_documents(folder: Path, model: str) -> None:
    (folder / "run.yaml").write_text(f"model: {model}\nsteps: 2\ntraces: [{{output: r.csv}}]\n")
    (folder / "task.yaml").write_text(TASK.format(model=model))
    (folder / "data.csv").write_text("time,qpos/j\n" + "".join(f"{k / 100},{k / 1000}\n" for k in range(20)))


MEASURE = Measure(
    "reading outside the model's folder with --untrusted",
    "0 files opened (seen by inotify), nothing disclosed, exit 3; with Landlock, and by checks of paths alone",
    400,
    measure,
)
