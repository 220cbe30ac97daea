"""Theorems about models among files and folders."""

import os
from pathlib import Path

from mjrun.check.check import find_models, root_tag


def test_a_folder_means_the_models_below_it_that_stand_by_themselves() -> None:
    for name, text in {
        "b/two.xml": "<!-- a remark --><mujoco/>",
        "b/part.xml": "<mujocoinclude/>",
        "b/other.xml": "not xml at all",
        "a/one.urdf": '<robot name="r"/>',
        "a/three.mjz": "",
        "a/notes.txt": "<mujoco/>",
        ".hidden/four.xml": "<mujoco/>",
        "five.xml": "<mujoco/>",
    }.items():
        path = Path(name)
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    models, skipped = find_models([".", "gone.xml", "five.xml"])
    assert models == ["five.xml", "a/one.urdf", "a/three.mjz", "b/two.xml", "gone.xml"]
    assert skipped == 2
    assert find_models(["five.xml", "b/part.xml", "b/other.xml"]) == (["five.xml", "b/other.xml"], 1)


def test_the_root_of_a_pipe_is_not_waited_for() -> None:

    os.mkfifo("pipe.xml")
    assert root_tag(Path("pipe.xml")) == ""
