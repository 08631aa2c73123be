"""How far each sensor is believed: its kernel, and the gate beyond which a reading is left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from gtsam_nav.errors import DataError
from gtsam_nav.mission import Mission
from gtsam_nav.settings import Settings

KernelName = Literal["none", "huber", "cauchy", "geman_mcclure", "dcs", "tukey", "tls"]

THRESHOLDS: Mapping[KernelName, float] = {
    "none": 1.0,
    "huber": 1.345,
    "cauchy": 2.385,
    "geman_mcclure": 3.787,
    "dcs": 1.898,
    "tukey": 4.685,
    "tls": 2.795,
}
"""In standard deviations: each kernel is then 95 % as efficient as least squares on one residual
of Gaussian noise, ``E[psi']^2 / E[psi^2]`` (Huber 1964)."""


CUTTING: tuple[KernelName, ...] = ("geman_mcclure", "dcs", "tukey", "tls")
"""Kernels that leave a large residual next to nothing: where a solve starts, far from where it
ends, they would cut off what is good."""


class Robustness(Settings):
    """The m-estimator on a sensor's whitened residuals.

    Attributes
    ----------
    kernel : {"none", "huber", "cauchy", "geman_mcclure", "dcs", "tukey", "tls"}
        ``none`` is least squares.
    threshold : float or None
        Its scale in standard deviations; None is the kernel's default.
    """

    TUNED: ClassVar[Mapping[str, float]] = {}
    """Defaults of a sensor that differ from `THRESHOLDS`."""

    kernel: KernelName = "huber"
    threshold: float | None = Field(default=None, gt=0)

    @property
    def scale(self) -> float:
        """The threshold, whether stated or the default."""
        return self.threshold or self.TUNED.get(self.kernel, THRESHOLDS[self.kernel])

    @property
    def at_first(self) -> Robustness:
        """What stands in while the solution is still far: Cauchy's kernel for one that cuts.

        It gives nothing up for good, and its solution is near enough for the other: two steps of
        graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020).
        """
        return Robustness(kernel="cauchy") if self.kernel in CUTTING else self


class GatedRobustness(Robustness):
    """A kernel, and a gate for what may be left out altogether.

    Attributes
    ----------
    gate_probability : float or None
        A reading is an outlier where a chi-square variable would stay below its normalised
        residual with this probability; None never leaves one out.
    """

    gate_probability: float | None = Field(default=None, gt=0, lt=1)


class GnssRobustness(GatedRobustness):
    """Least squares on the fixes that pass their gate."""

    kernel: KernelName = "none"
    gate_probability: float | None = Field(default=0.999, gt=0, lt=1)


class SightingRobustness(GatedRobustness):
    """Sightings of landmarks, of which many are merely bad, beside false ones."""

    kernel: KernelName = "cauchy"
    gate_probability: float | None = Field(default=0.999, gt=0, lt=1)


class LoopRobustness(GatedRobustness):
    """Scan matches, whose gate is against the estimate at the time of the new scan."""

    TUNED: ClassVar[Mapping[str, float]] = {"cauchy": 1.5}

    kernel: KernelName = "cauchy"
    gate_probability: float | None = Field(default=0.999, gt=0, lt=1)


class RobustSettings(Settings):
    """Kernels and gates by kind of measurement.

    Attributes
    ----------
    gnss, gnss_velocity : GnssRobustness
        Position and velocity of a fix are judged on their own.
    velocity, constraints : Robustness
        The vehicle's own motion, by DVL or odometry, and what is known of it without a sensor:
        without them the keyframes fall apart, so these have no gate.
    clouds : Robustness
        The motion from one 3-D cloud to the next.
    heading, attitude, depth : GatedRobustness
        An AHRS's orientation is one residual, which ``heading`` governs.
    landmarks : SightingRobustness
    loops : LoopRobustness
        Of consecutive scans' matches too, and of the loops between 3-D clouds.
    """

    gnss: GnssRobustness = GnssRobustness()
    gnss_velocity: GnssRobustness = GnssRobustness()
    velocity: Robustness = Robustness()
    constraints: Robustness = Robustness()
    clouds: Robustness = Robustness()
    heading: GatedRobustness = GatedRobustness()
    attitude: GatedRobustness = GatedRobustness()
    depth: GatedRobustness = GatedRobustness()
    landmarks: SightingRobustness = SightingRobustness()
    loops: LoopRobustness = LoopRobustness()

    @property
    def at_first(self) -> RobustSettings:
        """With every kernel as it is at first, and every gate as it is."""
        kernels = {
            name: getattr(self, name).model_copy(
                update={"kernel": first.kernel, "threshold": first.threshold}
            )
            for name in type(self).model_fields
            if (first := getattr(self, name).at_first) is not getattr(self, name)
        }
        return self.model_copy(update=kernels)


def check_sigmas(mission: Mission, robust: RobustSettings) -> None:
    """Raise a DataError for a sensor that states a sigma of zero: no kernel can weigh by it."""
    for sensor in mission.sensors.values():
        if sensor.type == "reference":
            continue
        for name in sensor.series.column_specs():
            sigma = getattr(sensor.series, name) if name.startswith("sigma") else None
            if sigma is None or np.all(sigma > 0):
                continue
            k = int(np.flatnonzero(np.any(sigma.reshape(len(sigma), -1) <= 0, axis=1))[0])
            kind = sensor.type if sensor.type in RobustSettings.model_fields else "velocity"
            kernel = getattr(robust, kind).kernel
            raise DataError(
                f"sensor '{sensor.name}': {name} is {np.min(sigma[k]):g} at"
                f" {sensor.series.t[k]:.1f} s; residuals are weighed by it (graph.robust.{kind},"
                f" kernel {kernel}), so it must be above zero"
            )
