"""What is installed and deployed: the compose file, the image, the pins, the make targets."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from app.cli import main
from worker.settings import WorkerSettings

ROOT = Path(__file__).parents[1]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
SERVICES: dict[str, Any] = COMPOSE["services"]
IMAGE = re.compile(r"[a-z0-9./_-]+:(\d+\.\d+\.\d+)[a-z0-9.-]*")


def seconds(duration: str) -> float:
    """A duration of the compose format, as far as we use it."""
    match = re.fullmatch(r"(\d+)s", duration)
    assert match is not None, duration
    return float(match.group(1))


def parsed(command: list[str]) -> tuple[str, dict[str, Any]]:
    """Let the real command line parse a command; returns its name and the values of its options."""
    program, name, *arguments = command
    assert program == "ondelette"
    subcommand = main.get_command(click.Context(main), name)
    assert subcommand is not None, f"there is no command {name}"
    return name, subcommand.make_context(name, list(arguments)).params


def test_there_are_an_api_workers_and_a_broker() -> None:
    assert set(SERVICES) == {"api", "worker", "redis"}
    known = {
        "build",
        "image",
        "command",
        "environment",
        "ports",
        "depends_on",
        "deploy",
        "healthcheck",
        "volumes",
    }
    known |= {
        "init",
        "restart",
        "read_only",
        "tmpfs",
        "cap_drop",
        "security_opt",
        "stop_grace_period",
        "secrets",
        "user",
        "networks",
    }
    for name, service in SERVICES.items():
        assert set(service) <= known, name
        assert IMAGE.fullmatch(service["image"]), f"{name}: a pinned image"
        assert service["restart"] == "unless-stopped"
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert not service["user"].startswith("0")
        assert {"cpus", "memory", "pids"} <= set(service["deploy"]["resources"]["limits"])
        assert "inside" in service["networks"]


def test_the_commands_of_the_containers_are_commands_of_ours() -> None:
    name, options = parsed(SERVICES["api"]["command"])
    assert name == "api"
    assert (options["host"], options["insecure"]) == ("0.0.0.0", False)
    file = SERVICES["api"]["environment"]["ONDELETTE_BOOTSTRAP_KEY_FILE"]
    assert [f"/run/secrets/{name}" for name in SERVICES["api"]["secrets"]] == [file]
    assert COMPOSE["secrets"]["ondelette_key"]["file"].startswith("./secrets/")
    assert SERVICES["api"]["ports"] == [f"127.0.0.1:8000:{options['port']}"]
    assert f"127.0.0.1:{options['port']}/livez" in " ".join(SERVICES["api"]["healthcheck"]["test"])
    name, options = parsed(SERVICES["worker"]["command"])
    assert (name, options["concurrency"]) == ("worker", 1)


def test_workers_can_be_many_and_have_time_to_hand_back() -> None:
    worker = SERVICES["worker"]
    assert not {"container_name", "ports", "hostname"} & set(worker)
    assert worker["deploy"]["replicas"] >= 2
    assert seconds(worker["stop_grace_period"]) >= WorkerSettings().shutdown_seconds + 5


def test_the_broker_keeps_and_protects_what_it_holds() -> None:
    broker = SERVICES["redis"]
    program, *words = broker["command"]
    assert program == "valkey-server"
    options = dict(zip(words[::2], words[1::2], strict=True))
    assert options["--appendonly"] == "yes"
    assert options["--appendfsync"] == "${ONDELETTE_FSYNC:-everysec}"
    assert options["--maxmemory-policy"] == "noeviction"
    assert options["--requirepass"].startswith("${ONDELETTE_REDIS_PASSWORD:?"), "no default password"
    assert "ports" not in broker, "reached by the services only"
    volume = broker["volumes"][0].partition(":")[0]
    assert volume in COMPOSE["volumes"]
    assert "ping" in broker["healthcheck"]["test"][1]


def test_the_services_know_the_broker_and_wait_for_it() -> None:
    for name in ("api", "worker"):
        service = SERVICES[name]
        assert service["environment"]["ONDELETTE_BROKER"].endswith("@redis:6379/0")
        assert service["depends_on"] == {"redis": {"condition": "service_healthy"}}
        assert service["cap_drop"] == ["ALL"]


def test_the_image_is_pinned_built_in_stages_and_not_run_by_root() -> None:
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    bases = [line.split()[1] for line in lines if line.startswith("FROM ")]
    assert len(bases) == 2
    assert all(IMAGE.fullmatch(base) for base in bases)
    assert any(line.startswith("USER ") and line != "USER root" for line in lines)
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    for line in lines:
        if line.startswith("COPY ") and "--from" not in line:
            for source in line.split()[1:-1]:
                assert (ROOT / source).exists(), f"{source} is there to be copied"
                assert f"!{source}" in ignored, f"{source} is not ignored"


def test_every_dependency_is_pinned_and_nothing_else_stands_among_the_pins() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", pin) for pin in pins), (
        "no option, host or path"
    )
    pinned = {pin.partition("==")[0].lower().replace("_", "-") for pin in pins}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    names = {re.split(r"[\[<>=]", requirement)[0].lower().replace("_", "-") for requirement in needed}
    assert names <= pinned, names - pinned


@pytest.mark.parametrize("target", ["setup", "demo", "test", "check", "serve", "bench"])
def test_the_make_targets_exist(target: str) -> None:
    command = ["make", "--dry-run", "--directory", str(ROOT), target]
    subprocess.run(command, check=True, capture_output=True)


def test_an_old_python_is_refused_in_plain_words(tmp_path: Path) -> None:
    old = tmp_path / "python3"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    command = ["make", "--directory", str(tmp_path), "demo", f"PYTHON={old}"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    answer = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert answer.returncode != 0
    assert "ondelette needs Python 3.11 or newer" in answer.stderr
    assert not (tmp_path / ".venv").exists()


def test_ci_runs_what_make_test_runs() -> None:
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    assert script.read_text().splitlines()[-1] == "exec make test"
