"""The compass against the course that GNSS saw: convention, reversal, offset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtsam_nav.audit import fixes
from gtsam_nav.audit.courses import BOW, Baselines, Velocity
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.significance import FALSE_ALARM, best, limit, losses
from gtsam_nav.frames import Array, wrap_angle


@dataclass(frozen=True)
class Convention:
    """How headings may be meant: what is done to them, and the card's lines that do it."""

    name: str
    sign: float
    turn_deg: float

    def applied(self, heading: Array) -> Array:
        """The headings that are meant, rad."""
        return np.asarray(self.sign * heading + np.radians(self.turn_deg))

    @property
    def is_stated(self) -> bool:
        """Whether the headings are what they are taken for."""
        return self.sign > 0 and self.turn_deg == 0.0

    @property
    def fix(self) -> str:
        """What mends it in the compass's card."""
        lines = [fixes.scale("heading_deg", -1)] if self.sign < 0 else []
        lines += [fixes.heading_turned_by(self.turn_deg)] if self.turn_deg else []
        return ", ".join(lines)

    @property
    def fix_of_fixes(self) -> str:
        """What mends it in the receiver's card, where it is the fixes that are mirrored."""
        if self.turn_deg == 90.0:
            metres = fixes.columns({"n": "e", "e": "n"})
            return f"{metres} (in a file of degrees {fixes.EXCHANGED_DEGREES})"
        if self.turn_deg == -90.0:
            return fixes.columns({"n": "e", "e": "n"}) + ", " + fixes.scale("n e", -1)
        if self.turn_deg == 0.0:
            return f"{fixes.scale('e', -1)} (lon_deg where it has degrees)"
        return f"{fixes.scale('n', -1)} (lat_deg where it has degrees)"


CONVENTIONS = (
    Convention("clockwise from north", 1.0, 0.0),
    Convention("reversed: 180 deg off", 1.0, 180.0),
    Convention("90 deg off", 1.0, 90.0),
    Convention("90 deg off", 1.0, -90.0),
    Convention("counter-clockwise from east", -1.0, 90.0),
    Convention("counter-clockwise from north", -1.0, 0.0),
    Convention("counter-clockwise from west", -1.0, -90.0),
    Convention("counter-clockwise from south", -1.0, 180.0),
)
"""The stated one first."""


@dataclass(frozen=True)
class HeadingAgainstCourse:
    """Direction of the travelled way by compass less that by GNSS.

    Attributes
    ----------
    heading, gnss : str
    velocity : str or None
        The sensor whose drift angle was taken into account; None where the vehicle was taken to
        move along its bow.
    n_baselines : int
    baseline_m : float
    median_deg, spread_deg : float
        Over the baselines; the spread is 1.48 times the median absolute deviation.
    sigma_deg : float
        Of the median.
    convention : Convention
        The one of `CONVENTIONS` that the baselines call for.
    follows : bool
        Whether the headings have to do with the course at all, in that convention.
    """

    heading: str
    gnss: str
    velocity: str | None
    n_baselines: int
    baseline_m: float
    median_deg: float
    spread_deg: float
    sigma_deg: float
    convention: Convention
    follows: bool


def heading_against_course(
    name: str, ways: Baselines, velocity: Velocity
) -> HeadingAgainstCourse | None:
    """Compare a compass, with what turns headings into a way, with the course over ground.

    Returns
    -------
    HeadingAgainstCourse or None
        None where the velocities cover too few baselines.
    """
    covered = ways.covered(velocity)
    n = int(np.sum(covered))
    if n < 2:
        return None
    compass = np.unwrap(ways.compass.heading)
    errors = np.array(
        [ways.direction_errors(c.applied(compass), velocity)[covered] for c in CONVENTIONS]
    )
    convention = best(losses(errors))
    median, spread = circular_median_and_spread(errors[convention])
    together = float(np.abs(np.mean(np.exp(1j * errors[convention]))))
    return HeadingAgainstCourse(
        heading=name,
        gnss=ways.gnss.name,
        velocity=None if velocity.name == BOW else velocity.name,
        n_baselines=n,
        baseline_m=ways.length_m,
        median_deg=float(np.degrees(median)),
        spread_deg=float(np.degrees(spread)),
        sigma_deg=float(np.degrees(1.2533 * spread / np.sqrt(n))),
        convention=CONVENTIONS[convention],
        # Rayleigh's test of directions that are spread over the whole circle
        follows=bool(n * together**2 > -np.log(FALSE_ALARM) or n <= -np.log(FALSE_ALARM)),
    )


def offset_limit_deg(course: HeadingAgainstCourse, stated_deg: float) -> float:
    """The largest median that noise and errors of the stated spread explain, deg."""
    return limit(course.sigma_deg, course.n_baselines - 1, stated_deg)


def heading_findings(
    course: HeadingAgainstCourse,
    stated_deg: float,
    blamed: Sequence[str],
    *,
    is_magnetic: bool = False,
) -> Iterator[Finding]:
    """Judge the comparison.

    Parameters
    ----------
    course : HeadingAgainstCourse
    stated_deg : float
        Spread of the offset that the cards allow.
    is_magnetic : bool
        Whether the compass's declination is that of its place and day: none can be stated.
    blamed : sequence of str
        Who else than the compass a contradiction may be due to; empty where it is the compass.
    """
    convention = course.convention
    read = (
        f"compass less {course.gnss} course: median {course.median_deg:+.1f} deg, "
        f"spread {course.spread_deg:.1f} deg over {course.n_baselines} baselines "
        f"of {course.baseline_m:.0f} m"
    )

    def warning(message: str, fix: str) -> Finding:
        return Finding("heading against course", course.heading, "warning", message, fix)

    or_else = "".join(f", or {name} is wrong" for name in blamed)
    limit_deg = offset_limit_deg(course, stated_deg)
    if not course.follows:
        yield warning(f"{read}; the heading does not follow the course", "")
    elif not convention.is_stated:
        message = f"{read}, if the headings count {convention.name}, which they seem to{or_else}"
        fix = convention.fix
        if course.gnss in blamed:
            fix += f", or in that of {course.gnss}: {convention.fix_of_fixes}"
        yield warning(message, fix)
    elif abs(course.median_deg) > limit_deg:
        message = f"{read}; noise and the stated biases explain {limit_deg:.1f} deg{or_else}"
        fix = f"noise: {{declination_deg: {-course.median_deg:+.1f}}} (added to what it has)"
        if is_magnetic:
            fix = fixes.heading_turned_by(round(-course.median_deg, 1))
        yield warning(message, fix)
    else:
        yield Finding("heading against course", course.heading, "ok", read)


def mirrored_fixes(course: HeadingAgainstCourse) -> Finding:
    """Where compass and gyro agree, and the fixes draw the way's reflection."""
    convention = course.convention
    message = (
        f"the way by fixes is the reflection of that by {course.heading}, as over "
        f"{course.n_baselines} baselines of {course.baseline_m:.0f} m: "
        f"{'north and east are exchanged' if abs(convention.turn_deg) == 90 else 'a sign is wrong'}"
    )
    return Finding("fixes mirrored", course.gnss, "warning", message, convention.fix_of_fixes)


def circular_median_and_spread(angles: Array) -> tuple[float, float]:
    """The sample that is nearest to all others along the circle, and 1.48 MAD about it."""
    distance = np.abs(wrap_angle(angles[:, None] - angles[None, :]))
    median = float(angles[int(np.argmin(np.sum(distance, axis=1)))])
    return median, 1.4826 * float(np.median(np.abs(wrap_angle(angles - median))))
