"""The tests on several Pythons and dependencies: ``python -m benchmarks.versions``.

For each Python of the matrix that the machine has, the newest and the lowest versions that
``pyproject.toml`` allows are installed into an environment of their own, which is thrown away
after the fast tests. The lowest are the lower bounds themselves. ``--pin`` writes the newest ones,
where all tests passed, into a file of constraints: names and versions, nothing else.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
NEWEST, LOWEST = "newest", "lowest"
PROJECT = "gtsam-nav"
EXTRAS = {NEWEST: "test,mutation", LOWEST: "test"}
"""The newest are those of the long checks too."""
BUILD_TOOLS = {"pip", "setuptools", "wheel"}
"""What an environment brings by itself."""
SELECTED = ("-q", "-m", "not slow and not realdata", "-p", "no:cacheprovider")

INSTALLED = """
import json, sys
from importlib.metadata import PackageNotFoundError, distribution
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
project, wanted = sys.argv[1:]
found, open_ = {}, [(project, wanted.split(","))]
while open_:
    name, extras = open_.pop()
    try:
        have = distribution(name)
    except PackageNotFoundError:
        continue
    if canonicalize_name(name) in found:
        continue
    found[canonicalize_name(name)] = have.version
    for text in have.requires or ():
        need = Requirement(text)
        if need.marker is None or any(need.marker.evaluate({"extra": e}) for e in (*extras, "")):
            open_.append((need.name, tuple(need.extras)))
del found[project]
print(json.dumps(found))
"""
"""What an environment holds of the package's own requirements, however deep."""


@dataclass(frozen=True)
class Outcome:
    """One place of the matrix; ``failed`` says what about it did."""

    python: str
    bound: str
    result: str
    seconds: float
    versions: Mapping[str, str]
    failed: Sequence[str] = ()


def lower_bounds(pyproject: Path) -> list[str]:
    """The lower bound of each direct dependency as a constraint.

    Raises
    ------
    ValueError
        Where one has none.
    """
    project = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"]
    requirements = [*project["dependencies"], *project["optional-dependencies"][EXTRAS[LOWEST]]]
    lines = []
    for requirement in requirements:
        needed, _, marker = requirement.partition(";")
        match = re.match(r"([\w.-]+)(?:\[[^]]*\])?\s*>=\s*([\w.]+)", needed)
        if match is None:
            raise ValueError(f"'{requirement}' states no lower bound")
        lines.append(f"{match[1]}=={match[2]}" + (f"; {marker.strip()}" if marker else ""))
    return lines


def pinned(versions: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Constraints of all packages; those that differ between Pythons say for which they are.

    Parameters
    ----------
    versions : mapping of str to mapping of str to str
        By Python's version, the version of each package.
    """
    lines = []
    for name in sorted({n for have in versions.values() for n in have} - BUILD_TOOLS):
        found = {python: have[name] for python, have in versions.items() if name in have}
        if len(set(found.values())) == 1:
            lines.append(f"{name}=={next(iter(found.values()))}")
        else:
            lines += [f'{name}=={v}; python_version == "{p}"' for p, v in sorted(found.items())]
    return lines


def interpreter(version: str) -> str | None:
    """A Python of this version, on the path or among those of pyenv; None where there is none."""
    ours = Path.home() / ".pyenv" / "versions"
    candidates = [f"python{version}", *map(str, sorted(ours.glob(f"{version}.*/bin/python")))]
    for candidate in candidates:
        path = shutil.which(candidate)
        told = path and run([path, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"])
        if path and told and told.stdout.strip() == version:
            return path
    return None


def run(command: Sequence[str | Path]) -> subprocess.CompletedProcess[str]:
    """A command, its output kept."""
    return subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, cwd=REPOSITORY
    )


def attempt(python: str, path: str, bound: str, place: Path) -> Outcome:
    """Install, test and throw away."""
    begin = time.perf_counter()
    environment = place / f"{python}-{bound}"
    own = environment / "bin" / "python"

    def outcome(
        result: str, versions: Mapping[str, str] | None = None, failed: Sequence[str] = ()
    ) -> Outcome:
        shutil.rmtree(environment, ignore_errors=True)
        seconds = time.perf_counter() - begin
        return Outcome(python, bound, result, seconds, versions or {}, failed)

    options: list[str | Path] = []
    if bound == LOWEST:
        constraints = place / "lowest.txt"
        constraints.write_text("\n".join(lower_bounds(REPOSITORY / "pyproject.toml")) + "\n")
        options = ["--constraint", constraints]
    for command in (
        [path, "-m", "venv", environment],
        [own, "-m", "pip", "install", "--quiet", *options, f"{REPOSITORY}[{EXTRAS[bound]}]"],
    ):
        done = run(command)
        if done.returncode:
            # pip ends with a hint to look above
            said = [line for line in done.stderr.splitlines() if line.strip()]
            return outcome("not installed", failed=said[-8:])
    versions = json.loads(run([own, "-c", INSTALLED, PROJECT, EXTRAS[bound]]).stdout)
    tests = run([own, "-m", "pytest", *SELECTED, "tests"])
    if tests.returncode == 0:
        return outcome("passed", versions)
    return outcome(last_line(tests.stdout or tests.stderr), versions, failures(tests.stdout))


def failures(text: str) -> list[str]:
    """What pytest's summary says of each test that failed."""
    return [line for line in text.splitlines() if line.startswith(("FAILED ", "ERROR "))]


def last_line(text: str) -> str:
    """The last line that says something."""
    return next((line for line in reversed(text.splitlines()) if line.strip()), "no word")


def main() -> None:
    """Go through the matrix, and print it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.versions", description=__doc__)
    parser.add_argument("--python", nargs="+", default=PYTHONS, help="versions, as in 3.12")
    parser.add_argument("--bounds", nargs="+", default=(NEWEST, LOWEST), choices=(NEWEST, LOWEST))
    parser.add_argument("--place", type=Path, help="where the environments go, 3 GB each")
    parser.add_argument("--pin", type=Path, help="write the newest versions here if all pass")
    arguments = parser.parse_args()
    if arguments.place is not None:
        arguments.place.mkdir(parents=True, exist_ok=True)
    outcomes = []
    print(f"{'python':8}{'versions':10}{'seconds':>8}  tests")
    with tempfile.TemporaryDirectory(dir=arguments.place) as made:
        for python in arguments.python:
            path = interpreter(python)
            for bound in arguments.bounds:
                if path is None:
                    print(f"{python:8}{bound:10}{'-':>8}  not on this machine")
                    continue
                outcome = attempt(python, path, bound, Path(made))
                print(f"{python:8}{bound:10}{outcome.seconds:8.0f}  {outcome.result}", flush=True)
                for line in outcome.failed:
                    print(f"  {line}", flush=True)
                outcomes.append(outcome)
    failed = [outcome for outcome in outcomes if outcome.result != "passed"]
    if arguments.pin and not failed:
        newest = {o.python: o.versions for o in outcomes if o.bound == NEWEST}
        arguments.pin.write_text("\n".join(pinned(newest)) + "\n", encoding="utf-8")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
