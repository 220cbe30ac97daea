"""Hostile tables: cut off, with false sizes, with code; and the result of every reader."""

import io
import pickle
import struct
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np
import pyarrow
import pyarrow.feather
import pyarrow.parquet
import scipy.io

from tests.scoreboard.data import inputs_of
from tests.scoreboard.input_forms import CANARY, CSV, TIME, Content, Form

ROWS = len(TIME)
COLUMNS = {"time": TIME, "qpos/hinge": np.sin(TIME), "ctrl/motor": np.cos(TIME)}
LINES = CSV.splitlines()
ESCAPE = "\x1b[2J\x1b]0;owned\x07"

# Readers of tables, with their command lines; {} is the table.
INPUTS = inputs_of(__name__)
READERS = INPUTS["READERS"]
# Exit codes of readers that can read such a table, but not use it; all others exit with 7.
EXCEPTIONS = {
    ("words", "points"): (2,),
    ("other keys", "plot"): (0,),  # without the row that has no time
    ("other keys", "replay"): (2,),  # a second row without numbers
    ("other magic", "plot"): (0, 7),  # of Feather, which pyarrow reads from its end
    ("other magic", "diff"): (0, 7),
    ("columns of other lengths", "fit"): (1, 7),  # of HDF5: one that is not fitted
    ("texts", "diff"): (1, 7),  # of HDF5: a column more than the other table has
    ("complex numbers", "diff"): (2, 7),  # of MAT, whose names are others: qpos_hinge
    **{("a structure", reader): (2, 7) for reader in READERS if reader not in ("plot", "controls")},
    ("cut off at 10.0%", "ghost"): (2,),  # a recording, by its suffix
    ("text", "points"): (2,),  # read as one, with names that vary nothing
    ("the text of another file", "replay"): (2,),
}


