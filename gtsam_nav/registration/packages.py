"""Optional packages, imported when they are first needed."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module
from typing import Any

from gtsam_nav.errors import PackageError


def open3d(purpose: str) -> Any:
    """The module ``open3d``.

    Parameters
    ----------
    purpose : str
        What needs it, for the error.

    Raises
    ------
    PackageError
        Where it is not installed, or a system library that it links is missing.
    """
    return _imported("open3d", purpose)


def kiss_icp(purpose: str, module: str) -> Any:
    """A module of the package ``kiss_icp``; raises as `open3d` does."""
    return _imported(f"kiss_icp.{module}", purpose)


def _imported(module: str, purpose: str) -> Any:
    found, trouble = _attempt(module)
    if found is None:
        package = module.split(".")[0]
        raise PackageError(
            f"{purpose} needs the package {package}, which does not import here: {trouble}"
        )
    return found


@cache
def _attempt(module: str) -> tuple[Any, str]:
    try:
        return import_module(module), ""
    except ModuleNotFoundError as error:
        return None, f"{error} (pip install {module.split('.')[0].replace('_', '-')})"
    except (ImportError, OSError) as error:  # OSError: a system library that the wheel links
        return None, f"{error} (a library of the system, which its package manager installs)"


def one_thread() -> AbstractContextManager[Any]:
    """While it lasts, OpenMP runs on one thread, so that sums are the same every time."""
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[Any] = threadpool_limits(limits=1, user_api="openmp")
    return limits
