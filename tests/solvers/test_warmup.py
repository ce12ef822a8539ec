"""A solve that has too little memory says so, however little is missing."""

import subprocess
import sys

import pytest

# Without the warm-up, the same limits let a solve run for ever inside OpenBLAS.
SOLVE = """
import resource, sys
from solvers.solve import solve
from solvers.spec import check_document
from solvers.warmup import warm_up
from tests.bad_documents import FLEXIBLE_SPACECRAFT

document = check_document(FLEXIBLE_SPACECRAFT | {"method": {"name": "swcm", "J": 8}})
warm_up()
taken = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + int(sys.argv[1]) * 2**20, resource.RLIM_INFINITY))
try:
    print(solve(document).status.value)
except Exception as error:
    print(type(error).__name__, error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc and limits the address space")
@pytest.mark.parametrize("room", [24, 400])
def test_a_solve_near_the_limit_of_memory_comes_to_an_end(room: int) -> None:
    """With ``room`` MiB left it says what it lacks, or aborts itself as C++ does; with enough it solves."""
    done = subprocess.run(
        [sys.executable, "-c", SOLVE, str(room)], capture_output=True, text=True, timeout=60
    )
    if room == 400:
        assert done.stdout.split() == ["converged"], done.stderr
    else:
        assert "Unable to allocate" in done.stdout or "bad_alloc" in done.stdout + done.stderr, done
