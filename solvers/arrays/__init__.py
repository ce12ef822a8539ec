"""Expressions over whole arrays: a graph in which nothing stands twice, and kernels that run it."""
