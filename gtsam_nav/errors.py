"""The exceptions that gtsam_nav raises.

::

    GtsamNavError
    ├── ConfigError       wrong option, unknown key, value out of range   exit code 2
    ├── OutputError       a result cannot be written                      exit code 2
    ├── PackageError      an optional package does not import here        exit code 2
    ├── DataError         a mission is missing, damaged or unusable       exit code 3
    ├── EstimationError   the data are fine, the estimator failed         exit code 4
    └── RepetitionError   a repeated run is not the same                  exit code 5

Every message says what is wrong, where, and what the choices are. Only the command line turns an
exception into an exit code.
"""

from __future__ import annotations

from pathlib import Path


class GtsamNavError(Exception):
    """Base of everything that this package raises on purpose."""

    exit_code = 1


class ConfigError(GtsamNavError):
    """A setting is unknown or out of range."""

    exit_code = 2


class OutputError(GtsamNavError):
    """A result cannot be written where it was asked for."""

    exit_code = 2


class PackageError(GtsamNavError):
    """What was asked for needs a package that is not installed, or does not import here."""

    exit_code = 2


class DataError(GtsamNavError):
    """A mission file is missing, damaged or unusable.

    Parameters
    ----------
    what : str
        What is wrong and what the choices are.
    path : Path or str, optional
        The file it is wrong in.
    line : int, optional
        One-based line of that file.
    """

    exit_code = 3

    def __init__(self, what: str, path: Path | str | None = None, line: int | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.line = line
        where = "" if path is None else f"{path}: " if line is None else f"{path}:{line}: "
        super().__init__(where + what)


class RepetitionError(GtsamNavError):
    """A run was repeated and came out otherwise."""

    exit_code = 5


class EstimationError(GtsamNavError):
    """The estimator could not produce an answer."""

    exit_code = 4
