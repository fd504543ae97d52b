"""The unmodelled effects, by stage: command, actuator, body, contact, sensor."""
