"""Identification of the vehicle of Table 2, and sensitivity of the results."""
