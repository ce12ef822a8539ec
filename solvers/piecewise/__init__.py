"""Piecewise parallel optimal control: predict the next segment on a simple model while this one is tracked.

Source: Zhu, Shi, "Piecewise Parallel Optimal Algorithm", IntechOpen 2018, doi 10.5772/intechopen.76625.
"""
