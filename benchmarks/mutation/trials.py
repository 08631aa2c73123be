"""Runs tests against a mutant in a forked process: the files of the project stay as they are."""

from __future__ import annotations

import importlib.abc
import importlib.util
import math
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from importlib.machinery import ModuleSpec, SourceFileLoader
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType

import pytest
from hypothesis import Phase, settings

PRELOADED = ("numpy", "scipy.stats", "scipy.spatial", "numba", "gtsam", "open3d", "hypothesis")
"""Imported once for all the trials; never the package itself, which each of them mutates."""
PLAIN_KERNELS = {
    "_peaks": ("tests/sonar/test_echoes.py",),
    "_pic_information": ("tests/registration/test_pic.py", "tests/registration/test_response.py"),
    "_pic_kernel": ("tests/registration/test_pic.py",),
    "_rays": ("tests/sonar/test_occupancy.py",),
}
"""Kernels that are quick enough as plain Python for their own tests: their mutants need not be
compiled. Those of others are, each anew."""
FROZEN = "tests/test_structure.py::test_data_of_the_estimation_core_is_frozen"

BLOCKED_S = 1800.0
"""Most time that a trial may wait for whatever it is."""
SPENT = "processor_s"
"""In a trial's folder: what it took of the processor [s]."""

PYTEST = (
    *("-q", "-x", "-m", "not slow and not realdata"),
    *("-p", "no:cacheprovider", "--disable-plugin-autoload"),
)

_CONTEXT = get_context("forkserver")
_CONTEXT.set_forkserver_preload(list(PRELOADED))


@dataclass(frozen=True)
class Mutant:
    """One change to one module.

    Attributes
    ----------
    path : Path
        Of the module, from the root of the project.
    operator : str
        cosmic-ray's name of the kind of change.
    line : int
        First line that differs, from 1.
    source : str
        The whole module, changed.
    diff : str
        Its lines that differ, before and after.
    """

    path: Path
    operator: str
    line: int
    source: str
    diff: str


class Fate(Enum):
    """What became of a mutant."""

    SURVIVED = "survived"
    FAILED = "failed a test"
    HUNG = "took too long"


def mirroring_tests(path: Path) -> tuple[str, ...]:
    """Tests that mirror a module, those of its name first: most mutants die there. The last is the
    house's rule for the data of its package.

    Parameters
    ----------
    path : Path
        ``gtsam_nav/PACKAGE/.../NAME.py``.

    Returns
    -------
    tuple of str
        Arguments to pytest.
    """
    if path.stem in PLAIN_KERNELS:
        return PLAIN_KERNELS[path.stem]
    folder = Path("tests", path.parts[1])
    named = sorted(folder.glob(f"test_*{path.stem.strip('_').removesuffix('_kernel')}*.py"))
    return (*map(str, named), str(folder), f"{FROZEN}[{path.parts[1]}]")


def baseline_s(tests: Sequence[str]) -> float:
    """Run tests without a mutant.

    Returns
    -------
    float
        How much processor time they take [s]: a busy machine kills no mutant.

    Raises
    ------
    RuntimeError
        If they fail: then they say nothing about mutants.
    """
    with TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        if _exit_code(None, tests, math.inf, scratch) != 0:
            raise RuntimeError(f"{' '.join(tests)} fail without a mutant: run pytest on them")
        return float(Path(scratch, SPENT).read_text())


def fate(mutant: Mutant, tests: Sequence[str], limit_s: float) -> Fate:
    """What becomes of a mutant in place of its module, in so much processor time."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        code = _exit_code(mutant, tests, limit_s, scratch)
    if code in (None, -signal.SIGXCPU):
        return Fate.HUNG
    return Fate.SURVIVED if code == 0 else Fate.FAILED


def _exit_code(
    mutant: Mutant | None, tests: Sequence[str], limit_s: float, scratch: str
) -> int | None:
    """Of pytest in a process of its own; None where it had to be stopped."""
    process = _CONTEXT.Process(target=_trial, args=(mutant, tests, limit_s, scratch))
    process.start()
    process.join(BLOCKED_S)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
        return None
    return process.exitcode


def _trial(mutant: Mutant | None, tests: Sequence[str], limit_s: float, scratch: str) -> None:
    import numba

    os.setsid()
    if math.isfinite(limit_s):
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s), resource.RLIM_INFINITY))
    silence = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(silence, stream.fileno())
    sys.dont_write_bytecode = True
    if mutant is not None:
        sys.meta_path.insert(0, _Finder(mutant))
        numba.config.DISABLE_JIT = mutant.path.stem in PLAIN_KERNELS
        if "njit" in mutant.source:
            # what numba keeps of a kernel goes by its file, which is as it was
            numba.config.CACHE_DIR = scratch
    arguments = [*PYTEST, f"--basetemp={scratch}/pytest", *tests]
    code = pytest.main(arguments, plugins=[_FirstFailure()])
    Path(scratch, SPENT).write_text(str(time.process_time()))
    # pytest's own code, whatever the modules left behind do when Python winds down
    os._exit(code)


class _FirstFailure:
    """Has hypothesis stop at an example that fails, instead of looking for a simpler one."""

    def pytest_configure(self) -> None:
        settings.register_profile(
            "first failure",
            settings.get_profile(settings.get_current_profile_name()),
            phases=(Phase.explicit, Phase.generate),
            report_multiple_bugs=False,
            database=None,
        )
        settings.load_profile("first failure")


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the mutant where its module is imported."""

    def __init__(self, mutant: Mutant) -> None:
        self._path = str(mutant.path.resolve())
        self._name = ".".join(mutant.path.with_suffix("").parts).removesuffix(".__init__")
        self._source = mutant.source

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        if fullname != self._name:
            return None
        loader = _Loader(fullname, self._path, self._source)
        return importlib.util.spec_from_file_location(fullname, self._path, loader=loader)


class _Loader(SourceFileLoader):
    """Executes other source than what the file holds."""

    def __init__(self, fullname: str, path: str, source: str) -> None:
        super().__init__(fullname, path)
        self._source = source

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self._source, self.get_filename(fullname))
