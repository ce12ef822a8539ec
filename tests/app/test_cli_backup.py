"""``ondelette backup`` and ``restore`` as an operator calls them."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from app.cli import main
from worker.records import JobStatus
from worker.settings import QueueSettings
from worker.store import JobStore

Make = Callable[..., str]


def test_a_job_that_was_erased_comes_back(
    store: JobStore,
    job: Make,
    solved: bytes,
    queue_settings: QueueSettings,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ONDELETTE_PREFIX", queue_settings.prefix)
    job_id = job(JobStatus.SUCCEEDED, solved)
    before = store.get(job_id)
    file, runner = tmp_path / "backup.gz", CliRunner()
    done = runner.invoke(main, ["backup", str(file), "--broker", queue_settings.broker])
    assert (done.exit_code, done.output.startswith("1 jobs, ")) == (0, True), done.output
    assert [path.name for path in tmp_path.iterdir()] == ["backup.gz"]
    store.erase(job_id)
    done = runner.invoke(main, ["restore", str(file), "--broker", queue_settings.broker])
    assert (done.exit_code, done.output) == (0, "1 jobs put back, 0 were there\n")
    assert store.get(job_id) == before


def test_what_is_no_backup_is_bad_input(queue_settings: QueueSettings, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing of the kind")
    words = ["restore", str(tmp_path / "notes.txt"), "--broker", queue_settings.broker]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2
    assert "cannot be read as a backup" in done.output
