"""From a model file and a few logs to a robot file: what each column is, in which unit, with which sign."""
