"""Answers and claims for the tests."""

from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.score.claim import Claim, claim_of


def answer(*effects, family="wheeled", level="single", **more) -> Answer:
    """effects: (name, target) or (name, target, parameters)."""
    planted = tuple(Planted(e[0], e[1], e[2] if len(e) > 2 else {}, 5.0) for e in effects)
    return Answer(case="x", family=family, level=level, seed=1, effects=planted, **more)


def claim(verdict, *named, groups=(), parameters=None) -> Claim:
    """named: (effect, target); groups: lists of members, each a name or a list of names."""

    def part(name):
        return {"effect": name[0], "target": name[1]}

    def member(m):
        return [part(n) for n in m] if isinstance(m, list) else part(m)

    return claim_of(
        {
            "verdict": verdict,
            "explanation": [{**part(n), "probability": 0.9, "parameters": parameters or {}} for n in named],
            "candidates": [],
            "confounded": [[member(m) for m in g] for g in groups],
            "shrink": None,
        }
    )
