"""What a process does before its first solve, so that the first is like the others."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg

from solvers.arrays.graph import Graph
from solvers.arrays.kernel import fastest_kernel

# Large enough for the blocked algorithms, which want a work space.
_ORDER = 256


def warm_up() -> None:
    """Load the libraries of a solve, and let their linear algebra take its work space (about 0.1 s).

    To be called before the memory of the process is limited. Each copy of OpenBLAS (of NumPy, SciPy and
    CasADi) takes one buffer of 32 to 128 MiB when it is first used, and where there is none it asks again for
    ever; a library that cannot be mapped is an error that does not look like a lack of memory.
    """
    matrix = np.eye(_ORDER) + np.ones((_ORDER, _ORDER))
    matrix @ matrix
    scipy.linalg.lu_factor(matrix)
    ca.solve(ca.DM(matrix), ca.DM.ones(_ORDER, 1), "lapacklu")
    x = ca.SX.sym("x")
    quiet: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    angle = Graph().input("angle")
    fastest_kernel()([angle.graph.apply("sin", angle)], ["angle"], 1).run()
    ca.nlpsol("warm_up", "ipopt", {"x": x, "f": (x - 1) ** 2}, quiet)(x0=0)
