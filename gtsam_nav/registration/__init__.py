"""Pairwise registration of point sets: stateless, one protocol, one result type, one registry."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol

from gtsam_nav.errors import ConfigError

if TYPE_CHECKING:
    from gtsam_nav.frames import Array
    from gtsam_nav.registration.result import CloudMatch, RelativePose
    from gtsam_nav.settings import Settings


class Registration(Protocol):
    """Registers new points (m, 3) to reference points (n, 3) from an expected pose.

    Failure is a result with its reason, never an identity.
    """

    def __call__(
        self, reference: Array, new: Array, prior: RelativePose, settings: Settings
    ) -> CloudMatch: ...


@dataclass(frozen=True)
class _Method:
    """Where a method is, the settings that it takes, and whether it sees the plane only."""

    module: str
    function: str
    settings: str
    planar: bool = False


_METHODS = {
    "pic": _Method("pic", "register_points", "PicSettings", planar=True),
    "open3d-icp": _Method("open3d_icp", "register_icp", "Open3dSettings"),
    "open3d-gicp": _Method("open3d_icp", "register_gicp", "Open3dSettings"),
}


def registrations(planar: bool | None = None) -> tuple[str, ...]:
    """Names that `register` takes: all, or those that do, or do not, see the plane only."""
    return tuple(k for k, method in _METHODS.items() if planar in (None, method.planar))


def register(
    method: str,
    reference: Array,
    new: Array,
    prior: RelativePose,
    settings: Settings | None = None,
) -> CloudMatch:
    """Register one point set to another.

    Parameters
    ----------
    method : str
        One of `registrations`.
    reference, new : ndarray, shapes (n, 3) and (m, 3)
        Each in its own frame, m. A planar method looks at x and y.
    prior : RelativePose
        Where to begin. A planar method also looks no further than its covariance, and keeps what it
        says of height, roll and pitch.
    settings : Settings, optional
        The method's own; its defaults where absent.

    Raises
    ------
    ConfigError
        For an unknown method.
    PackageError
        Where the method needs a package that does not import.
    """
    if method not in _METHODS:
        raise ConfigError(
            f"unknown registration '{method}'; the choices are: {', '.join(_METHODS)}"
        )
    chosen = _METHODS[method]
    run: Registration = getattr(
        import_module(f"gtsam_nav.registration.{chosen.module}"), chosen.function
    )
    if settings is None:
        own = import_module("gtsam_nav.registration.settings")
        settings = getattr(own, chosen.settings)()
    return run(reference, new, prior, settings)
