"""How clauses about effects change with the sign and the unit of a parameter."""

# A clause whose parameter is negative says the opposite.
OPPOSITES = {
    "heavier": "lighter", "longer": "shorter", "too high": "too low", "more": "less", "falls by": "rises by",
    "outwards": "inwards", "farther from": "closer to", " late": " early",
}  # fmt: skip
QUANTITIES = {"rad/s": "speed", "m/s": "speed", "N m": "torque", "N": "force", "rad": "position", "m": "position"}
