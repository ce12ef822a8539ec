"""What every peer's script does: solve twice in a fresh interpreter, print one line of JSON.

    python SCRIPT.py CASE N [VARIANT]

"cold" is the first build and solve of this interpreter, importing apart. "warm" is the median of the next
three solves (of one where a solve takes longer than five seconds) from the same guess, with whatever the
library can keep: a script's ``build`` returns what is called again.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from problems import Case, load

WARM_RUNS = 3
LONG = 5.0
Series = dict[str, list[float]]


@dataclass(frozen=True)
class Answer:
    """What a library returned. ``controls`` are to be read linearly between ``times``.

    ``states`` belong to ``state_times``; both lists of times run from the initial to the final time.
    ``message`` is the library's own word on its answer, ``mesh`` what it solved on.
    """

    objective: float
    times: list[float]
    controls: Series
    state_times: list[float]
    states: Series
    success: bool
    message: str
    mesh: str
    seconds: float | None = None
    """Where the library tells its own time, verification apart; else the whole call counts."""
    miss: float | None = None
    """The miss of its own flight, where the library flies its answer."""


Build = Callable[[Case, int, str], Callable[[], Answer]]
"""Of a case, N and a variant: what solves it from its guess, as often as called."""


def through_the_ends(
    times: Sequence[float], values: Sequence[float], first: float, last: float
) -> tuple[list[float], list[float]]:
    """Lengthen values at ascending times to both ends by their outermost straight lines."""
    instants, numbers = [float(t) for t in times], [float(v) for v in values]
    small = 1e-12 * (last - first)
    if instants[0] > first + small:
        slope = (numbers[1] - numbers[0]) / (instants[1] - instants[0])
        numbers.insert(0, numbers[0] - slope * (instants[0] - first))
        instants.insert(0, first)
    if instants[-1] < last - small:
        slope = (numbers[-1] - numbers[-2]) / (instants[-1] - instants[-2])
        numbers.append(numbers[-1] + slope * (last - instants[-1]))
        instants.append(last)
    return instants, numbers


def held(times: Sequence[float], values: Sequence[float]) -> tuple[list[float], list[float]]:
    """A piecewise constant control as straight lines: K + 1 ``times``, K ``values``, each held."""
    instants = [float(times[0]), *(float(t) for t in times[1:-1] for _ in (0, 1)), float(times[-1])]
    return instants, [float(v) for v in values for _ in (0, 1)]


def run(peer: str, version: str, build: Build) -> None:
    """Carry out the contract for the command line of this process."""
    case, points, variant = load(sys.argv[1]), int(sys.argv[2]), (sys.argv[3:] or [""])[0]
    # Solvers print, some of them from compiled code: keep standard output for the answer.
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    started = time.perf_counter()
    solve = build(case, points, variant)
    building = time.perf_counter() - started

    def timed() -> tuple[Answer, float]:
        started = time.perf_counter()
        answer = solve()
        spent = time.perf_counter() - started
        return answer, spent if answer.seconds is None else answer.seconds

    answer, first = timed()
    cold = first if answer.seconds is not None else building + first
    runs = [timed() for _ in range(1 if first > LONG else WARM_RUNS)]
    line = {"peer": peer, "version": version, "case": case.name, "N": points, "variant": variant}
    line |= {"seconds_cold": cold, "seconds_warm": statistics.median(spent for _, spent in runs)}
    line |= {key: value for key, value in asdict(answer).items() if key != "seconds"}
    print(json.dumps(line), file=out, flush=True)
