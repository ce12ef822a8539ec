"""Where in the document as submitted stands what a problem knows by a plain pointer."""

from __future__ import annotations

from solvers.spec.problem import ProblemSpec


def place_in_document(spec: ProblemSpec, pointer: str) -> str:
    """The place in the document as submitted of ``pointer``, or of ``pointer@case`` in a case of scenarios.

    That of the case where it says it itself, and ``*`` for ends that no name says.
    """
    place, _, case = pointer.partition("@")
    *_, key, name = place.split("/")
    for index, item in enumerate([] if spec.scenarios is None else spec.scenarios.cases):
        if item.name == case and name in getattr(item, key, {}):
            return f"/problem/scenarios/cases/{index}/{key}/{name}"
    if key in ("initial_state", "final_state") and name not in getattr(spec, key):
        return f"/problem/{key}/*"
    return place
