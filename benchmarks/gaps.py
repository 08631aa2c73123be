"""How far a vehicle strays while its fixes are withheld.

``python -m benchmarks.gaps FOLDER [--json FILE]`` drives the RTK car (``rtk_mems_car``) with eight
gaps of 15 s in its fixes and prints the horizontal error against the withheld ones: of the causal
filter at the end of each gap, of the smoothers at its middle.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import gtsam_nav as gn
from gtsam_nav.mission import Mission
from gtsam_nav.series import GnssSeries
from gtsam_nav.trajectory import Trajectory

STARTS_S = (60, 115, 170, 225, 280, 340, 430, 490)
"""Of the gaps, after the first fix."""
GAP_S = 15.0


@dataclass(frozen=True)
class Strayed:
    """Horizontal errors of one estimate, m, a value a gap."""

    label: str
    moment: str
    error_m: tuple[float, ...]

    def text(self) -> str:
        """One line of the table."""
        median, worst = np.median(self.error_m), max(self.error_m)
        each = " ".join(f"{e:.2f}" for e in self.error_m)
        return f"{self.label:<34} {self.moment:<6} {median:6.2f} {worst:6.2f}   {each}"


def fixes_of(mission: Mission) -> GnssSeries:
    """The fixes of a mission's first receiver."""
    receiver = mission.first("gnss")
    assert receiver is not None
    assert isinstance(receiver.series, GnssSeries)
    return receiver.series


def gaps_of(mission: Mission) -> list[tuple[float, float]]:
    """The spans, s, in which the fixes are withheld."""
    first = float(fixes_of(mission).t[0])
    return [(first + a, first + a + GAP_S) for a in STARTS_S]


def strayed_m(mission: Mission, trajectory: Trajectory, share: float) -> tuple[float, ...]:
    """Distance to the withheld fix at a share of each gap."""
    receiver, fixes = mission.first("gnss"), fixes_of(mission)
    assert receiver is not None
    withheld = [np.flatnonzero((fixes.t >= a) & (fixes.t < b)) for a, b in gaps_of(mission)]
    k = np.array([gap[round(share * (len(gap) - 1))] for gap in withheld])
    antenna = trajectory.interpolate(fixes.t[k]).at_lever_arm(receiver.xyz_b)
    return tuple(np.linalg.norm((antenna.p_n - fixes.p_n[k])[:, :2], axis=1).tolist())


def run(mission: Mission, method: str, *overrides: str) -> gn.Solution:
    """Estimate the mission without the fixes of the gaps."""
    gaps = [list(gap) for gap in gaps_of(mission)]
    config = gn.load_config(None, ("gnss.use=gaps", f"gnss.gaps_s={gaps}", *overrides))
    return gn.estimate(mission, method, config)


def strays(mission: Mission) -> list[Strayed]:
    """All rows of the table."""
    rows = []
    for wheels, label in (("false", "plain"), ("true", "non-holonomic")):
        constrained = f"motion.nonholonomic={wheels}"
        smoothed = run(mission, "ins-ekf", constrained, "ins_ekf.smooth=true")
        assert smoothed.online is not None
        graph = run(mission, "graph", constrained)
        rows += [
            Strayed(f"ins-ekf, {label}", "end", strayed_m(mission, smoothed.online, 1.0)),
            Strayed(
                f"ins-ekf smoothed, {label}", "middle", strayed_m(mission, smoothed.trajectory, 0.5)
            ),
            Strayed(f"graph, {label}", "middle", strayed_m(mission, graph.trajectory, 0.5)),
        ]
    return rows


def main() -> None:
    """Print the table, and write it as JSON where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gaps", description=__doc__)
    parser.add_argument("folder", type=Path, help="rtk_mems_car")
    parser.add_argument("--json", type=Path, help="write the errors here")
    arguments = parser.parse_args()
    rows = strays(gn.open_mission(arguments.folder))
    print(f"{'':<34} {'gap':<6} {'median':>6} {'worst':>6}   each, m")
    for row in rows:
        print(row.text())
    if arguments.json:
        text = json.dumps([asdict(row) for row in rows], indent=2) + "\n"
        arguments.json.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
