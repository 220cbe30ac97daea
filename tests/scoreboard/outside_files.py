"""Reading outside the model's folder with `--untrusted`: every way to name a file there, and every command."""

import ctypes
import os
import shutil
import struct
import sys
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mjrun.confinement import landlock
from tests.scoreboard.command import QUICK_IMPORTS, CommandServer, Ended
from tests.scoreboard.data import inputs_of
from tests.scoreboard.measure import Tally, measured

SECRET = "hunter2"  # in every text file outside: no message may contain it
LIMIT = 240.0  # [s] for a run on a busy machine
BODY = '<worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>'
MODEL = f'<mujoco>{BODY}<actuator><motor name="a" joint="j"/></actuator></mujoco>'
PART = f'<mujoco model="{SECRET}"><worldbody><body name="{SECRET}"><geom size=".1"/></body></worldbody></mujoco>'
OBJ = f"# {SECRET}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
MESH = '<asset><mesh name="m" file="{}"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody>'
INPUTS = inputs_of(__name__)
COMMANDS: tuple[tuple[str, ...], ...] = INPUTS["COMMANDS"]
EVERYWHERE = ("include", "mesh, absolute", "link to a file", "archive, include", "attach")  # with every command
TASK = INPUTS["TASK"]
ATTACH = '<worldbody><frame><attach model="c" body="hunter2" prefix="p"/></frame></worldbody>'
HFIELD = '<worldbody><geom type="hfield" hfield="h"/></worldbody>'
TEXTURED = '<material name="m" texture="t"/></asset><worldbody><geom size=".1" material="m"/></worldbody>'


OPEN, ACCESS, MODIFY, IS_FOLDER = 0x20, 0x1, 0x2, 0x40000000
EVENT = struct.Struct("iIII")  # watch, what happened, cookie, length of the name that follows


class OpenWatch:
    """Watches which files below folders are opened, by inotify, which no library can evade; folders may be listed."""

    def __init__(self, *folders: Path) -> None:
        self._library = ctypes.CDLL(None, use_errno=True)
        self._notes = self._library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if self._notes < 0:
            raise OSError(ctypes.get_errno(), "inotify_init1")
        self._folders: dict[int, Path] = {}
        for folder in folders:
            for each in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
                watch = self._library.inotify_add_watch(self._notes, os.fsencode(each), OPEN | ACCESS | MODIFY)
                if watch < 0:
                    raise OSError(ctypes.get_errno(), f"inotify_add_watch {each}")
                self._folders[watch] = each

    def __enter__(self) -> "OpenWatch":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._notes)

    def opened(self) -> list[str]:
        """Returns the files opened since the last call."""
        content = b""
        with suppress(BlockingIOError):
            while chunk := os.read(self._notes, 2**20):
                content += chunk
        names = set()
        while content:
            watch, what, _, length = EVENT.unpack_from(content)
            name = content[EVENT.size : EVENT.size + length].rstrip(b"\0").decode()
            content = content[EVENT.size + length :]
            if not what & IS_FOLDER:
                names.add(str(self._folders[watch] / name))
        return sorted(names)


@dataclass(frozen=True)
class Form:
    """A way to name a file outside.

    Attributes:
      name: a few words for the list of failures.
      write: writes a model that names files in the second folder into the first, and returns its path.
      works: true if MuJoCo opens the file if it may: then a run without `--untrusted` must.
    """

    name: str
    write: Callable[[Path, Path], Path]
    works: bool = True


def _form(name: str, settings: dict[str, Any]) -> Form:
    """Returns a form whose model is one file, perhaps with a link to a file outside, or in an archive."""
    model = settings["model"].format(textured=TEXTURED, attach=ATTACH, hfield=HFIELD)

    def write(folder: Path, outside: Path) -> Path:
        text = model.replace("OUT", f"../{outside.name}").replace("ABS", str(outside))
        if "link" in settings:
            link, target = settings["link"]
            (folder / link).parent.mkdir(exist_ok=True)
            (folder / link).symlink_to(outside / target)
        if "archive" not in settings:
            (folder / "model.xml").write_text(f"<mujoco>{text}</mujoco>")
            return folder / "model.xml"
        path = folder / f"model{settings['archive']}"
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("model.xml", f"<mujoco>{text}</mujoco>")
            for member, content in settings.get("members", {}).items():
                file.writestr(member.replace("OUT", f"../{outside.name}"), content)
        return path

    return Form(name, write, settings.get("works", "archive" not in settings))


def _nested_include(folder: Path, outside: Path) -> Path:
    (folder / "sub").mkdir()
    (folder / "sub/inner.xml").write_text(f'<mujoco><include file="../../{outside.name}/part.xml"/></mujoco>')
    (folder / "inner.xml").write_text(f'<mujoco><include file="../{outside.name}/part.xml"/></mujoco>')
    (folder / "model.xml").write_text('<mujoco><include file="inner.xml"/></mujoco>')
    return folder / "model.xml"


