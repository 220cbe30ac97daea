"""The suffixes of model files, of documents and of demonstrations, which model files can be used for what, and URLs."""

import re
from os import PathLike
from pathlib import Path

YAML = (".yaml", ".yml")  # run documents, studies, fits, evaluations, tasks, camera scripts; LEAPP packages

XML = (".xml", ".urdf")  # text: MJCF and URDF
ARCHIVES = (".mjz", ".zip")  # MJCF with its assets
COMPILED = (".mjb",)  # binary, without a source: nothing can be overridden, and MuJoCo does not check its content
MODELS = (*XML, *ARCHIVES, *COMPILED)  # all that can be loaded; in lower case, as MuJoCo knows no other

MOTIONS = (".npz", ".csv")  # recordings, and the most common tables, which can be replayed on a model

HTML = (".html", ".htm")  # pages

HDF5 = (".h5", ".hdf5")  # tables, and demonstrations, of which FILE:EPISODE names one

# What is searched for in folders: a .zip is seldom a model there, and a compiled model has no text to be checked.
CHECKED = (*XML, ".mjz")
# Files that name others beside them.
REFERRING = (*MODELS, *YAML)
# What users write themselves, and no other output may replace.
SOURCES = (*REFERRING, ".py")


URL = re.compile(r"([a-zA-Z][a-zA-Z0-9+.-]+)://.+")  # with its scheme


def is_url(path: "str | PathLike[str]") -> bool:
    """Returns whether a text is the URL of a folder or of a file, such as `s3://bucket/study`."""
    return isinstance(path, str) and URL.fullmatch(path) is not None


def is_yaml(path: str | Path) -> bool:
    """Returns whether a path ends like a document, in lower or upper case."""
    return Path(path).suffix.lower() in YAML


def split_episode(path: str | Path) -> tuple[str, str]:
    """Splits `demo.hdf5:demo_3` into the file and the episode in it, which is empty for a file alone."""
    first, *others = str(path).split(":")
    for index in range(len(others)):
        file = ":".join([first, *others[:index]])
        if is_hdf5(file):
            return file, ":".join(others[index:])
    return str(path), ""


def is_hdf5(path: str | Path) -> bool:
    """Returns whether a path ends like an HDF5 file, in lower or upper case."""
    return Path(path).suffix.lower() in HDF5
