"""Pipes, sockets, devices, links and folders where a model or one of its files is looked for."""

from collections.abc import Iterator, Mapping

from tests.scoreboard.forms.form import EITHER, REFUSED, Content, Fifo, Folder, Form, Link, Socket, mjcf

GEOM = '<worldbody><geom type="{0}" {0}="a"/></worldbody>'
# How a model names the file {0}, by what the file should be.
NAMING = {
    "include": '<include file="{0}.xml"/>',
    "attached model": '<asset><model name="a" file="{0}.xml"/></asset>',
    "mesh": '<asset><mesh name="a" file="{0}.stl"/></asset>' + GEOM.format("mesh"),
    "OBJ mesh": '<asset><mesh name="a" file="{0}.obj"/></asset>' + GEOM.format("mesh"),
    "mesh in a folder": '<compiler meshdir="."/><asset><mesh name="a" file="{0}.msh"/></asset>' + GEOM.format("mesh"),
    "height field": '<asset><hfield name="a" file="{0}.bin" size="1 1 1 1"/></asset>' + GEOM.format("hfield"),
    "height field as a PNG": '<asset><hfield name="a" file="{0}.png" size="1 1 1 1"/></asset>',
    "texture": '<asset><texture name="a" type="2d" file="{0}.png"/></asset>',
    "face of a cube": '<asset><texture name="a" type="cube" fileback="{0}.png"/></asset>',
    "skin": '<worldbody><body name="b"><geom size="1"/></body></worldbody>'
    '<deformable><skin file="{0}.skn"/></deformable>',
    "flexcomp": '<worldbody><flexcomp name="a" type="gmsh" file="{0}.msh" dim="3"/></worldbody>',
    "flexcomp mesh": '<worldbody><flexcomp name="a" type="mesh" file="{0}.obj" dim="2"/></worldbody>',
}
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


def _file_name(naming: str) -> str:
    return naming.split("file", 1)[1].split('"')[1].format("file")


def forms() -> Iterator[Form]:
    for kind, content in KINDS.items():
        for role, naming in NAMING.items():
            name = _file_name(naming)
            written = Link(name) if isinstance(content, Link) and content.to == "{itself}" else content
            files = {"model.xml": mjcf(naming.format("file")), name: written}
            yield Form(f"{kind} as {role}", files, loads=REFUSED)
        for model in ("model.xml", "model.urdf", "model.zip", "model.mjz", "model.mjb"):
            written = Link(model) if isinstance(content, Link) and content.to == "{itself}" else content
            yield Form(f"{kind} as {model}", {model: written}, model, REFUSED)
        robot = '<robot name="r"><link name="l"><visual><geometry><mesh filename="package://r/file.stl"/>'
        robot += "</geometry></visual></link></robot>"
        written = Link("file.stl") if isinstance(content, Link) and content.to == "{itself}" else content
        yield Form(f"{kind} as a mesh of URDF", {"model.urdf": robot, "file.stl": written}, "model.urdf", EITHER)
    for path in ("/dev/zero", "/dev/null", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0", "/dev/ptmx"):
        yield Form(f"{path} as an include", {"model.xml": mjcf(f'<include file="{path}"/>')}, loads=REFUSED)
        mesh = f'<asset><mesh name="a" file="{path}" content_type="model/stl"/></asset>' + GEOM.format("mesh")
        yield Form(f"{path} as a mesh", {"model.xml": mjcf(mesh)}, loads=REFUSED)
