"""The long run: a service with production values to which hundreds of faults happen (``make soak``).

Prints a line for each round of faults and a table at the end; stops at the first promise that is broken, and
leaves the folder of the service for a look.
"""

from __future__ import annotations

import argparse
import random
import shutil
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from tests.acceptance.conftest import SHORT
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.faults.world import FAULTS, World

EFFORTS: list[dict[str, Any]] = [
    {"method": {"name": "swcm"}, "options": {}},
    {"method": {"name": "swcm", "J": 8}, "options": {}},
    {"method": {"name": "swcm", "J": 11}, "options": {"max_seconds": 8}},
]
PRODUCTION = {"ONDELETTE_VISIBILITY_SECONDS": "30"}


def main() -> int:
    """Run as many faults as asked for, in rounds after each of which everything must come to its end."""
    parser = argparse.ArgumentParser(description="Ill-treat a service and see whether it keeps its promises.")
    parser.add_argument("--faults", type=int, default=1000, help="how many faults in all")
    parser.add_argument("--round", type=int, default=100, help="how many faults between two checks")
    parser.add_argument("--pause", type=float, default=1.0, help="mean time between two faults, s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--short", action="store_true", help="the short leases of the tests")
    asked = parser.parse_args()
    choice = random.Random(asked.seed)
    directory = Path(tempfile.mkdtemp(prefix="ondelette-soak-"))
    world = World(directory, {**SHORT, "ONDELETTE_RECONCILE_SECONDS": "1"} if asked.short else PRODUCTION)
    began = time.monotonic()
    ends: Counter[str] = Counter()
    try:
        while (done := world.faults.total()) < asked.faults:
            for _ in range(min(asked.round, asked.faults - done)):
                _one(world, choice, asked.pause)
            ends += world.settle(300)
            memory = [process.memory() // 2**20 for process in (world.api, *world.crew)]
            files = [process.files() for process in (world.api, *world.crew)]
            figures = f"{world.faults.total():5d} faults  {ends.total():5d} jobs"
            print(
                f"{time.monotonic() - began:6.0f} s  {figures}  API and workers: {memory} MiB, {files} files",
                flush=True,
            )
    except AssertionError:
        print(f"broken after {world.faults.total()} faults; see {directory}")
        raise
    finally:
        world.close()
    shutil.rmtree(directory)
    for name, table in (("fault", world.faults), ("end", ends)):
        print(f"\n{name:<24}number")
        for what, number in sorted(table.items()):
            print(f"{what:<24}{number:6d}")
    return 0


def _one(world: World, choice: random.Random, pause: float) -> None:
    while len(world.active) < 4:
        world.submit(FLEXIBLE_SPACECRAFT | choice.choice(EFFORTS))
    if choice.random() < 0.1:
        world.cancel(choice.choice(world.active))
    world.look()
    if world.active:
        world.inject(choice.choice(FAULTS), choice)
    time.sleep(choice.expovariate(1 / pause))


if __name__ == "__main__":
    raise SystemExit(main())
