"""A sweep of 200 stiffness values of the flexible spacecraft against as many jobs that know nothing.

All over HTTP, on a service of its own (API, broker, workers) for each of two orders: cold jobs first, so that
the sweep meets a warm service, and the sweep first. A cold job is a whole job by itself, POSTed, solved,
verified and fetched; it starts from the default guess, and in a structure that its worker has not compiled:
its stiffness has another name in each. "alone" are cold jobs one after another, as a client that has one
question at a time meets them; "at once" are as many submitted together. The sweep solves the same points and
keeps the same results of them.

    python benchmarks/sweep.py [points] [refine]

With ``refine`` ``switching`` (the default) all have the switching times as unknowns, so that every point is
verified to 1e-8; with ``none`` they stay on their mesh. Processor time is that of all processes of the
service: it says what a point costs where the machine has other work too.
"""

from __future__ import annotations

import copy
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.client import Client
from app.embedded.service import EmbeddedService, ServiceOptions
from solvers.catalogue import load_case

POINTS = 200
FIRST, LAST = 80.0, 120.0
SWEEP = "sweep"


@dataclass(frozen=True)
class Measured:
    """One way to solve all points: wall time and processor time of all processes (s), and the objectives."""

    seconds: float
    processor: float
    objectives: list[float]


def cold(document: dict[str, Any], name: str, stiffness: float) -> dict[str, Any]:
    """The document with another stiffness, and in a ``name`` that no other job has used."""
    changed = copy.deepcopy(document)
    model = changed["problem"]["model"]
    model["parameters"] = {key: value for key, value in model["parameters"].items() if key != "k"}
    model["parameters"][name] = stiffness
    model["stiffness"] = [[0, 0], [0, f"2*{name}"]]
    return changed


def processor_seconds() -> float:
    """What all processes that this one has started have spent, with those of theirs that have ended."""
    spent: dict[int, tuple[int, int]] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                continue
            spent[int(folder.name)] = int(fields[1]), sum(map(int, fields[11:15]))

    def ours(process: int) -> bool:
        while process in spent:
            process = spent[process][0]
            if process == os.getpid():
                return True
        return False

    ticks = sum(time for process, (_, time) in spent.items() if ours(process))
    return ticks / os.sysconf("SC_CLK_TCK")


def measured(solve: Callable[[], list[float]]) -> Measured:
    """Solve all points in one way."""
    began, spent = time.perf_counter(), processor_seconds()
    objectives = solve()
    return Measured(time.perf_counter() - began, processor_seconds() - spent, objectives)


@contextmanager
def fresh_service(document: dict[str, Any]) -> Iterator[Client]:
    """A service of its own, whose workers have their libraries loaded."""
    with (
        tempfile.TemporaryFile() as log,
        tempfile.TemporaryDirectory() as folder,
        EmbeddedService(ServiceOptions(Path(folder), port=0, output=log), lambda line: None) as service,
        Client(service.url) as client,
    ):
        for job in [client.submit(cold(document, f"w{number}", 100.0)) for number in range(4)]:
            client.wait(job["id"])
        yield client


def ways(client: Client, document: dict[str, Any], points: int) -> dict[str, Callable[[], list[float]]]:
    """The ways to solve all points, cold ones first."""
    values = [FIRST + number * (LAST - FIRST) / (points - 1) for number in range(points)]

    def alone() -> list[float]:
        return [client.solve(cold(document, f"a{n}", value))["objective"] for n, value in enumerate(values)]

    def at_once() -> list[float]:
        jobs = [client.submit(cold(document, f"b{n}", value))["id"] for n, value in enumerate(values)]
        for job_id in jobs:
            client.wait(job_id)
        return [client.result(job_id)["objective"] for job_id in jobs]

    def sweep() -> list[float]:
        grid = {"/problem/model/parameters/k": {"from": FIRST, "to": LAST, "count": points}}
        return [row["objective"] for row in client.sweep(document, grid)["table"]]

    return {"cold jobs, alone": alone, "cold jobs, at once": at_once, SWEEP: sweep}


def main(points: int = POINTS, refine: str = "switching") -> None:
    """Print the table of each order."""
    document = load_case("flexible_spacecraft")
    document["method"] |= {"J": 4} | ({} if refine == "none" else {"refine": refine})
    for order in ("cold jobs first", "sweep first"):
        with fresh_service(document) as client:
            all_ways = list(ways(client, document, points).items())
            if order == "sweep first":
                all_ways.reverse()
            found = {name: measured(way) for name, way in all_ways}
        swept = found[SWEEP]
        print(f"\n{points} values of k, {order}")
        print("| | seconds | times the sweep | processor, ms a point | times the sweep | differ by at most |")
        print("|---|---|---|---|---|---|")
        for name, one in found.items():
            worst = max(abs(a - b) for a, b in zip(one.objectives, swept.objectives, strict=True))
            wall = f"{one.seconds:.1f} | {one.seconds / swept.seconds:.1f}"
            work = f"{1e3 * one.processor / points:.0f} | {one.processor / swept.processor:.1f}"
            print(f"| {name} | {wall} | {work} | {worst:.1e} |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else POINTS, *sys.argv[2:3])
