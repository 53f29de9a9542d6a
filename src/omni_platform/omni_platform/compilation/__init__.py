"""How numba compiles, stores and links kernels."""
