"""The reference of the HTTP interface: the service's own OpenAPI document."""

from __future__ import annotations

from functools import cache
from http import HTTPStatus
from itertools import groupby
from typing import Any

from app.main import create_app
from ondelette_docs.schemas import cell, code, kind, section
from solvers.spec import job_schema


@cache
def _parts_of_documents() -> set[str]:
    return {"JobDocument", *job_schema()["$defs"]}


def link(name: str) -> str:
    """Return a link to a schema, on this page or on that of the job document."""
    if name == "JobDocument":
        return "[job document](document.md)"
    return f"[{name}]({'document.md' if name in _parts_of_documents() else ''}#{name.lower()})"


def _parameters(operation: dict[str, Any]) -> str:
    rows = ["| parameter | where | what it holds | default | what for |", "|---|---|---|---|---|"]
    for parameter in operation.get("parameters", []):
        schema = parameter["schema"]
        default = (
            "**required**"
            if parameter["required"]
            else code(schema["default"])
            if "default" in schema
            else ""
        )
        holds = kind(schema, link).removesuffix(" or null")
        what = parameter.get("description", "")
        rows.append(
            f"| `{parameter['name']}` | {parameter['in']} | {cell(holds)} | {cell(default)} | {cell(what)} |"
        )
    return "\n".join(rows) if len(rows) > 2 else ""


def _content(content: dict[str, Any]) -> str:
    return " or ".join(
        f"`{media}`" + (f": {kind(body['schema'], link)}" if body.get("schema") else "")
        for media, body in content.items()
    )


def _answers(operation: dict[str, Any]) -> str:
    rows = ["| status | what comes back |", "|---|---|"]
    for status, answer in sorted(operation["responses"].items()):
        words = answer["description"]
        if words == "Successful Response":
            words = HTTPStatus(int(status)).phrase
        content = answer.get("content", {})
        if "application/problem+json" not in content and content:
            words = f"{words}. {_content(content)}"
        rows.append(f"| {status} | {cell(words)} |")
    return "\n".join(rows)


def _operation(method: str, path: str, operation: dict[str, Any]) -> str:
    parts = [f"### `{method.upper()} {path}`", operation.get("description", ""), _parameters(operation)]
    if "requestBody" in operation:
        parts.append(f"Body: {_content(operation['requestBody']['content'])}")
    parts.append(_answers(operation))
    return "\n\n".join(filter(None, parts)).replace("``", "`")


def render() -> str:
    """Return the whole reference as Markdown."""
    described = create_app().openapi()
    operations = [
        (operation["tags"][0], method, path, operation)
        for path, methods in described["paths"].items()
        for method, operation in methods.items()
    ]
    parts = []
    for tag, group in groupby(operations, key=lambda entry: entry[0]):
        parts.append(f"## {tag.capitalize()}")
        parts += [_operation(method, path, operation) for _, method, path, operation in group]
    parts.append("## Shapes")
    elsewhere = _parts_of_documents()
    schemas = described["components"]["schemas"]
    parts += [section(name, schema, link) for name, schema in schemas.items() if name not in elsewhere]
    return "\n\n".join(parts)
