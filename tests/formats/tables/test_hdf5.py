"""HDF5, beside h5py."""

import contextlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from mjrun.errors import FileError
from mjrun.formats import table_read_stream
from mjrun.formats.table_reader import open_table, read_table
from mjrun.formats.table_writer import TableWriter
from mjrun.model.table_column import Column


def write(path: Path, data: np.ndarray, columns: list[Column]) -> Path:
    with TableWriter(str(path), "hdf5", columns, {"seed": 7}) as out:
        out.write(data)
        out.publish()
    return path


def test_columns_are_datasets_in_groups_with_units_and_a_manifest(tmp_path: Path) -> None:
    columns = [Column("time", "s"), Column("qpos/root/x", "m"), Column("qpos/knee", "rad")]
    data = np.arange(12.0).reshape(4, 3)
    with h5py.File(write(tmp_path / "t.h5", data, columns)) as found:
        assert [found[column.name].attrs["index"] for column in columns] == [0, 1, 2]
        for column, values in zip(columns, data.T, strict=True):
            dataset = found[column.name]
            assert isinstance(dataset, h5py.Dataset)
            assert (dataset.dtype.str, dataset[:].tolist()) == ("<f8", values.tolist())
        assert [found[column.name].attrs["unit"] for column in columns] == [b"s", b"m", b"rad"]
        assert found.attrs["manifest"] == b'{"seed": 7}'
    table = read_table(tmp_path / "t.h5")
    assert table.names == ["time", "qpos/root/x", "qpos/knee"]
    assert table.units == {"time": "s", "qpos/root/x": "m", "qpos/knee": "rad"}
    with open_table(tmp_path / "t.h5", "time") as opened:
        assert opened.manifest == {"seed": 7}


def test_a_manifest_and_columns_may_be_many(tmp_path: Path) -> None:
    columns, manifest = [Column(f"qpos/{'long' * 40}_{index}") for index in range(450)], {"note": "é" * 100_000}
    with TableWriter(str(tmp_path / "t.h5"), "hdf5", columns, manifest) as out:
        out.write(np.arange(450.0)[None])
        out.publish()
    with open_table(tmp_path / "t.h5") as table:
        assert table.manifest == manifest
        assert table.names == tuple(column.name for column in columns)
        assert next(table.blocks()).tolist() == [[*range(450)]]


def test_files_of_others_are_read_with_groups_arrays_and_every_kind_of_number(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "t.hdf5", "w") as file:
        file["time"] = np.arange(3000) / 7
        file["robot/joint/knee"] = np.arange(3000, dtype=np.int16)
        file["robot/flags"] = np.arange(3000) % 2 == 0
        file.create_dataset("big", data=np.arange(3000, dtype=">f4"), chunks=(7,), compression="gzip", shuffle=True)
        file.create_dataset("qpos", data=np.arange(9000.0).reshape(3000, 3), maxshape=(None, 3))
        file["tall"] = np.arange(3000.0)[:, None]
        file["note"] = "text"
        file["again"] = file["robot/joint"]  # a hard link to a group
        file["robot/soft"] = h5py.SoftLink("/time")
        file["robot/loop"] = file["robot"]
        file["broken"] = h5py.SoftLink("/nowhere")
    names: list[str] = []
    read_table(tmp_path / "t.hdf5", lambda name: bool(names.append(name)))
    assert {"time", "robot/joint/knee", "qpos/0", "qpos/1", "qpos/2", "tall", "note", "again/knee", "robot/soft"} <= {
        *names
    }
    wanted = ["robot/joint/knee", "robot/flags", "big", "qpos/2", "qpos/0", "tall", "robot/soft"]
    table = read_table(tmp_path / "t.hdf5", wanted)
    expected = [np.arange(3000)] * 3 + [np.arange(3000) * 3 + 2, np.arange(3000) * 3] + [np.arange(3000)]
    expected[1] = np.arange(3000) % 2 == 0
    for name, values in zip(wanted, [*expected, np.arange(3000) / 7], strict=True):
        assert np.array_equal(table[name], values), name
    assert table.units["big"] == ""


