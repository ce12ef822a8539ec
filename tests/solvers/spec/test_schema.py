"""The JSON Schema of a document: complete, described, and of one mind with the checks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from solvers.spec import JobSpec, job_schema
from solvers.spec.base import SpecModel
from tests.solvers.spec.editing import FLEXIBLE_SPACECRAFT


def all_models(model: type[SpecModel] = SpecModel) -> Iterator[type[SpecModel]]:
    for child in model.__subclasses__():
        yield child
        yield from all_models(child)


def test_every_field_is_described() -> None:
    models = list(all_models())
    assert JobSpec in models
    for model in models:
        assert model.__doc__
        for name, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{name}"


def test_schema_is_json_and_lists_the_keys() -> None:
    schema = job_schema()
    assert json.loads(json.dumps(schema)) == schema
    keys = schema["properties"].keys()
    assert {
        "schema",
        "$schema",
        "name",
        "tags",
        "problem",
        "method",
        "options",
        "output",
        "reference",
    } <= keys
    assert schema["required"] == ["problem"]
    assert schema["additionalProperties"] is False
    problem = schema["$defs"]["ProblemSpec"]
    assert set(problem["required"]) == {"model", "final_time", "initial_state", "objective"}
    assert set(problem["properties"]["model"]["discriminator"]["mapping"]) == {
        "mechanical",
        "modal",
        "first_order",
        "library",
    }


def test_defaults_of_one_field_do_not_leak_into_another() -> None:
    problem = job_schema()["$defs"]["ProblemSpec"]["properties"]
    assert problem["initial_time"]["default"] == 0
    assert "default" not in problem["final_time"]


def test_schema_accepts_the_example() -> None:
    schema = job_schema()
    assert list(mismatches(FLEXIBLE_SPACECRAFT, schema, schema)) == []


def test_schema_sees_mistakes() -> None:
    schema = job_schema()
    for key, value in (("name", 3), ("problem", []), ("metod", {}), ("method", {"name": "swcm", "J": []})):
        assert list(mismatches(FLEXIBLE_SPACECRAFT | {key: value}, schema, schema)), key


def mismatches(value: Any, schema: dict[str, Any], root: dict[str, Any], path: str = "") -> Iterator[str]:
    """Yield where ``value`` contradicts a schema of the few words that ours uses."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].removeprefix("#/$defs/")]
    for word in ("anyOf", "oneOf"):
        if word in schema and all(list(mismatches(value, one, root, path)) for one in schema[word]):
            yield f"{path}: none of {word}"
    if "const" in schema and value != schema["const"]:
        yield f"{path}: const"
    types: dict[str, Any] = {"object": dict, "array": list, "string": str, "null": type(None)}
    types |= {"integer": int, "number": (int, float)}
    kind = schema.get("type")
    if kind is not None and not isinstance(value, types[kind]):
        yield f"{path}: not {kind}"
        return
    if isinstance(value, dict):
        known, others = schema.get("properties", {}), schema.get("additionalProperties", True)
        for key in schema.get("required", ()):
            if key not in value:
                yield f"{path}/{key}: missing"
        for key, child in value.items():
            if key in known:
                yield from mismatches(child, known[key], root, f"{path}/{key}")
            elif others is False:
                yield f"{path}/{key}: unknown"
            elif isinstance(others, dict):
                yield from mismatches(child, others, root, f"{path}/{key}")
    if isinstance(value, list) and "items" in schema:
        for index, child in enumerate(value):
            yield from mismatches(child, schema["items"], root, f"{path}/{index}")
