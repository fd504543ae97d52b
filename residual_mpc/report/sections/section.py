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
    """`anchor` is the id that the table of contents points at; `body` is HTML that is safe to show; `script` names the
    template of the script that it needs, if any."""

    anchor: str
    title: str
    body: "Markup"
    script: str = ""


# A maker returns None where the document gives it nothing to say.
Maker = Callable[[Document, Evidence], Section | None]


@cache
def environment() -> "Environment":
    """The templates, which escape all that comes from a document and fail on a name that they do not know."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

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
    # a table that is wider than the page scrolls on its own, also by the keyboard
    jinja.globals["scroll"] = Markup('class="scroll" tabindex="0" role="group" aria-label="Table"')
    return jinja


def render(template: str, **context: Any) -> "Markup":
    """`templates/<template>` as safe HTML."""
    from markupsafe import Markup

    return Markup(environment().get_template(template).render(**context))
