"""A layer over Numba for kernels that carry their types: C structs, pointers, vectors, and a cache on disk."""
