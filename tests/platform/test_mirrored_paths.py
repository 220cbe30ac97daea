"""Mirrors of absolute paths, on POSIX and on Windows."""

from pathlib import PurePath, PurePosixPath, PureWindowsPath

import pytest

from mjrun.platform.mirrored_paths import mirrored, with_original_paths

POSIX, WINDOWS = PurePosixPath("/tmp/.mjrun/files"), PureWindowsPath("C:\\Temp\\.mjrun (1)\\files")


@pytest.mark.parametrize(
    ("root", "path", "place"),
    [
        (POSIX, "/home/ada/a.xml", "home/ada/a.xml"),
        (POSIX, "/a/../b/c.xml", "a/../b/c.xml"),
        (WINDOWS, "C:\\models\\a.xml", "C\\models\\a.xml"),
        (WINDOWS, "d:/models/a.xml", "d\\models\\a.xml"),
        (WINDOWS, "\\\\server\\share\\a.xml", "UNC\\server\\share\\a.xml"),
        (WINDOWS, "\\\\?\\C:\\models\\a.xml", "C\\models\\a.xml"),
        (WINDOWS, "\\\\?\\UNC\\server\\share\\a.xml", "UNC\\server\\share\\a.xml"),
    ],
)
def test_files_are_mirrored_below_the_root(root: PurePath, path: str, place: str) -> None:
    copy = mirrored(root, type(root)(path))
    assert copy == root / place
    assert not any(":" in part for part in copy.parts[1:])


@pytest.mark.parametrize(
    ("text", "original"),
    [
        (f"{WINDOWS}\\C\\data\\late.xml", "late.xml"),
        (f"{WINDOWS}\\C\\data\\meshes\\a.obj:1", "meshes\\a.obj:1"),
        (f"{WINDOWS.as_posix()}/C/data/late.xml", "late.xml"),
        (f"{WINDOWS}\\C\\database\\x", "C:\\database\\x"),
        (f"open '{WINDOWS}\\D\\x.xml': no", "open 'D:\\x.xml': no"),
        (f"{WINDOWS.as_posix()}/D/x.xml", "D:/x.xml"),
        (f"{WINDOWS}\\UNC\\server\\share\\a.xml", "\\\\server\\share\\a.xml"),
        ("C:\\data\\late.xml", "C:\\data\\late.xml"),
    ],
)
def test_texts_name_the_originals_on_windows(text: str, original: str) -> None:
    assert with_original_paths(text, WINDOWS, PureWindowsPath("C:\\data")) == original


@pytest.mark.parametrize(
    ("folder", "text", "original"),
    [
        ("/data", f"{POSIX}/data/late.xml and {POSIX}/etc/x", "late.xml and /etc/x"),
        ("/data", f"{POSIX}/database/x", "/database/x"),
        ("/", f"{POSIX}/late.xml", "late.xml"),
    ],
)
def test_texts_name_the_originals_elsewhere(folder: str, text: str, original: str) -> None:
    assert with_original_paths(text, POSIX, PurePosixPath(folder)) == original
