"""The process of an island: does the runs that it is ordered, tells how they go, ends with who started it."""

from __future__ import annotations

import sys
import time
from multiprocessing.connection import Connection

from solvers.companion import Failure, serve
from solvers.formulation.scenarios import formulate
from solvers.genetic.record import Recorder
from solvers.genetic.run import Order, run
from solvers.genetic.stage import Stage, Stages
from solvers.optimizers.genetic import Generation
from solvers.phases.trajectory import AnyTrajectory
from solvers.spec import GeneticMethod, check_document
from solvers.start.scaling import automatic_scaling

_TELL_EVERY = 0.1  # seconds


def main(descriptor: int) -> None:
    """Serve the other end of the socket ``descriptor``: document and start come first, then orders."""
    connection, messages = serve(descriptor)
    try:
        stage, method = _prepared(*messages.get())
        while True:
            _run(stage, method, messages.get(), connection)
    except Exception as error:  # noqa: BLE001  (raised again where the orders come from)
        connection.send(Failure(f"{type(error).__name__}: {error}"))


def _prepared(document: object, earlier: AnyTrajectory | None) -> tuple[Stage, GeneticMethod]:
    spec = check_document(document)
    assert isinstance(spec.method, GeneticMethod)
    problem = formulate(spec.problem, spec.implied_tolerance()).simulated
    stages = Stages.of(problem, automatic_scaling(problem), spec.method, earlier)
    return stages.at(0), spec.method


def _run(stage: Stage, method: GeneticMethod, order: Order, connection: Connection) -> None:
    recorder, next_word = Recorder(), time.monotonic() + _TELL_EVERY

    def watch(generation: Generation) -> None:
        nonlocal next_word
        recorder.add(generation)
        if time.monotonic() >= next_word:
            connection.send((order.number, recorder.part()))
            next_word = time.monotonic() + _TELL_EVERY

    population = run(stage, method, order, watch)
    last = recorder.part()
    last.population, last.ended = population, True
    connection.send((order.number, last))


if __name__ == "__main__":
    main(int(sys.argv[1]))
