"""HTML and SVG from elements, whose texts are escaped as they are written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element


def element(tag: str, *content: Element | str | None, **attributes: object) -> Element:
    """An element and what is in it; None is left out, and ``class_`` stands for ``class``."""
    made = Element(
        tag, {name.strip("_").replace("_", "-"): str(v) for name, v in attributes.items()}
    )
    for piece in content:
        if isinstance(piece, Element):
            made.append(piece)
        elif piece is not None and len(made):
            made[-1].tail = (made[-1].tail or "") + piece
        elif piece is not None:
            made.text = (made.text or "") + piece
    return made


def table(header: Sequence[str], rows: Iterable[Sequence[Element | str]], names: int) -> Element:
    """A table; its first ``names`` columns hold names, the others figures."""

    def line(tag: str, cells: Sequence[Element | str]) -> Element:
        kinds = ["name"] * names + ["figure"] * (len(cells) - names)
        return element(
            "tr", *(element(tag, c, class_=kind) for c, kind in zip(cells, kinds, strict=True))
        )

    head, body = element("thead", line("th", header)), (line("td", row) for row in rows)
    return element("div", element("table", head, element("tbody", *body)), class_="scroll")


def page(title: str, css: str, *content: Element | None) -> str:
    """A whole page that needs nothing beside it."""
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", title),
        element("style", css),
    )
    body = element("body", element("main", *content))
    text = ElementTree.tostring(element("html", head, body, lang="en"), "unicode", method="html")
    return f"<!doctype html>\n{text}\n"
