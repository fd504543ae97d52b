"""How hard a search looks, and what counts as found."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class SearchSettings:
    """How hard to look, and what counts as found.

    beyond_doubt: likelihood ratio (drop in cost over dispersion) per added term, on top of `per_knob` for each knob;
    over_floor: an addition has to remove this multiple of the squared noise floor, below which nobody would see it;
    over_floor_longer: likewise over the longer horizons, where what adds up slowly shows;
    sizeable: share of the squared gap beyond the floor for which `beyond_doubt_sizeable` will do, where the gap is more
    than twice the floor; most, beyond_doubt_most: likewise for an effect that closes most of what is left;
    shortlist: starts that are fitted roughly per step, finalists: to the end; largest: terms in a set, largest_longer:
    once longer horizons are searched; beam: sets that a step starts from while more than the share `settled` of the
    squared gap beyond the floor is unexplained; share: of the squared gap beyond the floor that an addition has to
    remove.
    """

    beyond_doubt: float = 14.0
    per_knob: float = 3.0
    over_floor: float = 0.2
    over_floor_longer: float = 0.1
    sizeable: float = 0.25
    beyond_doubt_sizeable: float = 8.0
    most: float = 0.5
    beyond_doubt_most: float = 6.0
    shortlist: int = 10
    finalists: int = 5
    largest: int = 7
    largest_longer: int = 9
    beam: int = 4
    settled: float = 0.08
    share: float = 0.0

    def without_tolerances(self) -> "SearchSettings":
        """Stricter, for likelihoods in which small differences elsewhere are not marginalised."""
        return replace(
            self,
            beyond_doubt=25.0,
            per_knob=3.0,
            sizeable=0.2,
            beyond_doubt_sizeable=8.0,
            beyond_doubt_most=6.0,
            share=0.1,
        )
