"""The reference of the job document: its JSON Schema, which is made of the classes that read it."""

from __future__ import annotations

from ondelette_docs.schemas import section, table
from solvers.spec import job_schema


def link(name: str) -> str:
    """Return a link to a part of the document, from the same page."""
    return f"[{name}](#{name.lower()})"


def render() -> str:
    """Return the whole reference as Markdown."""
    schema = job_schema()
    parts = [table(schema, link), "## The parts"]
    parts += [section(name, part, link) for name, part in schema["$defs"].items()]
    return "\n\n".join(parts)
