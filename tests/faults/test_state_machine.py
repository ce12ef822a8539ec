"""Users and faults in any order: whatever happens, the promises of the service hold."""

import random
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test

from tests.acceptance.conftest import SHORT
from tests.bad_documents import FLEXIBLE_SPACECRAFT
from tests.faults.world import FAULTS, World

# Three levels of effort: some tenths of a second, about a second, and more than a lease.
EFFORTS: list[dict[str, Any]] = [
    {"method": {"name": "swcm"}, "options": {}},
    {"method": {"name": "swcm", "J": 8}, "options": {}},
    {"method": {"name": "swcm", "J": 10}, "options": {"max_seconds": 4}},
]
EXAMPLES = 4
STEPS = 4


@pytest.fixture
def world() -> Iterator[World]:
    # Not pytest's own directory: a socket's path may have about 100 characters at most.
    with tempfile.TemporaryDirectory(prefix="ondelette-") as directory:
        world = World(
            Path(directory), {**SHORT, "ONDELETTE_RECONCILE_SECONDS": "1", "ONDELETTE_OUTAGE_SECONDS": "20"}
        )
        yield world
        world.close()


@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers' children in /proc")
@pytest.mark.timeout(300)
def test_nothing_is_lost_and_nothing_happens_twice(world: World) -> None:
    class Service(RuleBasedStateMachine):
        """Users of the service, and what befalls it."""

        @rule(effort=st.sampled_from(EFFORTS))
        def submit(self, effort: dict[str, Any]) -> None:
            world.submit(FLEXIBLE_SPACECRAFT | effort)

        @rule(which=st.integers(0, 99))
        def cancel(self, which: int) -> None:
            if world.active:
                world.cancel(world.active[which % len(world.active)])

        @initialize(faults=st.permutations(FAULTS), seed=st.integers(0, 2**32))
        def storm(self, faults: list[str], seed: int) -> None:
            # Nothing that is drawn may depend on what the service was doing just then.
            choice = random.Random(seed)
            for number, fault in enumerate(faults):
                while len(world.active) < 3:
                    world.submit(FLEXIBLE_SPACECRAFT | choice.choice(EFFORTS))
                self.befall(fault, seed + number)

        @rule(fault=st.sampled_from(FAULTS), seed=st.integers(0, 2**32))
        def befall(self, fault: str, seed: int) -> None:
            choice = random.Random(seed)
            world.look()
            world.inject(fault, choice)
            time.sleep(choice.uniform(0.0, 0.6))

        def teardown(self) -> None:
            world.settle(60)

    run_state_machine_as_test(
        Service,
        settings=settings(
            max_examples=EXAMPLES,
            stateful_step_count=STEPS,
            deadline=None,
            derandomize=True,
            database=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        ),
    )
    assert world.faults.total() >= 50, world.faults
