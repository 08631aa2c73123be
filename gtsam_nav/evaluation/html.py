"""HTML from typed pieces; every text is escaped, unless it is `Html` already."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


VOID = ("img", "input", "meta")
"""Elements without content."""


def element(name: str, /, *content: str | Html, **attributes: str) -> Html:
    """An element with its content; ``class_`` stands for the attribute ``class``."""
    given = "".join(f' {key.rstrip("_")}="{escape(v)}"' for key, v in attributes.items())
    begin = f"<{name}{given}>"
    return Html(begin if name in VOID else f"{begin}{join(content)}</{name}>")


def join(pieces: Iterable[str | Html]) -> Html:
    """Pieces one after the other, escaped where they are plain text."""
    return Html("".join(p if isinstance(p, Html) else escape(p) for p in pieces))


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str | Html]],
    groups: Sequence[tuple[str, int]] = (),
    names: int = 1,
) -> Html:
    """A table; its first ``names`` columns hold names, the others figures.

    ``groups`` puts names over neighbouring columns: a name and how many columns it spans. A first
    cell that is empty belongs to the row above.
    """
    kinds = ["name"] * names + ["figure"] * (len(header) - names)
    cells = (element("th", name, class_=kind) for name, kind in zip(header, kinds, strict=True))
    head = [element("tr", *cells)]
    if groups:
        over = (element("th", name, colspan=str(span), class_="group") for name, span in groups)
        head.insert(0, element("tr", *over))
    body = (
        element(
            "tr",
            element("th", row[0], scope="row", class_="name"),
            *(
                element("td", cell, class_=kind)
                for cell, kind in zip(row[1:], kinds[1:], strict=True)
            ),
            class_="first" if row[0] else "next",
        )
        for row in rows
    )
    whole = element("table", element("thead", *head), element("tbody", *body))
    return element("div", whole, class_="scroll")
