"""[A] An INS aided by EKF-SLAM on landmarks, on simulated missions of that sensor class."""

from __future__ import annotations

from benchmarks.seeds.runs import Job, run_all
from benchmarks.seeds.table import Row, Spread, Table

PUBLISHED_RUNS = (
    # end of the run (x, y), error of the INS, error of the INS aided by SLAM; m
    ("0.04, 0.43", 0.06, 0.03),
    ("0.02, 0.54", 0.09, 0.06),
    ("-0.07, 0.70", 0.26, 0.19),
    ("-0.02, 0.58", 0.14, 0.03),
    ("0.10, 0.69", 0.01, 0.04),
)
PUBLISHED_MEAN = (0.112, 0.070)
PUBLISHED_SUBMARINE_M = 650.0
METHODS = ("ins-ekf", "landmark-ekf", "graph")


def five_runs(seeds: int, workers: int) -> Table:
    """Error at the end of the five tracks of the paper's table, each simulated so many times."""
    tracks = len(PUBLISHED_RUNS)
    jobs = [
        Job(f"{method} {k % tracks}", "ranger", k, method)
        for k in range(seeds * tracks)
        for method in METHODS
    ]
    found = run_all(jobs, workers)
    ends = {label: [e.end_horizontal for e in runs] for label, runs in found.items()}
    rows = [
        Row(
            f"run {k + 1}, end at {place}",
            tuple(Spread.of(ends[f"{method} {k}"]) for method in METHODS),
            (f"{ins:.2f}", f"{slam:.2f}"),
        )
        for k, (place, ins, slam) in enumerate(PUBLISHED_RUNS)
    ]
    means = [[x for k in range(tracks) for x in ends[f"{method} {k}"]] for method in METHODS]
    rows.append(
        Row("mean", tuple(map(Spread.of, means)), tuple(f"{x:.3f}" for x in PUBLISHED_MEAN))
    )
    return Table(
        f"[A] error at the end of the track, m, {seeds} simulated runs a track",
        METHODS,
        ("INS", "INS-SLAM"),
        tuple(rows),
        "Simulated sensors of the paper's class; the published runs were real ones.",
    )


def submarine(seeds: int, workers: int) -> Table:
    """Position error of a submarine's INS over half an hour, with and without landmarks."""
    jobs = [Job(m, "submarine", k, m) for k in range(seeds) for m in METHODS]
    found = run_all(jobs, workers)
    rows = [
        Row(
            method,
            (
                Spread.of([e.end_horizontal for e in found[method]]),
                Spread.of([e.mean_horizontal for e in found[method]]),
            ),
            (f"{PUBLISHED_SUBMARINE_M:.0f}" if method == "ins-ekf" else "",),
        )
        for method in METHODS
    ]
    return Table(
        f"[A] submarine, 30 min, {seeds} simulated runs",
        ("error at the end, m", "mean over the run, m"),
        ("after 30 min",),
        tuple(rows),
    )
