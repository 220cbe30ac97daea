"""A study in a real object store: a local server of S3, some of whose answers are 503."""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import fsspec
import pytest

from mjrun.document.study import portable_document, read_folder
from mjrun.simulation.simulation import Simulation
from mjrun.study.status import remove_unused, study_status
from mjrun.study.study import Study, StudyResult

SLOW_DOWN = b"<Error><Code>SlowDown</Code><Message>Please reduce your request rate</Message></Error>"
SWEEP = "import sys; from mjrun.study import executors; executors.INTERVAL = 0; from mjrun.cli.main import run; "
SWEEP += "run(sys.argv[1:])"


@pytest.fixture
def victims() -> list[subprocess.Popen[bytes]]:
    """Processes, the last of which is killed when it uploads its third part."""
    return []


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch, victims: list[subprocess.Popen[bytes]]) -> Iterator[str]:
    """The URL of an empty bucket, whose server refuses every seventh request."""
    import s3fs
    from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    store, numbers, parts = DomainDispatcherApplication(create_backend_app), count(1), count(1)

    def serve(environment: dict[str, Any], start: Callable[..., Any]) -> Any:
        is_part = environment["REQUEST_METHOD"] == "PUT" and environment["PATH_INFO"].endswith(".parquet")
        if is_part and victims and next(parts) == 3:
            victims.pop().kill()
        if next(numbers) % 7:
            return store(environment, start)
        start("503 Slow Down", [("Content-Type", "application/xml")])
        return [SLOW_DOWN]

    server = make_server("127.0.0.1", 0, serve, threaded=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{server.server_port}")
    for name, value in (("ACCESS_KEY_ID", "any"), ("SECRET_ACCESS_KEY", "any"), ("DEFAULT_REGION", "us-east-1")):
        monkeypatch.setenv(f"AWS_{name}", value)
    s3fs.S3FileSystem.clear_instance_cache()
    fsspec.filesystem("s3").mkdir("bucket")
    yield "s3://bucket"
    s3fs.S3FileSystem.clear_instance_cache()
    server.shutdown()
    thread.join()
    assert next(numbers) > 7  # some were refused


@pytest.mark.slow
def test_a_study_that_is_killed_in_a_store_is_continued_to_the_table_of_a_local_folder(
    ball: Simulation, bucket: str, victims: list[subprocess.Popen[bytes]], tmp_path: Path
) -> None:
    simulation, url = replace(ball, steps=100), f"{bucket}/a study"
    metric, vary = {"low": "min(qpos/ball/z)"}, {"qpos/ball/z": "0.2..1:9"}

    def study(folder: str, **options: Any) -> Study:
        return Study(simulation, folder, metric=metric, vary=vary, jobs=1, **options)

    def stored(result: StudyResult) -> bytes:
        return b"".join(map(store.cat_file, result.files[:2]))

    local = study(f"{tmp_path}/study").run()
    expected = b"".join(Path(name).read_bytes() for name in local.files[:2])
    store = fsspec.filesystem("s3")
    command = [sys.executable, "-c", SWEEP, "sweep", str(simulation.model), "--steps", "100", "--jobs", "1"]
    command += ["--vary", "qpos/ball/z=0.2..1:9", "--metric", "low=min(qpos/ball/z)", "--chunk", "1", "-o", url]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        victims.append(process)
    assert 0 < (made := study(url).run()).simulated < 9  # the others are known
    assert made.files == [f"{url}/{name}" for name in ("results.parquet", "results.csv", "study.json")]
    assert stored(made) == expected

    repeated = study(url, repeats=2)
    more = replace(repeated, document=portable_document(repeated, url)).run()
    assert (more.points, more.simulated) == (18, 9)
    assert (read_folder(url).run().simulated, study_status(url).is_finished) == (0, True)
    fewer = study(url).run()  # without the means of repeats
    assert (fewer.simulated, store.exists(f"{url}/repeats.csv")) == (0, False)
    assert remove_unused(url).missing == 0
    assert stored(fewer) == expected
