"""Does the audit find the classic mistakes, and nothing else?

``python -m benchmarks.audit [--seeds N] [--clean N] [--first-seed N] [--only WORD] [--json FILE]``
makes each mistake of `benchmarks.mistakes` in simulated missions of N seeds and counts in how many
the audit names the sensor and the fix; then it audits N clean missions of all simulations and lists
what it says there.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import gtsam_nav as gn
from benchmarks.mistakes import MISTAKES, Mistake
from gtsam_nav.audit import Audit, audit
from gtsam_nav.audit.findings import Finding
from gtsam_nav.audit.timing import TIMING_CHECKS
from gtsam_nav.simulation.simulator import SCENARIOS


@dataclass(frozen=True)
class Row:
    """How often a mistake was found; ``missed`` are the seeds, ``beside`` other warnings."""

    mistake: str
    scenario: str
    found: int
    seeds: int
    missed: tuple[int, ...]
    beside: tuple[str, ...]
    audit_s: float


@dataclass(frozen=True)
class FalseAlarm:
    """A warning on a clean mission."""

    mission: str
    text: str


def names(finding: Finding, mistake: Mistake) -> bool:
    """Whether a finding is of the mistake, and its fix is the mistake's."""
    return (
        finding.severity == "warning"
        and (finding.check, finding.sensor) == (mistake.check, mistake.sensor)
        and mistake.fix in finding.fix
    )


def warnings(found: Audit) -> Iterator[Finding]:
    """What an audit warns of, silence and lost bottom lock (as simulated) aside."""
    for finding in found.findings:
        if finding.severity == "warning" and finding.check not in (*TIMING_CHECKS, "bottom lock"):
            yield finding


def row(mistake: Mistake, seeds: range) -> Row:
    """Make a mistake in the missions of some seeds."""
    missed, beside, spent_s = [], set(), 0.0
    for seed in seeds:
        mission = mistake.mission(seed)
        begin = time.perf_counter()
        found = list(warnings(audit(mission)))
        spent_s += time.perf_counter() - begin
        if not any(names(finding, mistake) for finding in found):
            missed.append(seed)
        beside |= {f"{f.sensor}: {f.check}" for f in found if not names(f, mistake)}
    return Row(
        mistake=mistake.name,
        scenario=mistake.scenario,
        found=len(seeds) - len(missed),
        seeds=len(seeds),
        missed=tuple(missed),
        beside=tuple(sorted(beside)),
        audit_s=spent_s / max(len(seeds), 1),
    )


def false_alarms(missions: int, first_seed: int) -> Iterator[FalseAlarm]:
    """What is said of clean missions, all simulations in turn."""
    for k in range(missions):
        scenario = list(SCENARIOS)[k % len(SCENARIOS)]
        mission = gn.simulate(scenario, first_seed + k)
        for finding in warnings(audit(mission)):
            yield FalseAlarm(mission.name, f"{finding.sensor}: {finding.check}: {finding.text}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="missions with each mistake")
    parser.add_argument("--clean", type=int, default=20, help="missions without one")
    parser.add_argument("--first-seed", type=int, default=0, help="the clean ones' is 1000 more")
    parser.add_argument("--only", default="", help="mistakes whose name holds this")
    parser.add_argument("--json", type=Path, help="write the figures here")
    arguments = parser.parse_args()

    rows, first = [], arguments.first_seed
    for mistake in MISTAKES:
        if arguments.only in mistake.name:
            rows.append(row(mistake, range(first, first + arguments.seeds)))
            r = rows[-1]
            missed = f" missed {', '.join(map(str, r.missed))}" if r.missed else ""
            beside = f" beside: {'; '.join(r.beside)}" if r.beside else ""
            print(
                f"{r.mistake:26s} {r.scenario:8s} {r.found:3d} / {r.seeds:<3d} "
                f"{r.audit_s:5.2f} s{missed}{beside}",
                flush=True,
            )
    alarms = list(false_alarms(arguments.clean, first + 1000))
    print(f"\n{arguments.clean} clean missions: {len(alarms)} false alarms")
    for alarm in alarms:
        print(f"  {alarm.mission}: {alarm.text}")
    if arguments.json:
        document = {
            "mistakes": [asdict(r) for r in rows],
            "clean": arguments.clean,
            "false_alarms": [asdict(alarm) for alarm in alarms],
        }
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
