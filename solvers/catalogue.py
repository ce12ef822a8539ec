"""What is on board: ready cases, library models, methods."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from pydantic import BaseModel

from solvers.models import LIBRARY, LibraryModel, Quantity
from solvers.spec import METHODS

_CASES = files("solvers") / "cases"


def case_names() -> list[str]:
    """Return the names of the cases, in alphabetical order."""
    return sorted(file.name.removesuffix(".json") for file in _CASES.iterdir())


def load_case(name: str) -> dict[str, Any]:
    """Return a case: a complete job document with its ``reference`` answer.

    Raises KeyError if there is no case of that name.
    """
    if name not in case_names():
        raise KeyError(name)
    case: dict[str, Any] = json.loads((_CASES / f"{name}.json").read_text(encoding="utf-8"))
    return case


def models() -> list[dict[str, Any]]:
    """Return the library models: names, units and meaning of states, controls and parameters, equations."""
    return [_model(entry) for entry in LIBRARY.values()]


def methods() -> list[dict[str, Any]]:
    """Return the methods: name, title, defaults and the JSON Schema of the ``method`` object."""
    return [
        {
            "name": name,
            "title": method.title,
            "defaults": _defaults(method),
            "schema": method.model_json_schema(),
        }
        for name, method in METHODS.items()
    ]


def _defaults(method: type[BaseModel]) -> dict[str, Any]:
    """Every default that is something."""
    found = {
        key: field.get_default(call_default_factory=True)
        for key, field in method.model_fields.items()
        if not field.is_required()
    }
    plain = {key: item.model_dump() if isinstance(item, BaseModel) else item for key, item in found.items()}
    return {key: item for key, item in plain.items() if item not in (None, {})}


def _model(entry: LibraryModel) -> dict[str, Any]:
    def described(quantities: Mapping[str, Quantity]) -> dict[str, dict[str, str]]:
        return {name: {"unit": q.unit, "description": q.description} for name, q in quantities.items()}

    return {
        "name": entry.name,
        "title": entry.title,
        "source": entry.source,
        "states": described(entry.states),
        "controls": described(entry.controls),
        "computed": described(entry.computed),
        "parameters": {
            name: {
                "value": p.value,
                "unit": p.unit,
                "description": p.description,
                "interval": None if p.interval is None else list(p.interval),
            }
            for name, p in entry.parameters.items()
        },
        "options": {
            name: {"value": o.value, "choices": list(o.choices), "description": o.description}
            for name, o in entry.options.items()
        },
        "model": entry.document({}),
        "plant_only": entry.plant_only,
    }
