"""The OpenAPI document: the framework's, with the schema of job documents and of refusals added."""

from __future__ import annotations

from typing import Any, cast

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from app.auth import needed_scope
from app.errors import PROBLEM_JSON
from app.problems import PROBLEMS
from solvers.catalogue import load_case
from solvers.spec import job_schema
from solvers.spec.flights import flights_schema
from solvers.spec.sweep import MAX_POINTS

_DEFINITIONS = "#/$defs/"
_SCHEMAS = "#/components/schemas/"

DOCUMENT_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {
                "schema": {"$ref": f"{_SCHEMAS}JobDocument"},
                "examples": {name: {"value": load_case(name)} for name in ("rigid_body", "brachistochrone")},
            }
        },
    }
}
"""What a route that reads a job document adds to its description."""

SWEEP_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {
                "schema": {
                    "type": "object",
                    "required": ["document", "grid"],
                    "additionalProperties": False,
                    "properties": {
                        "document": {"$ref": f"{_SCHEMAS}JobDocument"},
                        "grid": {
                            "type": "object",
                            "description": "JSON pointers into the document, with the values there.",
                            "minProperties": 1,
                            "additionalProperties": {
                                "anyOf": [
                                    {"type": "array", "minItems": 1, "maxItems": MAX_POINTS},
                                    {"$ref": f"{_SCHEMAS}SweepRange"},
                                ]
                            },
                        },
                        "zip": {"type": "boolean", "default": False},
                    },
                }
            }
        },
    }
}
"""What the route that reads a sweep adds to its description."""

FLIGHTS_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {
                "schema": {"$ref": f"{_SCHEMAS}FlightsDocument"},
                "examples": {
                    "soft_springs": {
                        "value": {
                            "runs": 1000,
                            "seed": 1,
                            "parameters": {"k": {"uniform": [90, 110]}},
                            "initial_state": {"theta_dot": {"normal": [0, 1e-5]}},
                            "actuator": {"T": {"lag": 0.1, "delay": 0.02}},
                            "coast": 60,
                        }
                    }
                },
            }
        },
    }
}
"""What the route that reads a request for flights adds to its description."""

_NUMBER = {"anyOf": [{"type": "number"}, {"type": "string"}]}
_RANGE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "title": "Range",
    "description": "Values from an end to the other, equally spaced on a linear or logarithmic scale.",
    "required": ["from", "to", "count"],
    "additionalProperties": False,
    "properties": {
        "from": _NUMBER,
        "to": _NUMBER,
        "count": {"type": "integer", "minimum": 1, "maximum": MAX_POINTS},
        "scale": {"enum": ["linear", "log"], "default": "linear"},
    },
}

_PROBLEM_SCHEMA: dict[str, Any] = {
    "type": "object",
    "title": "Problem",
    "description": "A refusal (RFC 9457).",
    "required": ["type", "title", "status", "detail", "request_id"],
    "properties": {
        "type": {"type": "string", "format": "uri-reference"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "request_id": {"type": "string"},
        "errors": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["detail"],
                "properties": {
                    "pointer": {"type": "string", "description": "JSON pointer into the document."},
                    "parameter": {"type": "string", "description": "Parameter or header of the request."},
                    "detail": {"type": "string"},
                    "type": {"enum": ["invalid", "unsupported", "limit"]},
                },
            },
        },
    },
}


def refusals(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the description of refusals by status, for a route's ``responses``."""
    return {
        status: {
            "description": ", ".join(name for name, problem in PROBLEMS.items() if problem.status == status),
            "content": {PROBLEM_JSON: {"schema": {"$ref": f"{_SCHEMAS}Problem"}}},
        }
        for status in statuses
    }


def install(app: FastAPI) -> None:
    """Make ``/openapi.json`` the extended document, built once."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title=app.title, version=app.version, description=app.description, routes=app.routes
    )
    job = cast(dict[str, Any], _relocated(job_schema()))
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    schemas.update(job.pop("$defs", {}))
    schemas["JobDocument"] = job
    flights = cast(dict[str, Any], _relocated(flights_schema()))
    schemas.update(flights.pop("$defs", {}))
    schemas["FlightsDocument"] = flights
    document["components"]["securitySchemes"] = {
        "key": {
            "type": "http",
            "scheme": "bearer",
            "description": "An API key; asked for only where the operator has made keys.",
        }
    }
    schemas["SweepRange"] = _RANGE_SCHEMA
    schemas["Problem"] = _PROBLEM_SCHEMA
    # The framework's own shape of a 422 is never sent.
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            if needed_scope(method.upper(), path) is not None:
                operation["security"] = [{}, {"key": []}]
                operation["responses"] |= {
                    str(status): description for status, description in refusals(401, 403, 429, 503).items()
                }
            if "application/json" in operation["responses"].get("422", {}).get("content", {}):
                operation["responses"]["422"] = refusals(422)[422]
    for maker, parameter in (("/v1/jobs", "job_id"), ("/v1/sweeps", "sweep_id")):
        document["paths"][maker]["post"]["responses"]["202"]["links"] = _links(document, parameter)
    return document


def _links(document: dict[str, Any], parameter: str) -> dict[str, Any]:
    """Return what can be asked of something that was made, for whoever follows descriptions by himself."""
    return {
        operation["operationId"]: {
            "operationId": operation["operationId"],
            "parameters": {parameter: "$response.body#/id"},
        }
        for path, operations in document["paths"].items()
        for operation in operations.values()
        if f"{{{parameter}}}" in path
    }


def _relocated(schema: object) -> object:
    """Return a JSON Schema whose local definitions are looked for where OpenAPI keeps schemas."""
    if isinstance(schema, dict):
        return {key: _relocated(value) for key, value in schema.items()}
    if isinstance(schema, list):
        return [_relocated(item) for item in schema]
    if isinstance(schema, str) and schema.startswith(_DEFINITIONS):
        return _SCHEMAS + schema.removeprefix(_DEFINITIONS)
    return schema
