"""The base of every object of a document."""

from __future__ import annotations

from typing import Any, Self

from pydantic import BaseModel, ConfigDict


class SpecModel(BaseModel):
    """An object of a document: immutable, no unknown keys, nothing converted silently."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    def changed(self, **fields: Any) -> Self:
        """Return a copy with other fields, which are not checked again."""
        twin = self.model_copy(update=fields)
        for name in twin.__dict__.keys() - type(self).model_fields.keys():
            del twin.__dict__[name]  # what was cached of the original
        return twin
