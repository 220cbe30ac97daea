"""What a study would do: counts against the study that is run, costs against nothing but their order."""

from dataclasses import replace
from pathlib import Path

import pytest

from mjrun.errors import UsageError
from mjrun.simulation.simulation import Simulation
from mjrun.study.study import Study
from tests.study.models import BALL, DEADLY


@pytest.fixture
def study(tmp_path: Path) -> Study:
    (tmp_path / "ball.xml").write_text(BALL)
    (tmp_path / "deadly.xml").write_text(DEADLY)
    simulation = Simulation(str(tmp_path / "ball.xml"), duration=0.1)
    vary = {"opt.timestep": "0.001,0.002,0.01", "seed": "1..4:4"}
    return Study(simulation, str(tmp_path / "study"), vary=vary, metric={"low": "min(qpos/ball/z)"}, jobs=2)


def test_it_counts_what_a_run_does_and_writes_nothing(study: Study) -> None:
    preview = study.preview()
    assert (preview.points, preview.known, preview.missing, preview.processes) == (12, 0, 12, 2)
    assert preview.steps == 4 * (100 + 50 + 10)
    assert [each.point for each in preview.sample] == [0, 1, 2, 9, 10, 11]
    assert preview.sample[-1].values == {"opt.timestep": "0.01", "seed": "4"}
    assert preview.wall is not None
    assert preview.wall > (preview.point_wall or 0) > 0
    assert not Path(study.output).exists()

    study.run()
    files = sum(path.stat().st_size for path in Path(study.output).rglob("*") if path.is_file())
    assert 0.3 * files < preview.disk < 3 * files
    again = study.preview()
    assert (again.known, again.missing, again.chunks, again.steps, again.wall) == (12, 0, 0, 0, 0)


def test_a_point_that_fails_has_no_time_and_says_why(study: Study) -> None:
    folder = Path(study.output).parent
    failing = replace(study, vary={"model": f"{folder}/deadly.xml,{folder}/ball.xml"})
    preview = failing.preview()
    assert (preview.point_wall, preview.wall) == (None, None)
    assert "SIGSEGV" in preview.message


def test_an_engine_of_its_own_has_no_known_number_of_processes(study: Study) -> None:
    preview = replace(study, engine="tests.study.factories:threads").preview()
    assert (preview.processes, preview.wall) == (None, None)
    assert preview.point_wall is not None
    with pytest.raises(UsageError, match="engines: local"):
        replace(study, engine="ray").preview()
