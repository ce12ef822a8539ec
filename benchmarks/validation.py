"""What the API spends on a document before it answers: reading and checking it, in CPU time."""

from __future__ import annotations

import json
import statistics
import time

from solvers.catalogue import load_case
from solvers.spec import check_document, parse_document

RUNS = 200
SIZE = 4096


def main() -> None:
    """Print the median CPU time for the flexible spacecraft, padded to 4 kB by a guess."""
    document = load_case("flexible_spacecraft")
    document["problem"]["guess"] = {"final_time": 30, "states": {"theta": [0.0]}}
    values = document["problem"]["guess"]["states"]["theta"]
    while len(json.dumps(document)) < SIZE:
        values.append(round(0.5236 * len(values) / 400, 4))
    raw = json.dumps(document).encode()
    seconds = []
    for _ in range(RUNS):
        started = time.process_time()
        check_document(parse_document(raw))
        seconds.append(time.process_time() - started)
    print(
        f"\nReading and checking {len(raw)} bytes: {1e3 * statistics.median(seconds):.2f} ms of CPU (median)"
    )


if __name__ == "__main__":
    main()
