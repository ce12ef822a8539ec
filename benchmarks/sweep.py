"""A sweep of 200 stiffness values of the flexible spacecraft against as many jobs that know nothing.

All in one run on one service of its own (API, broker, workers), over HTTP. A cold job starts from the default
guess, and in a structure that its worker has not compiled: its stiffness has another name in each. "alone"
are cold jobs one after another, as a client that has one question at a time meets them; "at once" are as many
submitted together. The sweep solves the same points. All have the switching times as unknowns, so that every
point is verified to 1e-8. Processor time is that of all processes of the service: it says what a point costs
where the machine has other work too.
"""

from __future__ import annotations

import copy
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from app.client import Client
from app.embedded.service import EmbeddedService, ServiceOptions
from solvers.catalogue import load_case

POINTS = 200
STIFFNESS = {"from": 80, "to": 120}


def cold(document: dict[str, Any], number: int, stiffness: float) -> dict[str, Any]:
    """The document with another stiffness, and in names that no other job has used."""
    changed = copy.deepcopy(document)
    model = changed["problem"]["model"]
    name = f"k{number}"
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


def main(points: int = POINTS, level: int = 4) -> None:
    """Print the table."""
    document = load_case("flexible_spacecraft")
    document["method"] |= {"J": level, "refine": "switching"}
    grid = {"/problem/model/parameters/k": {**STIFFNESS, "count": points}}
    with (
        tempfile.TemporaryFile() as log,
        tempfile.TemporaryDirectory() as folder,
        EmbeddedService(ServiceOptions(Path(folder), port=0, output=log), lambda line: None) as service,
        Client(service.url) as client,
    ):
        # Everybody has his libraries loaded.
        for job in [client.submit(cold(document, 9000 + number, 100.0)) for number in range(4)]:
            client.wait(job["id"])
        start = STIFFNESS["from"]
        step = (STIFFNESS["to"] - start) / (points - 1)
        values = [start + number * step for number in range(points)]
        seconds, processor, objectives = {}, {}, {}

        began, spent = time.perf_counter(), processor_seconds()
        results = [client.solve(cold(document, number, value)) for number, value in enumerate(values)]
        seconds["cold jobs, alone"] = time.perf_counter() - began
        processor["cold jobs, alone"] = processor_seconds() - spent
        objectives["cold jobs, alone"] = [result["objective"] for result in results]

        began, spent = time.perf_counter(), processor_seconds()
        jobs = [client.submit(cold(document, 1000 + n, value))["id"] for n, value in enumerate(values)]
        for job_id in jobs:
            client.wait(job_id)
        seconds["cold jobs, at once"] = time.perf_counter() - began
        processor["cold jobs, at once"] = processor_seconds() - spent
        objectives["cold jobs, at once"] = [client.result(job_id)["objective"] for job_id in jobs]

        began, spent = time.perf_counter(), processor_seconds()
        swept = client.sweep(document, grid)
        seconds["sweep"] = time.perf_counter() - began
        processor["sweep"] = processor_seconds() - spent
        objectives["sweep"] = [row["objective"] for row in swept["table"]]

    print(f"\n{points} values of k; counts of the sweep: {swept['counts']}")
    print("| | seconds | times the sweep | processor, ms a point | times the sweep | largest difference |")
    print("|---|---|---|---|---|---|")
    for what, spent in seconds.items():
        worst = max(abs(a - b) for a, b in zip(objectives[what], objectives["sweep"], strict=True))
        row = f"{spent:.1f} | {spent / seconds['sweep']:.1f}"
        work = processor[what]
        row += f" | {1e3 * work / points:.0f} | {work / processor['sweep']:.1f} | {worst:.1e}"
        print(f"| {what} | {row} |")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
