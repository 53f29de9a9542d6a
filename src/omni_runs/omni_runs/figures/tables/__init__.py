"""Tables of metrics for a terminal, and tables of data as CSV files."""
