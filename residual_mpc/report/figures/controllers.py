"""How the controllers' lines differ: in colour, dashes and width, so in black and white and to colour-blind readers as
well. The hues are those of Okabe and Ito, Color Universal Design (2008), darkened for white paper."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from residual_mpc.report.figures.inline import COLOURS

if TYPE_CHECKING:
    from markupsafe import Markup

SWATCH = 40.0  # px, the length of a line in a legend


@dataclass(frozen=True)
class Line:
    """colour: a key of COLOURS; width, pt; dashes: drawn and left out in turn, in widths, () for a solid line."""

    colour: str
    width: float = 1.4
    dashes: tuple[float, ...] = ()

    @property
    def colour_code(self) -> str:
        return COLOURS[self.colour]

    def style(self) -> dict[str, Any]:
        """For matplotlib. Wide lines are drawn first, so that a line on top of another leaves both visible."""
        dashed = (0, self.dashes) if self.dashes else "-"
        return {"color": self.colour_code, "lw": self.width, "ls": dashed, "zorder": 3.0 - 0.1 * self.width}

    def swatch(self) -> "Markup":
        """The same line for a legend in HTML."""
        from markupsafe import Markup

        dashes = " ".join(f"{self.width * d:g}" for d in self.dashes) or "none"
        return Markup(
            '<svg class="line" viewBox="0 0 {0:g} 8" width="{0:g}" height="8" aria-hidden="true"><path d="M0 4H{0:g}"'
            ' style="stroke:var(--{1});stroke-width:{2:g};stroke-dasharray:{3};fill:none"/></svg>'
        ).format(SWATCH, self.colour, self.width, dashes)


LINES = {
    "nominal": Line("before", 1.4, (4.0, 1.6)),
    "effects": Line("effects", 3.0),
    "network": Line("network", 1.4, (6.0, 1.5, 1.0, 1.5)),
    "augmented": Line("after"),
    "online": Line("online", 2.0, (1.0, 1.0)),
    "oracle": Line("floor", 1.4, (1.0, 1.6)),
}


def line_of(controller: str) -> Line:
    """A controller of an unknown name is a corrected model."""
    return LINES.get(controller, LINES["augmented"])
