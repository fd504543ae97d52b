"""The text of a URDF, edited in place: whatever is not changed stays as it was written, comments and all."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr


@dataclass
class Element:
    """An element of the text. begin, end: of its start tag in the text, bytes."""

    tag: str
    attributes: dict[str, str]
    parent: "Element | None"
    begin: int
    end: int
    children: "list[Element]" = field(default_factory=list)

    def find(self, tag: str) -> "Element | None":
        """The first child of that name."""
        return next((c for c in self.children if c.tag == tag), None)

    def all(self, tag: str) -> "Iterator[Element]":
        """The children of that name."""
        return (c for c in self.children if c.tag == tag)


@dataclass
class UrdfText:
    """text: as it was read; root: its <robot>; changes: (begin, end, replacement) of the text, bytes, none of which
    overlap."""

    text: bytes
    root: Element
    changes: list[tuple[int, int, bytes]] = field(default_factory=list)

    def write(self, parent: Element, path: str, values: Mapping[str, str]) -> None:
        """Set attributes of the element at `path` below the parent, such as "inertial/mass", making what is missing.

        Values of one element are set at once: a second call on the same element is not seen by the first.
        """
        head, _, rest = path.partition("/")
        child = parent.find(head)
        if child is None:
            inner = "".join(f"<{tag}>" for tag in path.split("/")[:-1])
            last = path.rpartition("/")[2]
            outer = "".join(f"</{tag}>" for tag in reversed(path.split("/")[:-1]))
            self.insert(parent, f"{inner}<{last}{_attributes(values)}/>{outer}")
        elif rest:
            self.write(child, rest, values)
        else:
            tag = self.text[child.begin : child.end].decode()
            for name, value in values.items():
                tag = _with_attribute(tag, name, value)
            self.changes.append((child.begin, child.end, tag.encode()))

    def insert(self, parent: Element, text: str) -> None:
        """Put text in as the first content of an element."""
        tag = self.text[parent.begin : parent.end].decode()
        if tag.endswith("/>"):
            opened = f"{tag[:-2].rstrip()}>{text}</{parent.tag}>"
            self.changes.append((parent.begin, parent.end, opened.encode()))
        else:
            self.changes.append((parent.end, parent.end, text.encode()))

    def result(self) -> str:
        """The text with all changes made; insertions at one place keep their order."""
        out, at = [], 0
        for begin, end, new in sorted(self.changes, key=lambda c: (c[0], c[1])):
            out += [self.text[at:begin], new]
            at = end
        return b"".join([*out, self.text[at:]]).decode()


def read_urdf_text(text: bytes) -> UrdfText:
    """Raises expat.ExpatError for what is no XML."""
    parser = expat.ParserCreate()
    stack: list[Element] = []
    roots: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        begin = parser.CurrentByteIndex
        element = Element(tag, attributes, stack[-1] if stack else None, begin, _tag_end(text, begin))
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: stack.pop()
    parser.Parse(text, True)
    return UrdfText(text, roots[0])


def _tag_end(text: bytes, begin: int) -> int:
    """Where the start tag ends: at the first > outside quotes."""
    quote = b""
    for at in range(begin, len(text)):
        c = text[at : at + 1]
        if quote:
            quote = b"" if c == quote else quote
        elif c in b"\"'":
            quote = c
        elif c == b">":
            return at + 1
    return len(text)


def _with_attribute(tag: str, name: str, value: str) -> str:
    """A start tag with an attribute set."""
    found = re.search(rf"(\s{re.escape(name)}\s*=\s*)(\"[^\"]*\"|'[^']*')", tag)
    if found:
        return tag[: found.start(2)] + quoteattr(value) + tag[found.end(2) :]
    close = "/>" if tag.endswith("/>") else ">"
    return f"{tag[: -len(close)].rstrip()} {name}={quoteattr(value)}{close}"


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items())
