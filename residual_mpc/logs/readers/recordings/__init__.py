"""Recordings of messages: each topic at its own rate, joined on time into one table."""
