"""Optima of the solar array inside the basis db2, 5 functions for each control, by another program.

By (case, levels of wavelets): 0 has 15 genes, 1 has 30. Found by CMA-ES and a trust-region method on a
quadrature of its own with 1,280 cells and more.
"""

EXACT = {
    ("1", 0): 4.443955080,
    ("1", 1): 4.443590181,
    ("2", 0): 10.205104621,
    ("2", 1): 9.712634736,
    ("2neg", 0): 8.742991676,
    ("2neg", 1): 8.387193006,
}
"""Least energies with exact ends."""
PENALISED = {
    ("1", 0): 4.434564,
    ("1", 1): 4.434323,
    ("2", 0): 9.978910,
    ("2", 1): 9.515983,
    ("2neg", 0): 8.619718,
    ("2neg", 1): 8.280200,
}
"""Least |alpha|^2 + 100 |x(T) - x_f|^2."""
