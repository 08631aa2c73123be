"""Which packages are installed and whether they import: what ``gtsam-nav doctor`` tells."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib import import_module, metadata

PACKAGES = {
    "gtsam": ("gtsam", "the factor graph"),
    "numpy": ("numpy", "everything"),
    "scipy": ("scipy", "rotations and statistics"),
    "numba": ("numba", "fast kernels"),
    "pymap3d": ("pymap3d", "geodesy"),
    "pydantic": ("pydantic", "settings"),
    "pyyaml": ("yaml", "settings and mission folders"),
    "matplotlib": ("matplotlib", "plots and the report"),
    "pillow": ("PIL", "the picture of the map"),
    "rich": ("rich", "the command line"),
    "typer": ("typer", "the command line"),
    "distributed": ("distributed", "many missions at once"),
    "pandas": ("pandas", "tables of many missions"),
    "pyarrow": ("pyarrow", "tables of many missions"),
    "rosbags": ("rosbags", "ROS bags"),
    "kiss-icp": ("kiss_icp", "lidar odometry"),
    "open3d": ("open3d", "registration of 3-D clouds"),
}
"""Distribution to module and what it is for."""

OPTIONAL = frozenset({"rosbags", "kiss-icp", "open3d"})
"""Without these the methods of this version run all the same."""


@dataclass(frozen=True)
class PackageState:
    """One dependency as it is installed here; ``trouble`` is None where it imports."""

    name: str
    purpose: str
    optional: bool
    version: str | None
    trouble: str | None


def examine() -> tuple[PackageState, ...]:
    """Import every dependency and say what came of it."""
    return tuple(_examine(name, *about) for name, about in PACKAGES.items())


def _examine(name: str, module: str, purpose: str) -> PackageState:
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return PackageState(name, purpose, name in OPTIONAL, None, "not installed")
    trouble = None
    try:
        import_module(module)
    except (ImportError, OSError) as error:  # OSError: a system library that the wheel needs
        trouble = str(error)
    return PackageState(name, purpose, name in OPTIONAL, version, trouble)


def interpreter() -> str:
    """Python's version and the machine, in a line."""
    return f"Python {platform.python_version()} on {platform.platform()}"
