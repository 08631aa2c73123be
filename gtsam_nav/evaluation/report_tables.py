"""The report's tables: from typed scores to rows of text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gtsam_nav.evaluation.alignment import ALIGNMENTS
from gtsam_nav.evaluation.consistency import Consistency
from gtsam_nav.evaluation.html import Html, element, join, table
from gtsam_nav.evaluation.metrics import Metrics
from gtsam_nav.evaluation.plots.style import method_colour
from gtsam_nav.evaluation.relative import RelativeError
from gtsam_nav.evaluation.statistics import AbsoluteErrors, ErrorStatistics
from gtsam_nav.evaluation.weakness import weak_stretches
from gtsam_nav.solution import Solution
from gtsam_nav.writers.run_record import RunRecord

ByMethod = Mapping[str, Metrics]
Row = tuple[str, ...]

DASH = "–"
ALIGNED = {"none": "no alignment", "start": "start", "se2": "SE(2)", "se3": "SE(3)"}
STATISTICS = ("mean", "rmse", "median", "std", "min", "max", "p95")


def number(value: float | None, digits: int = 2) -> str:
    """A figure for a cell; a dash for what cannot be told."""
    return DASH if value is None else f"{value:.{digits}f}"


def summary_table(metrics: ByMethod, records: Mapping[str, RunRecord]) -> Html:
    """All methods side by side, with the causal estimate of those that have one."""
    header = (
        *("method", "mean", "rmse", "max", "mean", "mean"),
        *("rpe 10 m (%)", "NEES", "coverage", "loops", "wall (s)"),
    )
    rows: list[Row] = []
    for name, m in metrics.items():
        record = records.get(name)
        rpe = m.rpe.per_10_m
        rest = (
            number(rpe.percent if rpe else None, 1),
            number(m.nees.mean if m.nees else None),
            number(m.coverage, 3),
            f"{m.loops.accepted} of {m.loops.proposed}" if m.loops.proposed else DASH,
            number(record.wall_s if record else None, 1),
        )
        rows.append((_with_dot(name), *_headline(m.ate), *rest))
        if m.ate_online is not None:
            causal = _with_dot(name, ", causal")
            rows.append((causal, *_headline(m.ate_online), *[DASH] * len(rest)))
    groups = (("", 1), ("no alignment (m)", 3), ("start (m)", 1), ("SE(2) (m)", 1), ("", 5))
    return table(header, rows, groups)


def _with_dot(method: str, more: str = "") -> Html:
    """A method's name behind a dot in its colour."""
    dot = element("span", class_="dot", style=f"background:{method_colour(method)}")
    return join([dot, method, more])


def _headline(ate: AbsoluteErrors) -> Row:
    none, start, se2 = ate.none, ate.start, ate.se2
    return (
        number(none.mean if none else None),
        number(none.rmse if none else None),
        number(none.max if none else None),
        number(start.mean if start else None),
        number(se2.mean if se2 else None),
    )


def error_table(metrics: ByMethod) -> Html:
    """Every alignment and statistic of the absolute error, m."""
    rows: list[Row] = []
    for name, m in metrics.items():
        rows += _error_rows(name, m.ate)
        if m.ate_3d is not None:
            rows += _error_rows(f"{name}, 3-D", m.ate_3d)
        if m.ate_online is not None:
            rows += _error_rows(f"{name}, causal", m.ate_online)
    return table(("method", "alignment", *STATISTICS), rows, names=2)


def _error_rows(name: str, ate: AbsoluteErrors) -> Iterator[Row]:
    for alignment in ALIGNMENTS:
        e: ErrorStatistics | None = getattr(ate, alignment)
        figures = (number(None if e is None else getattr(e, key)) for key in STATISTICS)
        yield name, ALIGNED[alignment], *figures
        name = ""


def drift_table(metrics: ByMethod) -> Html:
    """Relative errors, drift at the end, and heading error."""
    header = ("method", *("%", "deg/m") * 3, "% of distance", "mean", "rmse", "max")
    rows = []
    for name, m in metrics.items():
        segments = (m.rpe.per_10_m, m.rpe.per_50_m, m.rpe.per_10_percent)
        heading = m.heading_error_deg
        rows.append(
            (
                name,
                *(figure for segment in segments for figure in _relative(segment)),
                number(m.drift_percent),
                *(
                    number(None if heading is None else getattr(heading, key))
                    for key in ("mean", "rmse", "max")
                ),
            )
        )
    spans = ("over 10 m", 2), ("over 50 m", 2), ("over 10 % of the path", 2)
    groups = (("", 1), *spans, ("error at the end", 1), ("heading error (deg)", 3))
    return table(header, rows, groups)


def _relative(error: RelativeError | None) -> Row:
    if error is None:
        return DASH, DASH
    return number(error.percent), number(error.deg_per_m, 3)


def consistency_table(metrics: ByMethod) -> Html:
    """NEES of the position and NIS of each sensor's updates against chi-square."""
    header = ("method", "of", "mean", "expected", "95 % of samples lie in", "inside")
    rows: list[Row] = []
    for name, m in metrics.items():
        found = [(f"{sensor} (NIS)", c) for sensor, c in m.nis.items()]
        if m.nees is not None:
            found.insert(0, ("position (NEES)", m.nees))
        for k, (what, c) in enumerate(found):
            rows.append(("" if k else name, what, *_consistency(c)))
    return table(header, rows, names=2)