def test_rows_are_read_in_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_read_stream, "PIECE", 8)
    data = np.random.default_rng(2).random((11, 3))
    write(tmp_path / "t.h5", data, [Column("a"), Column("b"), Column("c")])
    with open_table(tmp_path / "t.h5", ["a", "c"]) as table:
        blocks = list(table.blocks())
    assert [len(block) for block in blocks] == [4, 4, 3]
    assert np.array_equal(np.concatenate(blocks), data[:, [0, 2]])


def test_what_is_in_another_file_stays_there(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(np.arange(4.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.arange(4.0)
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["time"] = np.arange(4.0)
        file["linked"] = h5py.ExternalLink("other.h5", "/secret")
        file.create_dataset("outside", (4,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 32)])
        layout = h5py.VirtualLayout((4,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "secret", (4,))
        file.create_virtual_dataset("virtual", layout)
    assert read_table(tmp_path / "t.h5", "time").names == ["time"]
    for name in ("linked", "outside", "virtual"):
        with pytest.raises(FileError, match=f"column '{name}' is in another file, which is not read"):
            read_table(tmp_path / "t.h5", name)


def test_rows_that_no_file_of_its_size_can_have_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (10**13,), float, chunks=(2**20,), compression="gzip")
    with pytest.raises(FileError, match="is too small for the 10,000,000,000,000 rows that its header declares"):
        open_table(path)


TEXTS = ["floor", "", "grün 🚗", "x" * 5000, "floor"] * 40


def exact_cells(path: Path, name: str) -> list[object]:
    with open_table(path, name, exact=True) as table:
        return [cell for block in table.blocks() for cell in block[:, 0].tolist()]


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"chunks": (7,)},
        {"dtype": h5py.string_dtype(length=5000)},
        {"dtype": h5py.string_dtype(length=5000), "compression": "gzip"},
    ],
    ids=str,
)
@pytest.mark.parametrize("version", ["earliest", "latest"])
@pytest.mark.parametrize("block", [0, 512])
def test_texts_of_others_are_read_however_they_are_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], version: str, block: int
) -> None:
    monkeypatch.setattr(table_read_stream, "PIECE", 22)
    with h5py.File(tmp_path / "t.h5", "w", libver=version, userblock_size=block) as file:
        data = [text.encode() for text in TEXTS] if "dtype" in settings else np.array(TEXTS, object)
        file.create_dataset("note", data=data, **{"dtype": h5py.string_dtype()} | settings)
        file.create_dataset("unwritten", (200,), h5py.string_dtype())
    cells = exact_cells(tmp_path / "t.h5", "note")
    assert [text if isinstance(text, str) else "" for text in cells] == TEXTS
    assert np.isnan(np.array(exact_cells(tmp_path / "t.h5", "unwritten"), float)).all()
    with pytest.raises(FileError, match="column 'note' holds text, not numbers"):
        read_table(tmp_path / "t.h5", "note")


def test_compressed_texts_of_variable_length_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file.create_dataset("note", data=np.array(TEXTS, object), dtype=h5py.string_dtype(), compression="gzip")
    with pytest.raises(FileError, match=r"cannot be read as .h5: compressed variable-length strings"):
        exact_cells(tmp_path / "t.h5", "note")


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_heap_of_texts_is_read_or_refused_and_never_hangs(tmp_path: Path, seed: int) -> None:
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file.create_dataset("note", data=np.array(TEXTS[:3], object), dtype=h5py.string_dtype())
    content = bytearray((tmp_path / "t.h5").read_bytes())
    random, heap = np.random.default_rng(seed), content.index(b"GCOL")
    for at in random.integers(heap, heap + 120, 3):
        content[at] = random.integers(256)
    (tmp_path / "b.h5").write_bytes(content)
    with contextlib.suppress(FileError):
        assert len(exact_cells(tmp_path / "b.h5", "note")) == 3
