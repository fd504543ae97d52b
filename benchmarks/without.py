"""A diagnosis that lacks one of its means, with the options of `residual-mpc diagnose`; for `benchmarks.ablation`.

python -m benchmarks.without MEANS --robot R RUN... --out DIR
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from residual_mpc.cli.main import main
from residual_mpc.diagnosis.data.outliers import Outliers
from residual_mpc.diagnosis.phases import prepare
from residual_mpc.diagnosis.search import stepwise
from residual_mpc.diagnosis.search.additions import Ranked
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.diagnosis.search.stepwise import Found


def start_states() -> None:
    """The measured start of a window is taken to be the true one."""
    everywhere("start_sigma", lambda data, settings: {})


def coloured_residuals() -> None:
    """Residuals count as white: a likelihood ratio is what it says."""
    everywhere("dispersion", lambda fit, blocks: 1.0)


def several_sets() -> None:
    """A step of the search starts from the best set alone."""
    told(beam=1)


def worth() -> None:
    """Whatever is beyond doubt is named, however little of the gap it removes."""
    told(over_floor=0.0, over_floor_longer=0.0, sizeable=float("inf"), most=float("inf"))


def pruning() -> None:
    """What was named once stays."""
    everywhere("prune", lambda problem, ruler, current, *rest, **thorough: current)


def exchange() -> None:
    """What the search ends with stands: nothing takes its place, and nothing is said to explain as much."""

    def alone(found: Found, **settings: Any) -> Rivalry:
        return Rivalry(found.fit, (), (), dict.fromkeys(found.fit.terms, 1.0), found.fit)

    everywhere("find_rivals", alone)


def what_is_compared() -> None:
    """Starts of fits are ranked by the likelihood alone, which precise encoders may shout down."""

    def first(one: list[Ranked], *others: list[Ranked]) -> list[Ranked]:
        return one

    everywhere("mixed", first)


def encoder_consistency() -> None:
    """Encoders do not contradict a stand-in."""
    everywhere("independent_encoders", lambda data: ())


def outliers() -> None:
    """No sample is flagged."""
    flagging: Callable[..., Outliers] = prepare.find_outliers

    def none(data: Any, **settings: Any) -> Outliers:
        found = flagging(data, **settings)
        flagged = {k: v & False for k, v in found.flagged.items()}
        return replace(found, flagged=flagged, share=0.0, count=0, enough=False, frequent=False)

    everywhere("find_outliers", none)


MEANS = {f.__name__: f for f in (start_states, coloured_residuals, several_sets, worth, pruning, exchange,
                                 what_is_compared, encoder_consistency, outliers)}  # fmt: skip


def told(**changes: float) -> None:
    """Other settings of the search than the product's."""
    whole = stepwise.stepwise_search

    def other(problem: Any, scales: Any, settings: Any, *rest: Any) -> Found:
        return whole(problem, scales, replace(settings, **changes), *rest)

    everywhere("stepwise_search", other)


def everywhere(name: str, by: Callable[..., Any]) -> None:
    """Another function wherever the diagnosis has taken this one from its module."""
    own = [m for n, m in sys.modules.items() if n.startswith("residual_mpc.diagnosis.")]
    found = [m for m in own if callable(getattr(m, name, None))]
    if not found:
        raise ValueError(f"no module of the diagnosis has {name}: mend this benchmark")
    for module in found:
        setattr(module, name, by)


if __name__ == "__main__":
    MEANS[sys.argv[1]]()
    sys.argv[1:] = ["diagnose", *sys.argv[2:]]
    main()
