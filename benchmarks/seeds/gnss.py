"""[C] INS/GPS EKF with outlier rejection, on simulated laps with and without outliers."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.seeds.runs import Errors, Job, run_all
from benchmarks.seeds.table import Row, Spread, Table

PUBLISHED_RMS_M = ("0.7", "1.46", "0.71")
OUTLIERS = {
    "clean": (),
    # half of the outliers alone, half in bursts
    "10 % outliers": ("gnss:outliers=0.05,size=20:100", "gnss:outliers=0.05,size=20:100,burst=5"),
}


@dataclass(frozen=True)
class Variant:
    """A way to estimate the laps."""

    name: str
    method: str
    overrides: tuple[str, ...] = ()


VARIANTS = (
    Variant("dead reckoning (INS, no GNSS)", "ins-ekf", ("gnss.use=none",)),
    Variant("EKF without rejection", "ins-ekf", ("gnss.reject_outliers=false",)),
    Variant("EKF with rejection", "ins-ekf"),
    Variant("RTS smoother", "ins-ekf", ("ins_ekf.smooth=true",)),
    Variant("graph", "graph"),
)


def laps(seeds: int, workers: int) -> Table:
    """RMS error of each axis over the laps."""
    jobs = [
        Job(f"{v.name}, {name}", "laps", seed, v.method, v.overrides, faults)
        for name, faults in OUTLIERS.items()
        for v in VARIANTS
        for seed in range(seeds)
    ]
    found = run_all(jobs, workers)
    rows = [
        Row(label, _figures(runs), PUBLISHED_RMS_M if label.startswith("EKF with ") else ("",) * 3)
        for label, runs in found.items()
    ]
    return Table(
        f"[C] two laps: RMS error, m, {seeds} simulated missions",
        ("north", "east", "down", "3-D"),
        ("north", "east", "down"),
        tuple(rows),
        _verdict(found, seeds),
    )


def _figures(runs: list[Errors]) -> tuple[Spread, ...]:
    axes = tuple(Spread.of([r.rms[axis] for r in runs]) for axis in range(3))
    return (*axes, Spread.of([r.rms_3d for r in runs]))


def _verdict(found: dict[str, list[Errors]], seeds: int) -> str:
    """The ratios that say whether rejection works and whether the graph keeps up."""

    def rms(variant: str, name: str) -> list[float]:
        return [r.rms_3d for r in found[f"{variant}, {name}"]]

    def mean_ratio(a: list[float], b: list[float]) -> float:
        return sum(a) / sum(b)

    clean, dirty = OUTLIERS
    ekf = rms("EKF with rejection", dirty)
    clean_ekf = rms("EKF with rejection", clean)
    lines = [
        f"with outliers over without: {mean_ratio(ekf, clean_ekf):.3f} with rejection,"
        f" {mean_ratio(rms('EKF without rejection', dirty), clean_ekf):.1f} without",
    ]
    for name in OUTLIERS:
        graph = rms("graph", name)
        better = sum(g <= e for g, e in zip(graph, rms("EKF with rejection", name), strict=True))
        ratio = mean_ratio(graph, rms("RTS smoother", name))
        lines.append(
            f"{name}: graph no worse than the EKF in {better} of {seeds},"
            f" over the RTS smoother {ratio:.3f}"
        )
    return "\n".join(lines)
