"""Search for the placement of line cameras that gives the most accurate twist."""
