"""Identification of the vehicle of Table 2, and sensitivities."""
