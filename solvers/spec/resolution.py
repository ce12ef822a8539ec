"""The document with every default filled in, and its fingerprint."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from solvers.errors import pointer
from solvers.spec.base import SpecModel
from solvers.spec.faults import Path
from solvers.spec.models import LibraryReference

if TYPE_CHECKING:
    from solvers.spec.job import JobSpec

_IGNORED = frozenset({"schema_uri", "reference"})
_LARGEST_EXACT = 2**53

# What is said about a job rather than asked by it.
_LABELS = frozenset({"name", "notes", "tags", "metadata", "priority", "reuse", "deadline_seconds", "webhook"})


@dataclass(frozen=True, slots=True)
class Resolution:
    """A document with all defaults (JSON types only), what was filled in, and the SHA-256 of the whole.

    Keys that are optional and empty are left out. ``sha256`` is that of `canonical_json`.
    """

    document: dict[str, Any]
    defaults_applied: tuple[str, ...]
    sha256: str

    def to_dict(self) -> dict[str, Any]:
        """Return the resolution as it stands in a result."""
        return {
            "document": self.document,
            "sha256": self.sha256,
            "defaults_applied": list(self.defaults_applied),
        }


def resolve(spec: JobSpec) -> Resolution:
    """Return the document of ``spec`` with every default written out."""
    defaults: list[Path] = []
    document = _plain_object(spec, (), defaults, given=True)
    verification = document["options"].setdefault("verification", {})
    for name, value in spec.verification_tolerances().items():
        if name not in verification:
            verification[name] = value
            defaults.append(("options", "verification", name))
    model = spec.problem.submitted_model
    if isinstance(model, LibraryReference):
        given = document["problem"]["model"].get("parameters", {})
        document["problem"]["model"]["parameters"] = dict(spec.problem.model.parameters)
        names = spec.problem.model.parameters
        defaults += [("problem", "model", "parameters", name) for name in names if name not in given]
    digest = hashlib.sha256(canonical_json(document).encode()).hexdigest()
    return Resolution(document, tuple(pointer(path) for path in defaults), digest)


def answer_digest(resolved: dict[str, Any]) -> str:
    """Return the SHA-256 of the part of a resolved document on which its answer depends."""
    asked = {key: value for key, value in resolved.items() if key not in _LABELS}
    return hashlib.sha256(canonical_json(asked).encode()).hexdigest()


def canonical_json(document: Any, *, ordered: bool = False) -> str:
    """Return a JSON text that is the same for equal documents: keys sorted, 440.0 written as 440.

    Where keys are ``ordered``, documents with the same keys in another order are not equal.
    """
    return json.dumps(_canonical(document), sort_keys=not ordered, separators=(",", ":"), allow_nan=False)


def _canonical(value: Any) -> Any:
    if isinstance(value, str):
        return value
    if isinstance(value, dict):
        return {key: _canonical(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_canonical(item) for item in value]
    if isinstance(value, float) and value.is_integer() and abs(value) < _LARGEST_EXACT:
        return int(value)
    return value


def _plain_object(model: SpecModel, path: Path, defaults: list[Path], given: bool) -> dict[str, Any]:
    plain: dict[str, Any] = {}
    for name, key, required in _fields(type(model)):
        value = getattr(model, name)
        empty = value is None or (isinstance(value, str | list | tuple | dict) and len(value) == 0)
        if empty and not required:
            continue
        here = given and name in model.model_fields_set
        if not here and not isinstance(value, SpecModel):
            defaults.append((*path, key))
        written = _plain(value, (*path, key), defaults, here)
        if written != {} or required:
            plain[key] = written
    return plain


@cache
def _fields(kind: type[SpecModel]) -> tuple[tuple[str, str, bool], ...]:
    """Each field of a part of the document: its name, its key, and whether it is required."""
    return tuple(
        (name, info.alias or name, info.is_required())
        for name, info in kind.model_fields.items()
        if name not in _IGNORED
    )


def _plain(value: Any, path: Path, defaults: list[Path], given: bool) -> Any:
    if isinstance(value, str | float | int | None):
        return value
    if isinstance(value, SpecModel):
        return _plain_object(value, path, defaults, given)
    if isinstance(value, dict):
        return {key: _plain(item, (*path, key), defaults, given) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, (*path, index), defaults, given) for index, item in enumerate(value)]
    return value
