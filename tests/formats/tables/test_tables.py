"""Which table formats there are, and which of them an output means."""

import importlib.util
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

from mjrun.errors import MissingExtraError, UnknownNameError, UsageError
from mjrun.formats import tables
from mjrun.formats.tables import FORMATS, input_format, output_format, suffixes
from tests.cases import cases


def test_every_module_is_a_format_of_its_own_name_and_suffixes() -> None:
    assert list(FORMATS) == [module.name for module in pkgutil.iter_modules(tables.__path__)]
    assert len(set(suffixes())) == len(suffixes())
    assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in suffixes())


def test_listing_suffixes_loads_no_library() -> None:
    code = "import sys; from mjrun.formats import tables; tables.suffixes(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"numpy", "pyarrow", "scipy", "h5py", "mujoco"}.isdisjoint(done.stdout.split())


def test_a_suffix_of_no_format_is_reported_with_those_that_can_be_read() -> None:
    with pytest.raises(UnknownNameError, match=r"no table format '.xlsx' in t.xlsx\ntable formats: .csv, .feather"):
        input_format(Path("t.xlsx"))


@cases("output, asked, meant")
def test_the_suffix_means_the_format(output: str | None, asked: str | None, meant: str) -> None:
    assert output_format(output, asked).name == meant


@pytest.mark.parametrize(
    ("output", "asked", "kind", "message"),
    [
        (
            "t.parqet",
            None,
            UnknownNameError,
            r"'.parqet' in t.parqet \(did you mean '.parquet'\?\)\ntable formats: .csv",
        ),
        (
            "table",
            None,
            UnknownNameError,
            r"no table format '' in table\ntable formats: .csv, .feather, .arrow, .h5",
        ),
        ("t.csv", "xls", UnknownNameError, r"no format 'xls'.*\nformats: csv, feather, hdf5, jsonl, mat, npz"),
        ("t.csv", "npz", UsageError, "format npz and the suffix of t.csv disagree"),
        (None, "parquet", UsageError, "cannot be written to standard output\ncsv and jsonl can"),
    ],
)
def test_a_format_that_cannot_be_meant_is_refused(
    output: str | None, asked: str | None, kind: type[UsageError], message: str
) -> None:
    with pytest.raises(kind, match=message):
        output_format(output, asked)


@cases("suffix, library, extra")
def test_a_library_that_is_not_installed_is_named_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, suffix: str, library: str, extra: str
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == library else name)
    with pytest.raises(MissingExtraError) as error:
        output_format(f"t{suffix}")
    assert str(error.value) == (
        f"writing {suffix} needs {library}, which is not installed\npip install 'mjrun[{extra}]'"
    )
    assert error.value.exit_code == 2
    assert output_format("t.csv").name == "csv"
