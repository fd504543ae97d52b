"""How hard a search looks, and what counts as found."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """How hard to look, and what counts as found.

    beyond_doubt: likelihood ratio (drop in cost over dispersion) per added term, on top of `per_knob` for each knob;
    worth: an addition has to remove this share of what is left of the squared gap beyond the noise floor, or
    `worth_first` of the first model's; over_floor: and this multiple of the squared floor, below which nobody
    would see it;
    worth_far: the share that will do where the gap is more than twice the floor and the likelihood ratio is above
    `massive`; sizeable: the share for which `beyond_doubt_sizeable` will do there;
    shortlist: starts that are fitted roughly per step, finalists: to the end; largest: terms in a set; beam: sets
    that a step starts from while more than the share `settled` of the squared gap beyond the floor is unexplained.
    """

    beyond_doubt: float = 25.0
    per_knob: float = 4.0
    worth: float = 0.4
    worth_first: float = 0.08
    over_floor: float = 0.6
    worth_far: float = 0.08
    massive: float = 40.0
    sizeable: float = 0.25
    beyond_doubt_sizeable: float = 12.0
    shortlist: int = 10
    finalists: int = 5
    largest: int = 6
    beam: int = 4
    settled: float = 0.08
