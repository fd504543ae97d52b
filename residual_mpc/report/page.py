"""A report as one HTML file: the sections that have something to say, one after the other, and the script they need."""

from collections.abc import Iterable
from dataclasses import dataclass

from residual_mpc.report.program import allowed, program
from residual_mpc.report.sections.section import Section, render


@dataclass(frozen=True)
class Frame:
    """What stands around the sections. heading: whose report it is; title: of the window, after the heading; kicker:
    the line above the heading; source: the file that says the same to a program."""

    heading: str
    title: str
    kicker: str
    source: str


def page(frame: Frame, made: Iterable[Section | None]) -> str:
    """The page as text. It needs no network and no second file, and is readable without its script."""
    from markupsafe import Markup

    sections = [section for section in made if section is not None]
    script = program(sections)
    return str(
        render("page.html.jinja", **vars(frame), sections=sections, script=Markup(script), scripts=allowed(script))
    ) + "\n"  # fmt: skip
