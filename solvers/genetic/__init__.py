"""The genetic algorithm on a wavelet parametrisation of the controls."""
