"""Motors that a robot file tells: constants given one by one, or a servo by its name."""
