"""Which GNSS fixes an estimator may use, and which it is scored on: never both."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from gtsam_nav.mission import Mission, Sensor
from gtsam_nav.series import GnssSeries, ReferenceSeries
from gtsam_nav.settings import Settings

DEFAULT_WINDOW_S = (0.0, 300.0)
"""Used fixes of a mission whose only truth is its GNSS."""


class GnssSettings(Settings):
    """GNSS policy and treatment.

    Attributes
    ----------
    use : {"all", "none", "every_k", "window", "gaps"} or None
        None means ``all`` where the mission has a separate reference, else ``window``.
    every_k : int
        With ``every_k``: fixes 0, k, 2k, ... are used.
    window_s : (float, float)
        With ``window``: fixes of this half-open span are used.
    gaps_s : tuple of (float, float)
        With ``gaps``: fixes of these half-open spans are withheld.
    use_height : bool
        Use GNSS height although the mission has a depth sensor. (`graph` uses it anyway while that
        sensor is silent.)
    use_velocity : bool
        Use the receiver's velocities where it gives them; else nothing looks at them.
    reject_outliers : bool
        Whether `ins-ekf` leaves out fixes that fail the tests below; `graph` has its own settings
        for that, ``graph.robust.gnss`` and ``graph.robust.gnss_velocity``.
    position_gate_probability, velocity_gate_probability : float
        A fix's position (or velocity) is an outlier where a chi-square variable would stay below
        its normalised residual with this probability.
    """

    use: Literal["all", "none", "every_k", "window", "gaps"] | None = None
    every_k: int = Field(default=30, ge=1)
    window_s: tuple[float, float] = DEFAULT_WINDOW_S
    gaps_s: tuple[tuple[float, float], ...] = ()
    use_height: bool = False
    use_velocity: bool = True
    reject_outliers: bool = True
    position_gate_probability: float = Field(default=0.999, gt=0, lt=1)
    velocity_gate_probability: float = Field(default=0.999, gt=0, lt=1)

    @model_validator(mode="after")
    def _spans_are_ordered(self) -> GnssSettings:
        for start, stop in (self.window_s, *self.gaps_s):
            if not start < stop:
                raise ValueError(f"the span [{start}, {stop}] is empty; start must be before stop")
        if self.use == "gaps" and not self.gaps_s:
            raise ValueError("use=gaps needs gaps_s, the spans whose fixes are withheld")
        return self


def split_fixes(mission: Mission, settings: GnssSettings) -> tuple[Mission, Sensor | None, int]:
    """Separate what an estimator sees from what it is scored on.

    Parameters
    ----------
    mission : Mission
        With its reference and all of its fixes.
    settings : GnssSettings

    Returns
    -------
    blind : Mission
        Without the reference, the withheld fixes, and velocities that are not to be used. It says
        where the policy leaves no fix.
    reference : Sensor or None
        The mission's reference; without one, the withheld fixes of its first receiver.
    n_withheld : int
        Number of withheld fixes over all receivers.
    """
    use = settings.use or ("all" if mission.reference is not None else "window")
    blind = mission.without(*[s.name for s in mission.sensors.values() if s.type == "reference"])
    reference = mission.reference
    n_withheld = n_used = 0
    for sensor in mission.of_type("gnss"):
        series = sensor.series
        assert isinstance(series, GnssSeries)
        t = series.t
        if use == "all":
            used = np.ones(len(t), dtype=bool)
        elif use == "none":
            used = np.zeros(len(t), dtype=bool)
        elif use == "every_k":
            used = np.arange(len(t)) % settings.every_k == 0
        elif use == "window":
            used = (t >= settings.window_s[0]) & (t < settings.window_s[1])
        else:
            used = ~np.any([(t >= a) & (t < b) for a, b in settings.gaps_s] or [t < t[0]], axis=0)
        n_used, n_withheld = n_used + int(np.sum(used)), n_withheld + int(np.sum(~used))
        left = series.select(used)
        left = left if settings.use_velocity else replace(left, v_n=None)
        blind = blind.with_sensor(replace(sensor, series=left))
        if reference is None and np.any(~used):
            reference = reference_from_fixes(replace(sensor, series=series.select(~used)))
    if n_withheld and not n_used and use != "none":
        blind = replace(blind, warnings=(*blind.warnings, _said_of_none(mission, use, settings)))
    return blind, reference, n_withheld


def _said_of_none(mission: Mission, use: str, settings: GnssSettings) -> str:
    """What is said where a policy leaves no fix, though not by asking for none."""
    t = np.concatenate([sensor.series.t for sensor in mission.of_type("gnss")])
    spans = f" (gnss.window_s is {list(settings.window_s)})" if use == "window" else ""
    return (
        f"gnss.use={use}{spans} leaves the estimate none of the {len(t)} fixes, which are from"
        f" {t.min():.1f} s to {t.max():.1f} s; gnss.use=all, or another window, gives it some"
    )


def reference_from_fixes(gnss: Sensor) -> Sensor:
    """GNSS fixes as a horizontal reference at their antenna."""
    series = gnss.series
    assert series.TYPE == "gnss"
    reference = ReferenceSeries(
        t=series.t,
        row=series.row,
        p_n=getattr(series, "p_n"),  # noqa: B009
        sigma=np.hypot(series.sigma[:, 0], series.sigma[:, 1]) / np.sqrt(2),  # type: ignore[attr-defined]
        vertical_usable=False,
    )
    return replace(gnss, name=f"{gnss.name} (withheld)", type="reference", series=reference)
