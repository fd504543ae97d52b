"""What is known of a remainder, as frozen records."""

from dataclasses import dataclass

from residual_mpc.diagnosis.data.where import Where
from residual_mpc.models.settings import Term


@dataclass(frozen=True)
class Component:
    """name: a channel, or forward, sideways, yaw; share of what is left beyond the noise; rate: root mean square over
    the windows of the constant rate that the model would lack, in `unit`."""

    name: str
    share: float
    rate: float
    unit: str


@dataclass(frozen=True)
class Curve:
    """The missing rate of a component (y, se: standard error) over a coordinate (x)."""

    component: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    se: tuple[float, ...]
    x_unit: str
    y_unit: str
    repeats: int | None = None  # how often per turn, where x is an angle within one repetition


@dataclass(frozen=True)
class Dependence:
    """on: the coordinate in words; kind, of: which; form: "added", or in proportion to the component's "speed", or to
    its "direction". share: of what is left beyond the noise, on windows that it was not fitted to; by_chance: the
    largest share of the same coordinate on shuffled windows; alike: others that the runs do not tell from it."""

    on: str
    kind: str
    of: str | None
    form: str
    share: float
    by_chance: float
    alike: tuple[str, ...]
    curve: Curve


@dataclass(frozen=True)
class Resemblance:
    """The known effect that comes closest: what share of the squared rest it closes on windows kept back (of all,
    where none were), fitted alone on top of what is named."""

    term: Term
    closes: float


@dataclass(frozen=True)
class Rest:
    """components: the largest first. where: as of the gap, but of what is left. burst: the share of the time that holds
    half of it. depends: the first and, where there is one, the second; empty where nothing that was logged does better
    than chance. own_step: whether most of it is the error of the model's own time step; no other cause is then
    suggested."""

    components: tuple[Component, ...]
    where: Where
    burst: float
    depends: tuple[Dependence, ...]
    resembles: Resemblance | None
    own_step: bool = False

    def document(self) -> dict[str, object]:
        """As diagnosis.json has it."""
        return {
            "components": [{"name": c.name, "share": c.share, "rate": c.rate, "unit": c.unit} for c in self.components],
            "regimes": [{"name": r.name, "share": r.share, "lift": r.lift} for r in self.where.regimes],
            "times": [{"run": s.run, "from": s.start, "to": s.end, "share": s.share} for s in self.where.times],
            "half_within": self.burst,
            "depends_on": [_depends(d) for d in self.depends],
            "resembles": None
            if self.resembles is None
            else {
                "effect": self.resembles.term.effect,
                "target": self.resembles.term.target,
                "closes": self.resembles.closes,
            },
            "own_step": self.own_step,
        }


def _depends(d: Dependence) -> dict[str, object]:
    return {
        "on": d.on,
        "kind": d.kind,
        "of": d.of,
        "form": d.form,
        "share": d.share,
        "by_chance": d.by_chance,
        "alike": list(d.alike),
        "curve": {
            "component": d.curve.component,
            "x": list(d.curve.x),
            "y": list(d.curve.y),
            "se": list(d.curve.se),
            "x_unit": d.curve.x_unit,
            "y_unit": d.curve.y_unit,
            "repeats": d.curve.repeats,
        },
    }
