"""Which of several sensors is wrong, when they are compared two by two."""

from __future__ import annotations

from collections.abc import Collection

Pair = tuple[str, str]


def suspects(discordant: Collection[Pair], concordant: Collection[Pair]) -> tuple[str, ...]:
    """The sensors of which any one being wrong explains what was found.

    One fault is likelier than two: whoever takes part in every disagreement and in no agreement is
    suspected. Where nobody is (two faults at once), whoever agrees with nobody is.

    Parameters
    ----------
    discordant, concordant : collection of (str, str)
        Pairs that contradict each other, and pairs that agree.

    Returns
    -------
    tuple of str
        In the order of their names; empty without a disagreement.
    """
    named = sorted({name for pair in discordant for name in pair})
    trusted = {name for pair in concordant for name in pair}
    in_all = [name for name in named if all(name in pair for pair in discordant)]
    unsupported = [name for name in in_all if name not in trusted]
    return tuple(unsupported or in_all or [n for n in named if n not in trusted] or named)
