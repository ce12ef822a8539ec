"""Where the controls of a flight of phases switch: the arcs of all phases one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

ABSENT = "absent"
"""The arc of a phase that does not have the control."""


def joined_switching(
    found: Sequence[Mapping[str, Any]], controls: Sequence[Sequence[str]], ends: Sequence[float]
) -> dict[str, Any]:
    """The ``switching`` of a flight, from that of each phase, its controls and the time at which it ends.

    A control that goes on alike in the next phase does not switch there.
    """
    names = dict.fromkeys(name for own in found for name in own)
    return {name: _joined(name, found, controls, ends) for name in names}


def _joined(
    name: str, found: Sequence[Mapping[str, Any]], controls: Sequence[Sequence[str]], ends: Sequence[float]
) -> dict[str, list[Any]]:
    times: list[float] = []
    levels: list[float | None] = []
    arcs: list[str] = []
    for index, own in enumerate(found):
        # A control without two bounds is inside of them.
        kind = "interior" if name in controls[index] else ABSENT
        here = own.get(name, {"times": [], "levels": [None], "arcs": [kind]})
        goes_on = index > 0 and arcs[-1] == here["arcs"][0] and levels[-1] == here["levels"][0]
        if index and not goes_on:
            times.append(ends[index - 1])
        times += here["times"]
        levels += here["levels"][1:] if goes_on else here["levels"]
        arcs += here["arcs"][1:] if goes_on else here["arcs"]
    return {"times": times, "levels": levels, "arcs": arcs}
