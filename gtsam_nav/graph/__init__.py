"""The factor graph: the only package that imports gtsam."""