def _attached_mesh(folder: Path, outside: Path) -> Path:
    (folder / "child.xml").write_text(
        f'<mujoco><asset><mesh name="m" file="../{outside.name}/mesh.obj"/></asset><worldbody><body name="b">'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    (folder / "model.xml").write_text(
        '<mujoco><asset><model name="c" file="child.xml"/></asset><worldbody><frame>'
        '<attach model="c" body="b" prefix="p"/></frame></worldbody></mujoco>'
    )
    return folder / "model.xml"


def _chain(folder: Path, outside: Path) -> Path:
    (folder / "one.xml").symlink_to("two.xml")
    (folder / "two.xml").symlink_to("three.xml")
    (folder / "three.xml").symlink_to(outside / "part.xml")
    (folder / "model.xml").write_text('<mujoco><include file="one.xml"/></mujoco>')
    return folder / "model.xml"


def _through_link(folder: Path, outside: Path) -> Path:
    (folder / "link").symlink_to(outside / "sub")
    (folder / "model.xml").write_text('<mujoco><include file="link/../part.xml"/></mujoco>')
    return folder / "model.xml"


def _urdf_absolute(folder: Path, outside: Path) -> Path:
    return _urdf(folder, str(outside / "mesh.obj"), "<mujoco><compiler strippath='false'/></mujoco>")


def _urdf_relative(folder: Path, outside: Path) -> Path:
    return _urdf(folder, f"../{outside.name}/mesh.obj", "<mujoco><compiler strippath='false'/></mujoco>")


def _urdf_meshdir(folder: Path, outside: Path) -> Path:
    return _urdf(folder, "package://x/mesh.obj", f"<mujoco><compiler meshdir='../{outside.name}'/></mujoco>")


def _urdf(folder: Path, name: str, settings: str) -> Path:
    (folder / "model.urdf").write_text(
        f'<robot name="r">{settings}<link name="l"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        f'ixz="0" iyz="0"/></inertial><collision><geometry><mesh filename="{name}"/></geometry></collision></link>'
        "</robot>"
    )
    return folder / "model.urdf"


def _archived_link(folder: Path, outside: Path) -> Path:
    path = folder / "model.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("model.xml", '<mujoco><include file="part.xml"/></mujoco>')
        link = zipfile.ZipInfo("part.xml")
        link.external_attr = 0o120777 << 16
        file.writestr(link, str(outside / "part.xml"))
    return path


def _attached_archive(folder: Path, outside: Path, *, nested: bool = False) -> Path:
    """Attaches a compressed archive, whose text no search in its bytes finds; perhaps in an archive."""
    child = f'<mujoco model="c">{MESH.format(outside / "mesh.obj")}</mujoco>'.replace("<geom ", '<body name="b"><geom ')
    with zipfile.ZipFile(folder / "child.mjz", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("child.xml", f"{child.replace('</worldbody>', '</body></worldbody>')}{' ' * 999}")
    (folder / "model.xml").write_text(
        '<mujoco><asset><model name="c" file="child.mjz"/></asset><worldbody><frame>'
        '<attach model="c" body="b" prefix="p"/></frame></worldbody></mujoco>'
    )
    if not nested:
        return folder / "model.xml"
    with zipfile.ZipFile(folder / "model.zip", "w") as file:
        for name in ("model.xml", "child.mjz"):
            file.write(folder / name, name)
    return folder / "model.zip"


def _nested_archive(folder: Path, outside: Path) -> Path:
    return _attached_archive(folder, outside, nested=True)


def _pipe(folder: Path, outside: Path) -> Path:
    if not (outside / "pipe").exists():
        os.mkfifo(outside / "pipe")
    (folder / "model.xml").write_text(f'<mujoco><include file="../{outside.name}/pipe"/></mujoco>')
    return folder / "model.xml"


MADE = {
    "include in an include": Form("include in an include", _nested_include),
    "mesh of an attached model": Form("mesh of an attached model", _attached_mesh),
    "chain of links": Form("chain of links", _chain),
    "link to a folder, and .. behind it": Form("link to a folder, and .. behind it", _through_link),
    "URDF, absolute": Form("URDF, absolute", _urdf_absolute),
    "URDF, relative": Form("URDF, relative", _urdf_relative),
    "URDF, meshdir": Form("URDF, meshdir", _urdf_meshdir, works=False),
    "archive with a link": Form("archive with a link", _archived_link, works=False),
    "mesh of an attached archive": Form("mesh of an attached archive", _attached_archive),
    "mesh of an archive in an archive": Form("mesh of an archive in an archive", _nested_archive),
    "a named pipe outside": Form("a named pipe outside", _pipe, works=False),
}
FORMS = tuple(MADE[name] if settings == "made" else _form(name, settings) for name, settings in INPUTS["FORMS"].items())


@measured(
    "reading outside the model's folder with --untrusted",
    "0 files opened (seen by inotify), nothing disclosed, exit 3; with Landlock, and by checks of paths alone",
    400,
)
def outside_files(quick: bool) -> Tally:
    tally = Tally()
    if sys.platform != "linux":
        tally.leave_out("all of it: inotify, which sees opened files, is part of Linux")
        return tally
    forms = FORMS[:1] + FORMS[16:17] if quick else FORMS
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        servers = {}
        if landlock.version():
            servers["Landlock"] = stack.enter_context(CommandServer(LIMIT, imports=QUICK_IMPORTS if quick else ()))
        elif not quick:
            tally.leave_out("confinement by Landlock: this kernel does not know it")
        if not quick or not servers:
            servers["checks of paths"] = stack.enter_context(CommandServer(LIMIT, without_landlock=True))
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
                case.try_named_files()
                case.try_missing_files()
    return tally


@dataclass
class Cases:
    """The cases of one kind of confinement."""

    tally: Tally
    means: str
    server: CommandServer
    watch: OpenWatch
    folder: Path

    @property
    def outside(self) -> Path:
        return self.folder / "outside"

    def try_form(self, form: Form, commands: tuple[tuple[str, ...], ...]) -> None:
        """Tries a form with several commands; without `--untrusted` the file must be opened, or it shows nothing."""
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
        for name, (text, command) in INPUTS["DOCUMENTS"].items():
            folder = self._clean_folder()
            _write_documents(folder, "good.xml")
            (folder / "doc.yaml").write_text(text.replace("OUT", "../outside").replace("ABS", str(self.outside)))
            arguments = command.replace("DOC", "doc.yaml").split()
            run = self.server.run(*arguments, "--untrusted", folder=folder)
            self._judge(run, f"document, {name}: {run}", {2, 3, 7})
            written = (self.outside / "stolen.csv").exists()
            self.tally.expect(not written, f"document, {name}: wrote a file outside")
            (self.outside / "stolen.csv").unlink(missing_ok=True)

    def try_commands_on_a_harmless_model(self) -> None:
        """Tries every command on a model that names no file outside."""
        folder = self._clean_folder()
        _write_documents(folder, "good.xml")
        for command in COMMANDS:
            if command[0] == "view":
                self.tally.leave_out(f"view on a harmless model, {self.means}: it waits for its user")
                continue
            arguments = ["good.xml" if word == "MODEL" else word for word in command]
            run = self.server.run(*arguments, "--untrusted", folder=folder)
            self._judge(run, f"harmless: {run}", {0, 1} if command[0] in ("fit", "check") else {0})

    def try_named_files(self) -> None:
        """Tries files that the command line names, which are read wherever they are, and files below `--root`."""
        folder = self._clean_folder()
        _write_documents(folder, "good.xml")
        run = self.server.run("trace", "good.xml", "--ctrl-from", "../outside/data.csv", "--untrusted", folder=folder)
        opened = self.watch.opened()
        named = [str(self.outside / "data.csv")]
        self.tally.expect(opened in ([], named), f"named table: opened {opened}: {run}")
        (folder / "model.xml").write_text('<mujoco><include file="../outside/part.xml"/></mujoco>')
        run = self.server.run("info", "model.xml", "--untrusted", "--root", "..", folder=folder)
        self.tally.expect(run.code == 0 and bool(self.watch.opened()), f"--root ..: {run}")

    def try_missing_files(self) -> None:
        """Tries names of existing and missing files: the messages must be the same."""
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
            self.tally.expect(
                messages[0] == messages[1], f"{name}: an existing file is distinguished from a missing one: {messages}"
            )

    def _judge(self, run: Ended, case: str, codes: set[int]) -> None:
        opened = self.watch.opened()
        case = f"{self.means}: {case}"
        self.tally.expect(not opened, f"{case}: opened {', '.join(opened)}")
        self.tally.expect(run.code in codes, f"{case}: expected {sorted(codes)}")
        faults = [*run.faults, *(["discloses the content of a file"] if SECRET in run.output else [])]
        self.tally.expect(not faults, f"{case}: {', '.join(faults)}")

    def _clean_folder(self) -> Path:
        folder = self.folder / "model"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        (folder / "good.xml").write_text(MODEL)
        self.watch.opened()
        return folder


def write_outside(folder: Path) -> None:
    """Writes files of every kind that a model can name."""
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
