"""HTML as a tree of elements: all text is escaped when it is written, whatever it holds."""

from collections.abc import Iterable
from xml.etree.ElementTree import Element, tostring

__all__ = [
    "Child",
    "document_text",
    "element",
    "listing",
    "number",
    "optional",
    "scrolling",
    "table_head",
]

Child = Element | str | None

BLOCKS = {
    *("head", "meta", "title", "style", "body", "header", "nav", "main", "section"),
    *("h1", "h2", "h3", "p", "ul", "ol", "li", "dl", "div", "figure", "figcaption", "svg"),
    *("table", "caption", "thead", "tbody", "tr"),
}
"""What begins a new line in the source."""


def element(tag: str, *children: Child, **attributes: str | float | int | None) -> Element:
    """An element; what is None is left out. `class_` is "class", and `stroke_width` "stroke-width".

    >>> document_text(element("p", "a < b", element("a", "c", href="#c"), class_="note"))
    '<p class="note">a &lt; b<a href="#c">c</a></p>'
    """
    given = {
        name.rstrip("_").replace("_", "-"): str(value)
        for name, value in attributes.items()
        if value is not None
    }
    made = Element(tag, given)
    for child in children:
        if isinstance(child, Element):
            made.append(child)
        elif child is not None and len(made):
            made[-1].tail = (made[-1].tail or "") + child
        elif child is not None:
            made.text = (made.text or "") + child
    return made


def document_text(root: Element) -> str:
    """The tree as HTML. Adds line ends to it, where they change nothing that is seen."""
    for parent in root.iter():
        for child in parent:
            if child.tag in BLOCKS and not child.tail:
                child.tail = "\n"
    return tostring(root, encoding="unicode", method="html")


def listing(items: Iterable[Child]) -> list[Element]:
    """A list with bullets; nothing where there are no items."""
    entries = [element("li", item) for item in items]
    return [element("ul", *entries)] if entries else []


def table_head(columns: Iterable[tuple[str, str | None]]) -> Element:
    """The head of a table: a heading a column, and the class of its cells."""
    cells = (element("th", name, scope="col", class_=kind) for name, kind in columns)
    return element("thead", element("tr", *cells))


def scrolling(part: Element, label: str) -> Element:
    """What may be wider than a screen, to be moved by itself, with the keyboard too."""
    return element("div", part, class_="scroll", role="region", tabindex=0, aria_label=label)


def number(value: float | int | None) -> str:
    """Three digits.

    >>> number(0.123456), number(None)
    ('0.123', 'not finite')
    """
    return "not finite" if value is None else f"{value:.3g}"


def optional(value: float | int | None, form: str = ".3g") -> str | None:
    """A number as text, None where there is none."""
    return None if value is None else f"{value:{form}}"
