"""The ``model`` of a document from arrays and names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from solvers.builders.plain import plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Model = dict[str, Any]
Names = Sequence[str]
Table = Mapping[Any, Any] | None


def library(name: str, **parameters: Any) -> Model:
    """A model that comes with the product, with parameters that shall differ from its own."""
    return _model("library", name=name, parameters=parameters)


def first_order(
    dynamics: Mapping[Any, Any], *, controls: Names, parameters: Table = None, definitions: Table = None
) -> Model:
    """x' = f(x, u, t): state -> expression (text, number or SymPy) of its rate of change."""
    written = plain(dynamics, "/problem/model/dynamics")
    return _model(
        "first_order",
        states=list(written),
        controls=controls,
        parameters=parameters,
        definitions=definitions,
        dynamics=written,
    )


def mechanical(
    mass: Any,
    input: Any,
    *,
    coordinates: Names,
    controls: Names,
    damping: Any = None,
    stiffness: Any = None,
    force: Any = None,
    parameters: Table = None,
    definitions: Table = None,
    flexible: Names = (),
) -> Model:
    """M(q) q'' + C(q, q') q' + K q = G u + f(q, q', t).

    ``mass``, ``damping``, ``stiffness`` (n x n) and ``input`` (n x m) are arrays, sparse matrices, SymPy
    matrices, or lists of rows of numbers and expressions; ``force`` has n entries.
    """
    return _model(
        "mechanical",
        coordinates=coordinates,
        controls=controls,
        parameters=parameters,
        definitions=definitions,
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        force=force,
        input=input,
        flexible=flexible or None,
    )


def modal(
    *,
    inertia: ArrayLike,
    frequencies_hz: ArrayLike,
    participation: ArrayLike,
    basis: str,
    damping: ArrayLike = 0.0,
    axes: Names = ("theta",),
    controls: Names = ("T",),
    input: ArrayLike | None = None,
    modes: Names | None = None,
    parameters: Table = None,
) -> Model:
    """Rigid axes with structural modes of unit modal mass.

    ``inertia``: of the whole, kg m^2, (a x a), or a number for one axis; ``frequencies_hz`` (p,);
    ``damping``: ratios to the critical one, (p,) or one for all; ``participation``: a row for each mode,
    (p x a), couplings in sqrt(kg) m (rotations in a free basis); ``basis``: ``"constrained"`` (hub held fast)
    or ``"free"``; ``input`` (a x m), by default a control for each axis. Numbers may be texts in
    ``parameters``. Raises ValueError for shapes that do not fit.
    """
    frequencies = np.atleast_1d(np.asarray(frequencies_hz, object))
    count, width = frequencies.size, len(axes)
    ratios = np.broadcast_to(np.asarray(damping, object), (count,))
    rows = np.asarray(participation, object)
    # One axis or one mode: a plain list will do.
    rows = rows.reshape(count, width) if rows.size == count * width else rows
    if rows.shape != (count, width):
        raise ValueError(f"participation needs a row for each mode, shape {(count, width)}, not {rows.shape}")
    names = [f"mode{number}" for number in range(1, count + 1)] if modes is None else list(modes)
    if input is None and len(controls) != width:
        raise ValueError(f"{len(controls)} controls on {width} axes need an input matrix")
    listed = [
        {"name": name, "frequency_hz": frequency, "damping": ratio, "coupling": list(row)}
        for name, frequency, ratio, row in zip(names, frequencies, ratios, rows, strict=True)
    ]
    return _model(
        "modal",
        axes=axes,
        inertia=np.atleast_2d(np.asarray(inertia, object)),
        controls=controls,
        parameters=parameters,
        input=np.eye(width) if input is None else np.atleast_2d(np.asarray(input, object)),
        modes=listed,
        mode_basis=basis,
    )


