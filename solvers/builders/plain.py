"""From what people hold in Python to the JSON types of a document."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from solvers.builders.sympy_text import is_sympy, sympy_text
from solvers.errors import DocumentError, Fault
from solvers.errors import pointer as pointer_of


def plain(value: Any, pointer: str = "") -> Any:
    """``value`` in JSON types.

    NumPy arrays and numbers become lists and numbers, tuples lists, sparse matrices ``entries``, infinities
    ``None`` (a bound on that side there is not), SymPy expressions their text, also as keys.
    Raises DocumentError, with the pointer, for NaN and for what has no place in a document.
    """
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        if math.isnan(value):
            raise DocumentError([Fault(pointer, "a number must be finite, and this is NaN")])
        return None if math.isinf(value) else float(value)
    if is_sympy(value):
        return plain(value.tolist(), pointer) if hasattr(value, "tolist") else sympy_text(value)
    if isinstance(value, Mapping):
        return {_key(key): plain(item, pointer + pointer_of([_key(key)])) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, f"{pointer}/{index}") for index, item in enumerate(value)]
    if hasattr(value, "tocoo"):  # a sparse matrix of SciPy
        sparse = value.tocoo()
        places = zip(sparse.row.tolist(), sparse.col.tolist(), sparse.data.tolist(), strict=True)
        return {"entries": plain([list(place) for place in places], f"{pointer}/entries")}
    if hasattr(value, "tolist"):  # arrays and numbers of NumPy and whatever is like them
        return plain(value.tolist(), pointer)
    raise DocumentError([Fault(pointer, f"a {type(value).__name__} has no place in a job document")])


def _key(key: Any) -> str:
    return sympy_text(key) if is_sympy(key) else str(key)
