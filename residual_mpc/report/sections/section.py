"""A section of the report: a title over a piece of HTML. Sections are composed by sequence."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.words import effects, numbers

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

Document = Mapping[str, Any]  # diagnosis.json as read: its keys are an interface of their own


@dataclass(frozen=True)
class Section:
    """`anchor` is the id that the table of contents points at; `body` is HTML that is safe to show."""

    anchor: str
    title: str
    body: "Markup"


# A maker returns None where the document gives it nothing to say.
Maker = Callable[[Document, Evidence], Section | None]


@cache
def environment() -> "Environment":
    """The templates, which escape all that comes from a document and fail on a name that they do not know."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    jinja = Environment(
        loader=PackageLoader("residual_mpc.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {
        "number": numbers.number,
        "percent": numbers.percent,
        "measure": numbers.measure,
        "measure_interval": numbers.measure_interval,
        "percent_interval": numbers.percent_interval,
        "effect_name": effects.name,
        "effect_numbers": effects.numbers_of,
        "effect_sentence": effects.sentence_of,
        "effect_stage": effects.stage,
        "unit_text": numbers.spelled,
        "capital": lambda text: text[:1].upper() + text[1:],
        "listed": numbers.listed,
        "count": numbers.count,
    }
    return jinja


def render(template: str, **context: Any) -> "Markup":
    """`templates/<template>` as safe HTML."""
    from markupsafe import Markup

    return Markup(environment().get_template(template).render(**context))