def state_space(
    system: Any,
    B: ArrayLike | None = None,
    *,
    states: Names | None = None,
    controls: Names | None = None,
    parameters: Table = None,
) -> Model:
    """x' = A x + B u, from the arrays A (n x n) and B (n x m) or from a state space with ``.A`` and ``.B``.

    Such are those of SciPy and python-control; they must be of continuous time. Names are ``x1``... and
    ``u1``... by default. Entries may be texts in ``parameters``. Raises ValueError for shapes that do not
    fit.
    """
    matrices = _matrices(system, B)
    states, controls = _names(matrices, states, controls)
    rows = np.hstack(matrices)
    return first_order(
        {state: _combination(row, [*states, *controls]) for state, row in zip(states, rows, strict=True)},
        controls=controls,
        parameters=parameters,
    )


def state_space_outputs(
    system: Any,
    D: ArrayLike | None = None,
    *,
    names: Names | None = None,
    states: Names | None = None,
    controls: Names | None = None,
    units: Names | None = None,
) -> list[dict[str, Any]]:
    """The ``outputs`` y = C x + D u of a problem, from the arrays C and D or from a state space.

    Names are ``y1``... by default; states and controls must be those of the model.
    """
    given = hasattr(system, "C")
    C = np.atleast_2d(np.asarray(system.C if given else system, object))
    through = system.D if given else D
    if through is None:
        through = np.zeros((len(C), len(controls or ())))
    through = np.asarray(through, object).reshape(len(C), -1)
    states, controls = _names((C.T, through), states, controls)
    rows = np.hstack([C, through])
    names = names or [f"y{number}" for number in range(1, len(rows) + 1)]
    return [
        {"name": name, "expression": _combination(row, [*states, *controls]), "units": unit}
        for name, row, unit in zip(names, rows, units or [""] * len(rows), strict=True)
    ]


def _matrices(system: Any, B: Any) -> tuple[Any, Any]:
    """A and B as arrays of matching shapes."""
    if hasattr(system, "A") and hasattr(system, "B"):
        if B is not None:
            raise ValueError("a state space brings its own B")
        if getattr(system, "dt", None):
            raise ValueError("the state space is of discrete time; a document describes continuous time")
        A, B = system.A, system.B
    else:
        A, B = system, B if B is not None else np.zeros((len(system), 0))
    A = np.atleast_2d(np.asarray(A, object))
    B = np.asarray(B, object)
    B = B.reshape(-1, 1) if B.ndim < 2 else B
    if A.shape[0] != A.shape[1] or len(B) != len(A):
        raise ValueError(f"A must be square with as many rows as B, not of shapes {A.shape} and {B.shape}")
    return A, B


def _names(matrices: tuple[Any, Any], states: Names | None, controls: Names | None) -> tuple[Names, Names]:
    """The names of states and controls, as many as rows of the first and columns of the second matrix."""
    found: list[Names] = []
    counts = len(matrices[0]), matrices[1].shape[1]
    for letter, names, count in zip("xu", (states, controls), counts, strict=True):
        chosen = [f"{letter}{number}" for number in range(1, count + 1)] if names is None else list(names)
        if len(chosen) != count:
            raise ValueError(f"{len(chosen)} names, {', '.join(chosen)}, for {count} of them")
        found.append(chosen)
    return found[0], found[1]


def _combination(coefficients: Sequence[Any], names: Names) -> str:
    """The text of a linear combination, without what is zero."""
    terms = [_term(plain(value), name) for value, name in zip(coefficients, names, strict=True)]
    return " + ".join(term for term in terms if term).replace("+ -", "- ") or "0"


def _term(coefficient: Any, name: str) -> str:
    if isinstance(coefficient, str):
        return f"({coefficient})*{name}"
    if coefficient in (1, -1):
        return name if coefficient == 1 else f"-{name}"
    return f"{coefficient!r}*{name}" if coefficient != 0 else ""


def _model(kind: str, **parts: Any) -> Model:
    """A model without the parts that are not there."""
    written = {key: plain(value, f"/problem/model/{key}") for key, value in parts.items()}
    return {"kind": kind, **{key: value for key, value in written.items() if value not in (None, {})}}
