"""JSON Schema as Markdown: a heading and a table of its keys for each object."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

Schema = Mapping[str, Any]
Link = Callable[[str], str]
"""Makes of the name of a schema a link to where it is described."""

_LIMITS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
    "minLength": "characters: at least",
    "maxLength": "characters: at most",
    "minItems": "entries: at least",
    "maxItems": "entries: at most",
    "format": "format",
}


def cell(text: object) -> str:
    """Return a text that may stand in a cell of a table."""
    return " ".join(str(text).replace("``", "`").split()).replace("|", r"\|")


def code(value: object) -> str:
    """Return a JSON value as code."""
    return f"`{json.dumps(value)}`"


def limits(schema: Schema) -> str:
    """Return what a schema says of sizes, in words."""
    return ", ".join(f"{words} {schema[key]}" for key, words in _LIMITS.items() if key in schema)


def kind(schema: Schema, link: Link) -> str:
    """Return in words what a schema allows."""
    if "$ref" in schema:
        return link(schema["$ref"].rpartition("/")[2])
    if "const" in schema:
        return code(schema["const"])
    if "enum" in schema:
        return ", ".join(map(code, schema["enum"]))
    for choice in ("oneOf", "anyOf", "allOf"):
        if choice in schema:
            return _either([kind(option, link) for option in schema[choice]])
    words = schema.get("type", "anything")
    if isinstance(words, list):
        words = " or ".join(words)
    if words == "array" and "prefixItems" in schema:
        words = "[" + ", ".join(kind(item, link) for item in schema["prefixItems"]) + "]"
    elif words == "array":
        words = f"list of ({kind(schema['items'], link)})" if schema.get("items") else "list"
    elif words == "object" and "properties" in schema:
        words = (
            "{"
            + ", ".join(f"`{name}`: {kind(part, link)}" for name, part in schema["properties"].items())
            + "}"
        )
    elif words == "object" and isinstance(schema.get("additionalProperties"), Mapping):
        words = f"object of ({kind(schema['additionalProperties'], link)})"
    sizes = limits(schema)
    return f"{words} ({sizes})" if sizes else words


def _either(words: list[str]) -> str:
    # A value of the document: 4,096 characters are the limit of an expression.
    if "number" in words and "string (characters: at most 4096)" in words:
        words = [
            "value",
            *(word for word in words if word not in ("number", "string (characters: at most 4096)")),
        ]
    return " or ".join(dict.fromkeys(words))


def _default(part: Schema) -> str:
    # Those of an object are told where it is described.
    return code(part["default"]) if not isinstance(part.get("default", {}), dict) else ""


def table(schema: Schema, link: Link) -> str:
    """Return the keys of an object as a table."""
    required = schema.get("required", ())
    rows = ["| key | what it holds | default | what for |", "|---|---|---|---|"]
    for name, part in schema.get("properties", {}).items():
        default = "**required**" if name in required else _default(part)
        rows.append(
            f"| `{name}` | {cell(kind(part, link))} | {cell(default)} | {cell(part.get('description', ''))} |"
        )
    return "\n".join(rows)


def section(name: str, schema: Schema, link: Link, level: int = 3) -> str:
    """Return the description of an object or of a set of words under a heading of its name."""
    body = table(schema, link) if "properties" in schema else kind(schema, link)
    return "\n\n".join(
        filter(None, ["#" * level + f" {name}", schema.get("description", "").replace("``", "`"), body])
    )
