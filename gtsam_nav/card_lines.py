"""Lines of a sensor's card that errors and findings advise."""

from __future__ import annotations


def scale(columns: str, factor: float) -> str:
    """Multiply columns of the file, named by words apart."""
    return f"scale: {{{', '.join(f'{name}: {factor:.7g}' for name in columns.split())}}}"
