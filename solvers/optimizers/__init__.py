"""Optimizers of nonlinear programs; they know nothing of optimal control."""