def _consistency(c: Consistency) -> Row:
    bounds = f"{c.lower95:.2f} to {c.upper95:.2f}"
    return number(c.mean), str(c.dof), bounds, f"{100 * c.fraction_inside:.0f} %"


def rejection_table(solutions: Sequence[Solution]) -> Html:
    """Measurements that were not used, by sensor and reason."""
    counts = [Counter((r.sensor, _kind(r.reason)) for r in s.rejections) for s in solutions]
    kinds = sorted(set().union(*counts))
    rows = [(sensor, reason, *(str(c[sensor, reason]) for c in counts)) for sensor, reason in kinds]
    return table(("sensor", "reason", *(s.method for s in solutions)), rows, names=2)


def _kind(reason: str) -> str:
    """A reason without its figures, so that equal kinds count together."""
    return re.sub(r"(?<!\w)[-+]?\d+(\.\d+)?", "…", reason)


def loop_table(solution: Solution) -> Html:
    """Candidate loops by verdict and reason."""
    counts = Counter((loop.verdict, _kind(loop.reason) or DASH) for loop in solution.loops)
    rows = [(verdict, reason, str(n)) for (verdict, reason), n in sorted(counts.items())]
    return table(("verdict", "reason", "loops"), rows, names=2)


def weight_table(solutions: Sequence[Solution]) -> Html:
    """What kernels and gates left of each sensor's measurements at the solution."""
    header = (
        *("method", "sensor", "kernel", "measurements", "left out (%)"),
        *("weight below 0.5 (%)", "mean weight", "median residual (sigma)"),
    )
    rows = []
    for s in solutions:
        for k, (sensor, own) in enumerate(s.robust_weights.items()):
            shares = (np.mean(own.weight == 0.0), np.mean(own.weight < 0.5))
            rows.append(
                (
                    *("" if k else s.method, sensor, own.kernel, str(len(own.t))),
                    *(number(100 * float(share), 1) for share in shares),
                    number(float(np.mean(own.weight))),
                    number(float(np.median(own.residual))),
                )
            )
    return table(header, rows, names=3)


def gnss_table(metrics: ByMethod) -> Html:
    """Fixes that were measurements, and fixes that no estimator saw."""
    rows = [(name, str(m.gnss_used), str(m.gnss_withheld)) for name, m in metrics.items()]
    return table(("method", "fixes used", "fixes withheld"), rows)


def relation_table(metrics: ByMethod) -> Html:
    """Errors on surveyed relations."""
    header = (
        "method",
        "relations",
        "number",
        "median (m)",
        "95 % (m)",
        "median (deg)",
        "95 % (deg)",
    )
    rows = [
        (
            *(name, kind, str(e.n)),
            *(number(f, 3) for f in (e.median_m, e.p95_m, e.median_deg, e.p95_deg)),
        )
        for name, m in metrics.items()
        if m.relations is not None
        for kind, e in (("near", m.relations.near), ("loops", m.relations.loops))
        if e is not None
    ]
    return table(header, rows, names=2)


def clock_table(metrics: ByMethod) -> Html:
    """Timing errors that were estimated."""
    rows = [
        (
            *(name, o.sensor, o.quantity.replace("_", " ")),
            *(number(o.offset_s, 4), number(o.sigma_s, 4), "yes" if o.observed else "no"),
        )
        for name, m in metrics.items()
        for o in m.clock_offsets
    ]
    header = ("method", "sensor", "of its", "to be added (s)", "sigma (s)", "observed")
    return table(header, rows, names=3)


def timing_table(records: Mapping[str, RunRecord]) -> Html:
    """Wall time of each run and of its stages, s."""
    stages = list(dict.fromkeys(stage for r in records.values() for stage in r.stage_s))
    rows = [
        (
            name,
            number(r.mission_s, 1),
            number(r.wall_s, 1),
            number(r.realtime_factor, 0),
            *(number(r.stage_s.get(stage)) for stage in stages),
        )
        for name, r in records.items()
    ]
    groups = (("", 4), ("stages (s)", len(stages))) if stages else ()
    return table(("method", "mission (s)", "wall (s)", "× real time", *stages), rows, groups)


def source_table(record: RunRecord) -> Html:
    """Files that were read, with their checksums."""
    return table(("file", "SHA-256"), sorted(record.sources.items()), names=2)


def weak_table(solutions: Sequence[Solution]) -> Html:
    """Stretches whose position is unsure, and what was missing there; or that there are none."""
    header = (
        "method",
        "from (s)",
        "to (s)",
        "largest sigma (m)",
        "along (deg)",
        "what was missing",
    )
    rows: list[Row] = [
        (
            _with_dot(solution.method),
            number(stretch.begin_s, 0),
            number(stretch.end_s, 0),
            number(stretch.sigma_m),
            number(stretch.azimuth_deg, 0),
            "; ".join(stretch.causes) or DASH,
        )
        for solution in solutions
        for stretch in weak_stretches(solution)
    ]
    if not rows:
        return element("p", "No stretch stands out.", class_="note")
    return table(header, rows)