class Bomb:
    """An object that makes the canary when it is unpickled."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, str]]:
        return open, (CANARY, "w")


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def header(descr: str, shape: str, order: str = "False") -> bytes:
    """Returns the head of an .npy with any content."""
    text = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}"
    text += " " * (-(len(text) + 11) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


def archive(members: Mapping[str, bytes], packed: bool = False) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as out:
        for name, content in members.items():
            out.writestr(name, content)
    return stream.getvalue()


def npz(**changed: bytes) -> bytes:
    """Returns an archive of the columns, with changed `time` or `position` (and thus control)."""
    names = {"time": "time", "position": "qpos/hinge", "control": "ctrl/motor"}
    changed = {"control": changed["position"], **changed} if "position" in changed else changed
    members = {f"{name}.npy": changed.get(key) or npy(COLUMNS[name]) for key, name in names.items()}
    return archive(members)


def parquet(path: Path, columns: Mapping[str, object] = COLUMNS) -> None:
    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)


def feather(path: Path) -> None:
    pyarrow.feather.write_feather(pyarrow.table(COLUMNS), str(path))


def hdf5(change: Callable[[h5py.File], object] = lambda file: None) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, values in COLUMNS.items():
                file[name] = values
            change(file)

    return make


def mat(**changed: object) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"time": TIME, "qpos_hinge": np.sin(TIME), **changed})
    return stream.getvalue()


def made(make: Callable[[Path], object]) -> Callable[[], bytes]:
    """Returns a function for the bytes that `make` writes."""

    def read() -> bytes:
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            make(Path(folder, "file"))
            return Path(folder, "file").read_bytes()

    return read


def cut(content: bytes, share: float) -> bytes:
    return content[: int(share * len(content))]


def flipped(content: bytes, at: float) -> bytes:
    place = int(at * len(content))
    return content[:place] + bytes([content[place] ^ 0xFF]) * 4 + content[place + 4 :]


def _link_outside(file: h5py.File) -> None:
    del file["time"]
    file["time"] = h5py.ExternalLink("../outside.h5", "/time")


def _virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((ROWS,), float)
    layout[:] = h5py.VirtualSource("../outside.h5", "time", (ROWS,))
    del file["time"]
    file.create_virtual_dataset("time", layout)


def _external(file: h5py.File) -> None:
    del file["time"]
    file.create_dataset("time", (ROWS,), float, external=[("../between.txt", 0, 8 * ROWS)])


def _endless(file: h5py.File) -> None:
    for name in COLUMNS:
        del file[name]
        file.create_dataset(name, (10**13,), float, chunks=(2**20,), compression="gzip")


def _circle(file: h5py.File) -> None:
    file["more"] = h5py.SoftLink("/")
    file["group/up"] = file["/"]
    file["lost"] = h5py.SoftLink("/nowhere")


def broken() -> Iterator[tuple[str, str, Content]]:
    """Yields tables that no reader accepts: the fault, the name of the file, and its content."""
    yield "empty", "t.csv", b""
    yield "a newline", "t.csv", b"\n"
    yield "no header", "t.csv", "0,1,2\n1,2,3\n"
    yield "UTF-16", "t.csv", CSV.encode("utf-16")
    yield "UTF-32", "t.csv", CSV.encode("utf-32")
    yield "NUL in the header", "t.csv", CSV.replace("hinge", "hin\0ge", 1)
    yield "NUL in a cell", "t.csv", CSV.replace("\n0.05,", "\n0.0\x005,")
    yield "short rows", "t.csv", CSV.replace("\n0.05,", "\n")
    yield "long rows", "t.csv", CSV.replace("\n0.05,", "\n1,0.05,")
    yield "words", "t.csv", CSV.replace("\n0.05,", "\nfive,")
    yield "digits of another script", "t.csv", CSV.replace("\n0.05,", "\n٠.٠٥,")
    yield "underscores", "t.csv", CSV.replace("\n0.05,", "\n1_000,")
    yield "hexadecimal", "t.csv", CSV.replace("\n0.05,", "\n0x1p3,")
    yield "a quote that stays open", "t.csv", CSV.replace("\n0.05,", '\n"0.05,')
    yield "escape sequences in a cell", "t.csv", CSV.replace("\n0.05,", f"\n{ESCAPE},")
    yield (
        "two columns of one name",
        "t.csv",
        "\n".join([f"{LINES[0]},time", *(f"{line},1" for line in LINES[1:])]) + "\n",
    )
    yield "semicolons", "t.csv", CSV.replace(",", ";")
    yield "binary", "t.csv", bytes(range(256)) * 40
    yield "a cell of 20 MB", "t.csv", CSV.replace("\n0.05,", f"\n{'9' * 20_000_000}x,")
    yield "a line that never ends", "t.csv", CSV + "1" * 30_000_000
    yield "a pickle", "t.csv", pickle.dumps(Bomb())
    yield "the text of another file", "t.csv", "root:x:0:0:root:/root:/bin/bash\n"

    yield "empty", "t.jsonl", b""
    yield "no JSON", "t.jsonl", "time 0\n"
    yield "a list", "t.jsonl", "[1, 2]\n"
    yield "cut off", "t.jsonl", '{"time": 0, "qpos/hinge": 1, "ctrl/motor": 0}\n{"time": 1, "qpos'
    yield "deep", "t.jsonl", '{"time": ' + "[" * 100_000 + "]" * 100_000 + "}\n"
    yield "two keys of one name", "t.jsonl", '{"time": 0, "time": 1, "qpos/hinge": 0, "ctrl/motor": 0}\n'
    yield "numbers in quotes", "t.jsonl", '{"time": "0", "qpos/hinge": "0", "ctrl/motor": "0"}\n'
    yield "other keys", "t.jsonl", '{"time": 0, "qpos/hinge": 1, "ctrl/motor": 0}\n{"thyme": 1}\n'
    yield "lists for numbers", "t.jsonl", '{"time": [0], "qpos/hinge": [1], "ctrl/motor": [0]}\n'
    yield "UTF-16", "t.jsonl", '{"time": 0}\n'.encode("utf-16")
    yield "a bad escape", "t.jsonl", '{"time": 0, "\\ud800": 1, "qpos/hinge": 1, "ctrl/motor": 0}\n'
    yield "an integer of 5,000 digits", "t.jsonl", f'{{"time": {"9" * 5000}, "qpos/hinge": 1, "ctrl/motor": 0}}\n'

    good = npz()
    yield "empty", "t.npz", b""
    yield "no archive", "t.npz", b"PK\3\4" + bytes(100)
    for share in (0.1, 0.5, 0.9, 0.999):
        yield f"cut off at {share:.1%}", "t.npz", cut(good, share)
    yield "objects that unpickle", "t.npz", npz(position=npy(np.array([Bomb()] * ROWS, object)))
    yield (
        "a lie of 10^15 rows",
        "t.npz",
        npz(position=header("'<f8'", f"({10**15},)"), time=header("'<f8'", f"({10**15},)")),
    )
    yield "a negative shape", "t.npz", npz(position=header("'<f8'", "(-1,)") + bytes(160))
    yield "rows beyond 64 bits", "t.npz", npz(position=header("'<f8'", f"({2**70},)") + bytes(160))
    yield "no rows but 2^60 columns", "t.npz", npz(position=header("'<f8'", f"(20, {2**60})") + bytes(160))
    yield "a header with code", "t.npz", npz(position=header(f"open('{CANARY}', 'w')", "(20,)") + bytes(160))
    yield "a header of 60,000 brackets", "t.npz", npz(position=header("[" * 30_000 + "]" * 30_000, "(20,)"))
    yield "a version of the future", "t.npz", npz(position=b"\x93NUMPY\x09\x00" + bytes(200))
    yield "records", "t.npz", npz(position=npy(np.zeros(ROWS, [("a", float)])))
    yield "complex numbers", "t.npz", npz(position=npy(np.zeros(ROWS, complex)))
    yield "texts", "t.npz", npz(position=npy(np.array(["x"] * ROWS)))
    yield "dates", "t.npz", npz(position=npy(np.zeros(ROWS, "datetime64[s]")))
    yield "columns of other lengths", "t.npz", npz(position=npy(np.zeros(7)))
    yield "more bytes than the shape", "t.npz", npz(position=header("'<f8'", "(20,)") + bytes(400))
    yield "less bytes than the shape", "t.npz", npz(position=header("'<f8'", "(20,)") + bytes(80))
    yield "two members of one name", "t.npz", _doubled()
    yield "a checksum that is wrong", "t.npz", _recomputed(good)
    yield "sizes of zip64 that lie", "t.npz", _zip64_lie()
    yield "encrypted", "t.npz", _encrypted(good)
    yield "a method nobody knows", "t.npz", _method(good, 77)

    for name, content in (("t.parquet", made(parquet)()), ("t.feather", made(feather)()), ("t.h5", made(hdf5())())):
        yield "empty", name, b""
        yield "other magic", name, content[:-4] + b"XXXX" if name == "t.parquet" else b"XXXXXXXX" + content[8:]
        for share in (0.05, 0.5, 0.95):
            yield f"cut off at {share:.0%}", name, cut(content, share)
        yield "text", name, CSV
        yield "zeros", name, bytes(len(content))
    for name, write in (("t.parquet", pyarrow.parquet.write_table), ("t.feather", pyarrow.feather.write_feather)):
        texts = pyarrow.table({name: pyarrow.array(["x"] * ROWS) for name in COLUMNS})
        yield "texts", name, lambda path, write=write, table=texts: write(table, str(path))
        lists = pyarrow.table({name: pyarrow.array([[1.0]] * ROWS) for name in COLUMNS})
        yield "lists", name, lambda path, write=write, table=lists: write(table, str(path))
        twice = pyarrow.Table.from_arrays([pyarrow.array(TIME)] * 4, [*COLUMNS, "time"])
        yield "two columns of one name", name, lambda path, write=write, table=twice: write(table, str(path))
    yield "a footer longer than the file", "t.parquet", made(parquet)()[:-8] + struct.pack("<I", 2**31 - 1) + b"PAR1"
    yield "rows without end", "t.h5", hdf5(_endless)
    yield "a column in another file", "t.h5", hdf5(_virtual)
    yield "a column in the bytes of another file", "t.h5", hdf5(_external)
    yield "columns of other lengths", "t.h5", hdf5(lambda file: file.create_dataset("qpos/other", data=[1.0]))
    yield "texts", "t.h5", hdf5(lambda file: file.create_dataset("note", data=["x"] * ROWS))

    content = mat()
    yield "empty", "t.mat", b""
    for share in (0.2, 0.5, 0.99):
        yield f"cut off at {share:.0%}", "t.mat", cut(content, share)
    yield "of version 4", "t.mat", bytes(20) + content
    yield "a size of 4 GB", "t.mat", content[:132] + struct.pack("<I", 2**32 - 1) + content[136:]
    yield "a structure", "t.mat", mat(time={"a": 1.0})
    yield "complex numbers", "t.mat", mat(time=TIME * 1j)
    yield "HDF5 of version 7.3", "t.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400)


def _doubled() -> bytes:
    stream = io.BytesIO()
    import warnings

    with zipfile.ZipFile(stream, "w") as out, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in (*COLUMNS, "time"):
            out.writestr(f"{name}.npy", npy(TIME))
    return stream.getvalue()


def _recomputed(content: bytes) -> bytes:
    """Returns the archive with a wrong checksum of its first member in its directory."""
    at = content.index(b"PK\1\2") + 16
    return content[:at] + b"\1\2\3\4" + content[at + 4 :]


def _zip64_lie() -> bytes:
    """Returns an archive whose directory claims a member of 2^62 bytes."""
    content = bytearray(npz())
    at = content.index(b"PK\1\2")
    length = struct.unpack("<H", content[at + 28 : at + 30])[0]
    content[at + 20 : at + 28] = b"\xff" * 8
    content[at + 30 : at + 32] = struct.pack("<H", 20)
    extra = struct.pack("<HHQQ", 1, 16, 2**62, 2**62)
    content[at + 46 + length : at + 46 + length] = extra
    end = content.rindex(b"PK\5\6")
    size = struct.unpack("<I", content[end + 12 : end + 16])[0]
    content[end + 12 : end + 16] = struct.pack("<I", size + len(extra))
    return bytes(content)


def _encrypted(content: bytes) -> bytes:
    at = content.index(b"PK\1\2") + 8
    return content[:at] + b"\1\0" + content[at + 2 :]


def _method(content: bytes, method: int) -> bytes:
    at = content.index(b"PK\1\2") + 10
    return content[:at] + struct.pack("<H", method) + content[at + 2 :]


def _packed_rows(path: Path) -> None:
    columns = {"time": np.arange(2e7) * 0.01, "qpos/hinge": np.zeros(2 * 10**7)}
    path.write_bytes(archive({f"{name}.npy": npy(column) for name, column in columns.items()}, packed=True))


def odd() -> Iterator[tuple[str, str, Content, dict[str, tuple[int, ...]]]]:
    """Yields tables that can be read, with the exit codes of each reader."""
    gaps = {"plot": (0,), "diff": (1,), "replay": (0, 7), "controls": (0, 2, 7), "fit": (0, 1, 2, 7)}
    rows = [line.split(",") for line in LINES]
    rows[6][1] = "nan"
    yield "NaN in a position", "t.csv", "\n".join(map(",".join, rows)) + "\n", gaps
    rows[6][1:] = ["inf", "-inf"]
    infinite = {"plot": (0,), "diff": (1,), "replay": (2, 7), "controls": (2, 7), "fit": (0, 1, 2, 7)}
    yield "infinite positions and controls", "t.csv", "\n".join(map(",".join, rows)) + "\n", infinite
    rows = [line.split(",") for line in LINES]
    rows[6][0] = rows[5][0]
    same = {"plot": (0,), "diff": (1, 7), "replay": (0, 2, 7), "controls": (0, 2, 7), "fit": (0, 1, 2, 7)}
    yield "a time twice", "t.csv", "\n".join(map(",".join, rows)) + "\n", same
    rows[6][0] = "nan"
    without = {"plot": (0, 7), "diff": (1, 2, 7), "replay": (2, 7), "controls": (2, 7), "fit": (2, 7)}
    yield "a time that is none", "t.csv", "\n".join(map(",".join, rows)) + "\n", without
    rows[6][0] = "1e300"
    late = {"plot": (0,), "diff": (7,), "replay": (2, 7), "controls": (2, 7), "fit": (2, 7)}
    yield "a time of 1e300 s, and back", "t.csv", "\n".join(map(",".join, rows)) + "\n", late
    falling = "\n".join([LINES[0], *reversed(LINES[1:])]) + "\n"
    yield "times that fall", "t.csv", falling, late | {"diff": (0, 1, 2, 7)}
    huge = "\n".join([LINES[0], "0,0,0", "1e15,1,1"]) + "\n"
    endless = {"plot": (0,), "diff": (1,), "replay": (2, 7), "controls": (0,), "fit": (2, 7)}
    yield "a table of 30 million years", "t.csv", huge, endless
    yield (
        "only a header",
        "t.csv",
        LINES[0] + "\n",
        {"plot": (0, 2, 7), "diff": (7,), "replay": (2, 7), "controls": (2, 7), "fit": (2, 7)},
    )
    names = (
        LINES[0] + f",{ESCAPE},=1+1,../../x,%s%n,{'n' * 5000}\n" + "".join(f"{line},1,2,3,4,5\n" for line in LINES[1:])
    )
    unlike = {"plot": (0, 7), "diff": (1,), "replay": (0,), "controls": (0,), "fit": (0, 1)}
    yield "escape sequences in names of columns", "t.csv", names, unlike
    yield (
        "Latin-1 in names of columns",
        "t.csv",
        (LINES[0] + ",gr\xf6\xdfe\n" + "".join(f"{line},1\n" for line in LINES[1:])).encode("latin-1"),
        unlike | {"diff": (1, 7)},
    )
    wide = ",".join(f"c{i}" for i in range(10**5))
    ones = "," + ",".join("1" * 10**5)
    yield (
        "100,000 columns",
        "t.csv",
        "".join(f"{line},{wide if not i else ones[1:]}\n" for i, line in enumerate(LINES[:3])),
        {"plot": (0, 2, 7), "diff": (1,), "replay": (0,), "controls": (0,), "fit": (0, 1, 2, 7)},
    )
    far = CSV.replace(LINES[6], "0.05,1e308,1e308")
    yield (
        "positions and controls of 1e308",
        "t.csv",
        far,
        {"plot": (0,), "diff": (1,), "replay": (0, 2, 4, 7), "controls": (0, 4), "fit": (0, 1, 2, 4, 7)},
    )
    yield "20 million rows that are packed", "t.npz", _packed_rows, {"plot": (0,), "diff": (1,)}
    yield (
        "a link to another file",
        "t.h5",
        hdf5(_link_outside),
        dict.fromkeys(("plot", "diff", "replay", "controls", "fit"), (7,)),
    )
    yield (
        "links in a circle",
        "t.h5",
        hdf5(_circle),
        {"plot": (0, 7), "diff": (0, 1, 7), "replay": (0, 7), "controls": (0, 7), "fit": (0, 1, 7)},
    )
    yield (
        "a manifest that is none",
        "t.h5",
        hdf5(lambda file: file.attrs.__setitem__("manifest", np.bytes_(b"{" * 60000))),
        {"plot": (0,), "diff": (0, 1), "replay": (0,), "controls": (0,), "fit": (0, 1)},
    )


def forms() -> Iterator[Form]:
    outside = {"../outside.h5": hdf5()}
    everybody = ("plot", "diff", "replay", "controls", "fit")
    for index, (what, name, content) in enumerate(broken()):
        readers = list(READERS) if index % 9 == 0 else ["plot", everybody[1 + index % 4]]
        for reader in readers:
            line = tuple(word.format(name) for word in READERS[reader])
            codes = EXCEPTIONS.get((what, reader), (7,))
            quick = index % 5 == 0 and reader == "diff"
            says = () if min(codes) < 2 else (name,)
            yield Form(f"{name}, {what}, {reader}", line, codes, {**outside, name: content}, says, quick=quick)
    for what, name, content, codes in odd():
        for reader, expected in codes.items():
            line = tuple(word.format(name) for word in READERS[reader])
            yield Form(f"{name}, {what}, {reader}", line, expected, {**outside, name: content})
