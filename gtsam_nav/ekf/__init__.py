"""Reference filters: NumPy, their hot loops compiled by numba; never GTSAM."""
