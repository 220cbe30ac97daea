"""The suffixes of model files and of documents, and which model files can be used for what."""

from pathlib import Path

YAML = (".yaml", ".yml")  # run documents, studies, fits, evaluations, tasks, camera scripts; LEAPP packages

XML = (".xml", ".urdf")  # text: MJCF and URDF
ARCHIVES = (".mjz", ".zip")  # MJCF with its assets
COMPILED = (".mjb",)  # binary, without a source: nothing can be overridden, and MuJoCo does not check its content
MODELS = (*XML, *ARCHIVES, *COMPILED)  # all that can be loaded; in lower case, as MuJoCo knows no other

# What is searched for in folders: a .zip is seldom a model there, and a compiled model has no text to be checked.
CHECKED = (*XML, ".mjz")
# Files that name others beside them.
REFERRING = (*MODELS, *YAML)


def is_yaml(path: str | Path) -> bool:
    """Returns whether a path ends like a document, in lower or upper case."""
    return Path(path).suffix.lower() in YAML
