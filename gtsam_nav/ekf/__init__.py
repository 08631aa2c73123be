"""Reference filters: NumPy only, never GTSAM."""
