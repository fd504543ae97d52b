"""Attributes the gap between a nominal model and its logged runs to named effects.

`diagnose` goes through five phases (`phases`): prepare, search, refine, validate, describe. What they need stands in
packages that import one way: `results` (the answer), `remainder` (what no effect explains), `search` (which effects),
`fit` (their numbers), `predict` (the model on the windows), `data` (the runs cut into windows). Each has the records
that tune it in its `settings`; `options.Options` holds them all.
"""
