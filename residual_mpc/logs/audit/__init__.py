"""What is wrong or remarkable about runs, before anything is fitted to them."""

from residual_mpc.logs.audit.audit import audit
from residual_mpc.logs.audit.facts import ActuatorFacts, RobotFacts
from residual_mpc.logs.audit.incidents import with_incidents

__all__ = ["ActuatorFacts", "RobotFacts", "audit", "with_incidents"]
