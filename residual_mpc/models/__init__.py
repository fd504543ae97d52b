"""A nominal model once, for numpy, JAX and CasADi; the integrators; linearisation."""
