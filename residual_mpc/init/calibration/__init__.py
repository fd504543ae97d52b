"""In which units, with which signs and zeros the columns are, and which servos drive the joints."""
