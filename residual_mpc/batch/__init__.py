"""Diagnoses of many robots: a fleet, or one robot's logs of many days."""
