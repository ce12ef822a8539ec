"""The surroundings of a satellite: magnetic field, Sun and Moon, atmosphere, orbits.

Formulas take floats, NumPy arrays or computer algebra symbols alike; what they call (``sin``, ...) is handed
in. Time is counted in days from J2000, 2000-01-01 12:00.
"""
