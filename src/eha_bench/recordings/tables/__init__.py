"""Tables: CSV and its relatives, Parquet, MAT."""
