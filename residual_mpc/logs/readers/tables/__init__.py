"""Tables of rows: text and Parquet, and the data sets that LeRobot makes of the latter."""
