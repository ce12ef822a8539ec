"""Job documents from what people hold: arrays, state spaces, modal data, SymPy expressions, CasADi functions.

`Problem` writes the whole document; the other functions each write its ``model``. Neither SymPy nor CasADi is
imported here: whoever hands over their objects has done so.
"""

from solvers.builders.casadi_model import first_order_from_casadi
from solvers.builders.models import first_order, library, mechanical, modal, state_space, state_space_outputs
from solvers.builders.problem import MINIMUM_TIME, Problem
from solvers.builders.sympy_model import first_order_from_sympy, mechanical_from_sympy

__all__ = [
    "MINIMUM_TIME",
    "Problem",
    "first_order",
    "first_order_from_casadi",
    "first_order_from_sympy",
    "library",
    "mechanical",
    "mechanical_from_sympy",
    "modal",
    "state_space",
    "state_space_outputs",
]
