"""Prints the lowest version of each library that mjrun accepts, as constraints for pip: `numpy==2`."""

import itertools
import re
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
for requirement in sorted({*project["dependencies"], *itertools.chain(*project["optional-dependencies"].values())}):
    if not requirement.startswith("mjrun["):
        print(re.sub(r"^([\w-]+)(?:\[\w+\])?>=([\d.]+)(?:,.*)?$", r"\1==\2", requirement))
