"""Refinement: better meshes and exact structures, from the answer of a first mesh."""
