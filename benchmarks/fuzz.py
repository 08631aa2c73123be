"""Hostile files for every reader: ``python -m benchmarks.fuzz --cases 100000``.

Each format's sample (`tests/readers/samples.py`) is damaged, spliced and rewritten
(`tests/hostile.py`), and read. Only the package's own errors may come of it. A process of its own
reads the cases of a subject with a bound on its memory; one that dies or takes too long is replaced
after the case. A case is told by its subject, seed and number alone: ``--only NAME --first K
--cases 1`` repeats it. What was found is written to ``--keep DIR`` with its files.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import logging
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path
from random import Random

from gtsam_nav.errors import GtsamNavError

REPOSITORY = Path(__file__).parents[1]
# the samples are those of the tests
sys.path[:0] = [str(REPOSITORY / "tests"), str(REPOSITORY / "tests" / "readers")]

HANG_S = 5
"""Most processor time of a case: a busy machine is no hang."""
BLOCKED_S = 60.0
"""Most time that a case may wait for whatever it is."""
MOST_MEMORY_MB = 1000
"""What a case may take beside what its process held before the first one."""
WORKER = "--worker"
NUMBER, CASE = "number", "case"
"""Beside each other in a worker's folder: the case that it is at, and that case's files."""


@dataclass(frozen=True)
class Finding:
    """A case that ended otherwise than it may."""

    subject: str
    case: int
    kind: str
    what: str


def work(name: str, seed: int, first: int, count: int, place: Path) -> None:
    """Read the cases of a subject one after the other; findings are lines of JSON on stdout."""
    from hostile import hostile
    from samples import SUBJECTS, files_of, write_files

    warnings.simplefilter("ignore")
    logging.disable()
    subject = SUBJECTS[name]
    sample = place / "sample"
    sample.mkdir()
    opened = subject.make(sample).relative_to(sample)
    files = files_of(sample)
    subject.read(sample / opened)
    bound_memory()
    held_mb = peak_mb()
    faulthandler.register(signal.SIGXCPU, chain=True)
    case = place / CASE
    for number in range(first, first + count):
        (place / NUMBER).write_text(str(number))
        shutil.rmtree(case, ignore_errors=True)
        case.mkdir()
        write_files(case, hostile(files, Random(f"{name} {seed} {number}")), subject.mend)
        bound_time()
        faulthandler.dump_traceback_later(BLOCKED_S, exit=True)
        try:
            subject.read(case / opened)
        except GtsamNavError:
            pass
        except Exception as error:  # noqa: BLE001  the findings
            tell(Finding(name, number, type(error).__name__, shortened(error)), case)
        faulthandler.cancel_dump_traceback_later()
        if peak_mb() - held_mb > MOST_MEMORY_MB:
            grown = f"{peak_mb() - held_mb:.0f} MB"
            held_mb = peak_mb()
            tell(Finding(name, number, "memory", grown), case)


def bound_memory() -> None:
    """Let no case have more than its share: what asks for it gets a MemoryError."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + 2 * MOST_MEMORY_MB * 10**6
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def bound_time() -> None:
    """Let the next case end this process where it takes too much of the processor."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    until = int(used.ru_utime + used.ru_stime) + HANG_S + 1
    resource.setrlimit(resource.RLIMIT_CPU, (until, hard))


def peak_mb() -> float:
    """Most memory that this process has held, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1.024e-3


def shortened(error: BaseException) -> str:
    """The error, and where in the package and in its libraries it arose."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "gtsam_nav" in f.filename]
    places = [f"{Path(f.filename).name}:{f.lineno}" for f in (*ours[-1:], frames[-1])]
    return f"{' < '.join(dict.fromkeys(places))}: {' '.join(str(error).split())[:200]}"


def tell(finding: Finding, case: Path) -> None:
    """Print a finding and keep its files beside the cases."""
    print(json.dumps(asdict(finding)), flush=True)
    shutil.copytree(case, case.with_name(f"found-{finding.case}"), dirs_exist_ok=True)


def fuzz(name: str, seed: int, first: int, count: int, keep: Path | None) -> Iterator[Finding]:
    """All findings among the cases of a subject, whatever becomes of the processes."""
    stop = first + count
    while first < stop:
        # in memory, where there is such a place: most of a case is writing its files
        shared = Path("/dev/shm")  # nosec B108: mkdtemp makes a folder of its own in it
        with tempfile.TemporaryDirectory(
            prefix="fuzz-", dir=shared if os.access(shared, os.W_OK) else None
        ) as made:
            place = Path(made)
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "benchmarks.fuzz", WORKER, name, str(seed)),
                    *(str(first), str(stop - first), str(place)),
                ],
                capture_output=True,
                text=True,
                errors="replace",
                cwd=REPOSITORY,
            )
            found = [Finding(**json.loads(x)) for x in done.stdout.splitlines() if x[:1] == "{"]
            number = place / NUMBER
            if done.returncode and not number.is_file():
                raise RuntimeError(
                    f"{name}: the sample itself cannot be read: {done.stderr[-2000:]}"
                )
            first = stop
            if done.returncode:
                first = int(number.read_text()) + 1
                hang = done.returncode == -signal.SIGXCPU or "Timeout (" in done.stderr
                what = " ".join(done.stderr.split())[-400:]
                found.append(Finding(name, first - 1, "hang" if hang else "crash", what))
                (place / CASE).rename(place / f"found-{first - 1}")
            for finding in found:
                source = place / f"found-{finding.case}"
                if keep is not None and source.is_dir():
                    target = keep / f"{name}-{finding.case}".replace(" ", "_")
                    shutil.copytree(source, target, dirs_exist_ok=True)
                yield finding


def main() -> None:
    """Fuzz the subjects, and print what was found."""
    if sys.argv[1:2] == [WORKER]:
        name, seed, first, count, place = sys.argv[2:]
        work(name, int(seed), int(first), int(count), Path(place))
        return
    from samples import SUBJECTS

    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=2000, help="of all subjects together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--only", default="", help="subjects whose name contains this")
    parser.add_argument("--keep", type=Path, help="put the files of what is found here")
    parser.add_argument("--json", type=Path, help="write the findings here")
    arguments = parser.parse_args()
    exact = [name for name in SUBJECTS if name == arguments.only]
    chosen = {n: SUBJECTS[n] for n in exact or SUBJECTS if arguments.only in n}
    if not chosen:
        parser.error(f"no such subject; the choices are: {', '.join(SUBJECTS)}")
    whole = sum(subject.share for subject in chosen.values())
    findings: list[Finding] = []
    total = 0
    print(f"{'subject':24}{'cases':>8}{'seconds':>9}  findings")
    for name, subject in chosen.items():
        count = ceil(arguments.cases * subject.share / whole)
        total += count
        begin = time.perf_counter()
        found = list(fuzz(name, arguments.seed, arguments.first, count, arguments.keep))
        findings += found
        kinds = ", ".join(f"{n} x {kind}" for kind, n in Counter(f.kind for f in found).items())
        print(f"{name:24}{count:8}{time.perf_counter() - begin:9.1f}  {kinds or '-'}", flush=True)
    for finding in findings:
        print(f"{finding.subject} case {finding.case}: {finding.kind}: {finding.what}")
    print(f"{total} cases, {len(findings)} findings")
    if arguments.json:
        document = [asdict(f) for f in findings]
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    sys.exit(bool(findings))


if __name__ == "__main__":
    main()
