"""Does the tether ever tumble? The deorbit from 8 sides of the Earth, by three lengths of segments."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import math
import sys

from solvers.catalogue import load_case
from solvers.solve import solve
from solvers.spec import check_document

SIDES = 8
# Segments of this length in s, by so many nodes, and so many of them ahead: always 6000 s or more.
LENGTHS = ((1500.0, 15, 4), (3000.0, 30, 2), (6000.0, 60, 2))
LIMIT = 45.0


def mission(angle: float, length: float, nodes: int, lookahead: int) -> tuple[str, bool]:
    """One line of the table, and whether it is as it should be."""
    document = load_case("edt_igrf")
    document["problem"]["initial_state"]["lon"] = angle
    document["method"] |= {
        "segments": {"by": "time", "length": length},
        "nodes": nodes,
        "lookahead": lookahead,
    }
    document["options"] = {"max_seconds": 600}
    result = solve(check_document(document)).result()
    bounds = {item["pointer"].rpartition("/")[2]: item for item in result["constraints"]}
    pitch, roll = (
        math.degrees(max(abs(bounds[name]["min"]), abs(bounds[name]["max"]))) for name in ("alpha", "beta")
    )
    good = bool(result["success"]) and max(pitch, roll) <= LIMIT
    text = (
        f"| {length:.0f} | {math.degrees(angle):.0f} | {result['status']} "
        f"| {result['final_time'] / 3600:.2f} | {pitch:.1f} | {roll:.1f} | {'' if good else 'NO'} |"
    )
    return text, good


def main() -> int:
    """Print the table; 1 if any mission leaves 45 deg or does not arrive."""
    print("\n| segment, s | start, deg | status | hours to 700 km | pitch, deg | roll, deg | |")
    print("|---|---|---|---|---|---|---|")
    every = []
    for length in LENGTHS:
        for side in range(SIDES):
            text, good = mission(side * 2 * math.pi / SIDES, *length)
            every.append(good)
            print(text, flush=True)
    return 0 if all(every) else 1


if __name__ == "__main__":
    sys.exit(main())
