"""Compilation, storage and linkage of numba kernels."""
