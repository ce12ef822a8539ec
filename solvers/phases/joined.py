"""Programs side by side: their unknowns and rows one after the other, and rows over the unknowns of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np
from scipy import sparse

from solvers.program import NonlinearProgram, PlaceFunction


def side_by_side(parts: Sequence[NonlinearProgram], joints: NonlinearProgram) -> NonlinearProgram:
    """The program of all ``parts``, with the rows and costs of ``joints``, whose unknowns are theirs."""
    size = joints.variables
    rows = sum(part.constraints for part in parts) + joints.constraints
    first_unknowns = [0, *accumulate(part.variables for part in parts)]
    first_rows = [0, *accumulate(part.constraints for part in parts)]
    everything = [*parts, joints]
    groups = [
        _placed(group, size, rows, unknown, row)
        for part, unknown, row in zip(everything, [*first_unknowns[:-1], 0], first_rows, strict=True)
        for group in part.groups
    ]
    return NonlinearProgram(
        initial=np.concatenate([part.initial for part in parts]),
        lower=np.concatenate([part.lower for part in parts]),
        upper=np.concatenate([part.upper for part in parts]),
        linear=sparse.csr_array(
            sparse.vstack(
                [sparse.block_diag([part.linear for part in parts], format="csr"), joints.linear],
                format="csr",
            )
        ),
        linear_cost=np.concatenate([part.linear_cost for part in parts]) + joints.linear_cost,
        constraint_lower=np.concatenate([part.constraint_lower for part in everything]),
        constraint_upper=np.concatenate([part.constraint_upper for part in everything]),
        groups=tuple(groups),
    )


def _placed(group: PlaceFunction, size: int, rows: int, unknown: int, row: int) -> PlaceFunction:
    """The group with its unknowns from ``unknown`` and its rows from ``row`` on."""
    gather, scatter = sparse.csr_array(group.gather), sparse.csc_array(group.scatter)
    return replace(
        group,
        gather=sparse.csr_array(
            (gather.data, gather.indices + unknown, gather.indptr), shape=(gather.shape[0], size)
        ),
        scatter=sparse.csc_array(
            (scatter.data, scatter.indices + row, scatter.indptr), shape=(rows, scatter.shape[1])
        ),
    )
