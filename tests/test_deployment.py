"""The files of a deployment against the published schemas, and against what the service needs."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
import yaml

from tests.test_packaging import COMPOSE, parsed
from worker.priorities import queue_of
from worker.records import Priority
from worker.settings import WorkerSettings

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "deploy" / "kubernetes"
SCHEMAS = ROOT / "tests" / "schemas"
KUBERNETES = json.loads((SCHEMAS / "kubernetes.json").read_text())
KUSTOMIZATION: dict[str, Any] = yaml.safe_load((FOLDER / "kustomization.yaml").read_text())
OBJECTS: list[dict[str, Any]] = [
    thing for name in KUSTOMIZATION["resources"] for thing in yaml.safe_load_all((FOLDER / name).read_text())
]
WORKLOADS = [thing for thing in OBJECTS if thing["kind"] in ("Deployment", "StatefulSet")]


def title(thing: dict[str, Any]) -> str:
    return f"{thing['kind']} {thing['metadata']['name']}"


def the(kind: str, name: str) -> dict[str, Any]:
    """The one object of a kind and name."""
    (found,) = [thing for thing in OBJECTS if title(thing) == f"{kind} {name}"]
    return found


def pod(workload: dict[str, Any]) -> dict[str, Any]:
    return dict(workload["spec"]["template"]["spec"])


def environment(container: dict[str, Any]) -> dict[str, str]:
    return {entry["name"]: entry.get("value", "") for entry in container["env"]}


def faults(thing: dict[str, Any]) -> list[str]:
    """What the schema of its kind says against an object."""
    reference = KUBERNETES["kinds"][f"{thing['apiVersion']}/{thing['kind']}"]
    validator = jsonschema_rs.validator_for({**reference, "$defs": KUBERNETES["$defs"]})
    return [f"{error.instance_path}: {error.message}" for error in validator.iter_errors(thing)]


def test_compose_fits_its_specification() -> None:
    specification = json.loads((SCHEMAS / "compose-spec.json").read_text())
    assert list(jsonschema_rs.validator_for(specification).iter_errors(COMPOSE)) == []


@pytest.mark.parametrize("thing", OBJECTS, ids=title)
def test_the_manifest_fits_the_schema(thing: dict[str, Any]) -> None:
    assert faults(thing) == []


def test_the_schemas_refuse_what_is_wrong() -> None:
    worker = the("Deployment", "ondelette-worker")
    assert faults({**worker, "spec": {**worker["spec"], "replica": 2}})
    scaled = the("ScaledObject", "ondelette-worker")
    assert faults({**scaled, "spec": {**scaled["spec"], "minReplicaCount": "one"}})


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="needs kubectl, to render the kustomization")
def test_kustomize_renders_what_fits_the_schemas(tmp_path: Path) -> None:
    shutil.copytree(FOLDER, tmp_path / "kubernetes", ignore=shutil.ignore_patterns("secrets"))
    for name in KUSTOMIZATION["secretGenerator"][0]["files"]:
        (tmp_path / "kubernetes" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "kubernetes" / name).write_text("0123456789abcdef" * 4)
    command = ["kubectl", "kustomize", str(tmp_path / "kubernetes")]
    rendered = list(
        yaml.safe_load_all(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    )
    assert len(rendered) == len(OBJECTS) + 1
    for thing in rendered:
        assert faults(thing) == [], title(thing)
        assert thing["kind"] == "Namespace" or thing["metadata"]["namespace"] == "ondelette"


@pytest.mark.parametrize("workload", WORKLOADS, ids=title)
def test_nobody_is_root_or_may_become_it(workload: dict[str, Any]) -> None:
    spec = pod(workload)
    assert spec["automountServiceAccountToken"] is False
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["securityContext"]["runAsUser"] > 0
    assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    for container in spec["containers"]:
        assert container["securityContext"] == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert "memory" in container["resources"]["limits"]
        assert {"cpu", "memory"} <= set(container["resources"]["requests"])


def test_the_containers_run_commands_of_ours_with_the_same_broker() -> None:
    (image,) = KUSTOMIZATION["images"]
    assert COMPOSE["services"]["api"]["image"] == f"{image['name']}:{image['newTag']}"
    broker = pod(the("StatefulSet", "ondelette-broker"))["containers"][0]
    assert broker["image"] == COMPOSE["services"]["redis"]["image"]
    for name in ("api", "worker"):
        (container,) = pod(the("Deployment", f"ondelette-{name}"))["containers"]
        command, options = parsed(container["command"])
        assert command == name
        assert options.get("insecure", False) is False
        assert container["image"] == image["name"]
        assert environment(container)["ONDELETTE_BROKER"].endswith("@ondelette-broker:6379/0")


def test_the_api_is_asked_whether_it_lives_and_is_ready() -> None:
    (api,) = pod(the("Deployment", "ondelette-api"))["containers"]
    assert api["livenessProbe"]["httpGet"]["path"] == "/livez"
    assert api["readinessProbe"]["httpGet"]["path"] == "/readyz"
    (port,) = api["ports"]
    assert port["containerPort"] == parsed(api["command"])[1]["port"]
    (mount,) = [mount for mount in api["volumeMounts"] if mount["name"] == "key"]
    assert environment(api)["ONDELETTE_BOOTSTRAP_KEY_FILE"] == f"{mount['mountPath']}/ondelette_key"


def test_a_worker_has_time_to_hand_back_and_room_for_one_job() -> None:
    spec = pod(the("Deployment", "ondelette-worker"))
    (worker,) = spec["containers"]
    variables = {
        name.lower().removeprefix("ondelette_"): value for name, value in environment(worker).items()
    }
    settings = WorkerSettings(
        shutdown_seconds=float(variables["shutdown_seconds"]), memory_mib=int(variables["memory_mib"])
    )
    assert spec["terminationGracePeriodSeconds"] >= settings.shutdown_seconds + 15
    assert worker["resources"]["limits"]["memory"] == "4Gi"
    assert settings.memory_mib <= 3 * 1024
    budget = the("PodDisruptionBudget", "ondelette-worker")
    assert budget["spec"]["selector"] == the("Deployment", "ondelette-worker")["spec"]["selector"]


def test_workers_are_scaled_by_all_jobs_that_wait_or_run() -> None:
    spec = the("ScaledObject", "ondelette-worker")["spec"]
    assert spec["scaleTargetRef"]["name"] == "ondelette-worker"
    assert spec["minReplicaCount"] >= 1
    prefix = WorkerSettings().prefix
    lists = {trigger["name"]: trigger["metadata"]["listName"] for trigger in spec["triggers"]}
    assert set(lists.values()) == {f"{prefix}{name}" for name in [*map(queue_of, Priority), "unacked"]}
    assert set(spec["advanced"]["scalingModifiers"]["formula"].split(" + ")) == set(lists)
    secret = the("TriggerAuthentication", "ondelette-broker")["spec"]["secretTargetRef"][0]
    assert f"secrets/{secret['key']}" in KUSTOMIZATION["secretGenerator"][0]["files"]
