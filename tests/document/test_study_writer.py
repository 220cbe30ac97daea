"""A study is written as a document without loading what reads documents."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.document.study_writer import portable_document, study_document, study_text
from mjrun.errors import UsageError
from mjrun.simulation.simulation import Simulation
from mjrun.study.study import Study


def study(model: str = "models/a.xml") -> Study:
    vary = {"model": "models/a.xml,scene:dominos", "ctrl_from": "tables/a.csv", "seed": "1,2"}
    return Study(Simulation(model, steps=3), "study", vary=vary, metric={"low": "min(qpos/ball/z)"})


def test_it_holds_what_is_not_the_default() -> None:
    vary = {"model": "models/a.xml,scene:dominos", "ctrl_from": "tables/a.csv", "seed": [1, 2]}
    metrics = {"low": "min(qpos/ball/z)"}
    written = study_document(study())
    assert written == {"model": "models/a.xml", "steps": 3, "output": "study", "vary": vary, "metrics": metrics}
    assert study_text(study(), "mjrun …").startswith("# mjrun …\nmodel: models/a.xml\n")


def test_in_another_folder_its_files_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written = portable_document(study(), Path("deep/er"))
    assert written["model"] == "../../models/a.xml"
    assert written["vary"] == {
        "model": "../../models/a.xml,scene:dominos", "ctrl_from": "../../tables/a.csv", "seed": [1, 2]
    }  # fmt: skip
    assert "output" not in written
    with pytest.raises(UsageError, match="standard input is gone"):
        portable_document(study("-"), Path("deep"))


def test_writing_loads_no_models_of_documents() -> None:
    code = "import sys, mjrun.document.study_writer; sys.exit('pydantic' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
