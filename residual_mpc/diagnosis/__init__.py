"""Attributes the gap between a nominal model and its logged runs to named effects.

`diagnose` goes through six phases (`phases`): prepare, search, refine, validate, fit laws, describe. What they need
stands in packages that import one way: `results` (the answer), `laws` (what no effect explains as functions of a
quantity), `remainder` (its description), `search` (which effects), `fit` (their numbers), `predict` (the model on the
windows), `data` (the runs cut into windows). Each has the records that tune it in its `settings`; `options.Options`
holds them all.
"""
